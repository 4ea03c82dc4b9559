"""Find the publication's modes among the identified ones of a window, as the product does."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.reproduction.paper import LABELS
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.model_matching import Match, Matcher
from pipeline.updating.prior import Prior
from pipeline.updating.samplers.interface import Peak
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel


@dataclass(frozen=True, slots=True, eq=False)
class ListedModes:
    """The publication's modes among the identified ones."""

    found: Mapping[str, Mode]
    """Label → identified mode, lowest frequency first."""
    others: int
    """Number of identified modes that are other modes of the model, which it does not list."""
    unpaired: int
    """Number of identified modes that are paired with no mode of the model."""
    start: FloatArray
    """Ratios k / nominal at which they were paired: where the samplers begin, shape (3,) [-]."""
    own_peak: Peak
    """Peak of the product's own likelihood of all paired modes."""


def paired_blind(
    estimate: ModalEstimate, model: ModalModel, prior: Prior, generator: np.random.Generator
) -> ListedModes:
    """Find the publication's modes among the identified ones as the product does.

    Parameters
    ----------
    estimate : ModalEstimate
        Of the window.
    model : ModalModel
        Every mode of which the sensors can see is searched.
    prior : Prior
        The search goes over the whole of it.
    generator : numpy.random.Generator
        For the search.

    Notes
    -----
    The truth is not known to it. Of a pair that the window does not separate only the mean
    frequency is searched: as two sharp modes it would lead the search to other springs.
    """
    evidence = ModalEvidence(channels=estimate.channels).with_estimate(estimate)
    matcher = Matcher(
        model,
        prior,
        pairing=PairingSettings(),
        likelihood=LikelihoodSettings(),
        generator=generator,
    )
    match = matcher.matched(evidence)
    partners = _partners(match, estimate, prior)
    listed = [(label, mode) for label, mode in partners.items() if label in LABELS]
    return ListedModes(
        found=dict(sorted(listed, key=lambda each: each[1].frequency)),
        others=len(partners) - len(listed),
        unpaired=len(estimate.modes) - len(partners),
        start=match.pairing.ratios,
        own_peak=match.peak,
    )


def _partners(match: Match, estimate: ModalEstimate, prior: Prior) -> dict[str, Mode]:
    """Return label → identified mode of every pair; the members of a close pair each their own."""
    by_name = {mode.name: mode for mode in estimate.modes}
    at_start = match.all_modes.modal(prior.stiffness(match.pairing.ratios[None]))
    taken = set(match.pairing.model_modes)
    found: dict[str, Mode] = {}
    for each in match.used:
        members = [by_name[name] for name in match.evidence.modes[each.identified].name.split("+")]
        own = match.pairing.model_modes[each.identified]
        partners = [mode for mode in each.model_modes if mode == own or mode not in taken]
        likeness = modal_assurance_criterion(
            np.array([mode.shape for mode in members]), at_start.shapes[0, partners]
        )
        for member, partner in zip(*linear_sum_assignment(-likeness), strict=True):
            found[match.all_modes.labels[partners[partner]]] = members[member]
    return found
