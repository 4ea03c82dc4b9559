"""What is compared with what: the windows' modes paired with the model's, and their likelihood.

The likelihood's peak and the curvature there are where chains start, never the answer.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import PartnerInWater
from pipeline.updating.evidence.observations import EstimateRefused
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    ModeComparison,
    observations,
)
from pipeline.updating.likelihood.pairing import (
    DIFFERENCE,
    STEP_LENGTHS,
    Pairing,
    PairingSearch,
    PairingSettings,
    PairingTargets,
    macs,
)
from pipeline.updating.prior import Prior, UpdatingError
from pipeline.updating.samplers.interface import Peak
from sensors.arrays import FloatArray

WATER_ROUNDS = 6  # at most, of taking the water out of the windows
FAR_RISE = 0.5  # of the windows' mean level, from which on they are compared with modes in it [m]
RISE_STEP = 0.5  # in which that level is followed: windows that come move it less and less [m]
GAUSS_NEWTON_STEPS = 12  # at most
WIDEST = 1.0  # standard deviation of a ratio beyond which a Gaussian has no information [-]
SETTLED = 0.001  # change of a ratio k / nominal at which no further round is needed [-]


@dataclass(frozen=True, slots=True, eq=False)
class Match:
    """Evidence tied to the model: what is compared with what, and how well it can fit."""

    pairing: Pairing
    evidence: ModalEvidence
    """At the water level that `all_modes` and `forward` stand in."""
    used: tuple[ModeComparison, ...]
    likelihood: ModalLikelihood
    all_modes: ForwardModel
    """Every visible mode, followed from the pairing's stiffness."""
    forward: ForwardModel
    """Only those that the likelihood asks for."""
    peak: Peak


class Matcher:
    """Pairs the evidence with the model over the whole prior; the likelihood is of these pairs."""

    def __init__(
        self,
        forward: ForwardModel,
        prior: Prior,
        *,
        pairing: PairingSettings,
        likelihood: LikelihoodSettings,
        generator: np.random.Generator,
    ) -> None:
        """forward: the structure at the layout's sensors. generator: for the search's draws.

        Raises UpdatingError where the settings name a mode that the model doesn't have.
        """
        _check_labels(likelihood.modes, forward.labels)
        self._forward = forward
        self._prior = prior
        self._settings = likelihood
        self._reach = float(np.max(forward.modal(prior.nominal[None]).frequencies))
        self._search = PairingSearch(forward, prior, pairing, generator)

    def matched(self, evidence: ModalEvidence, start: FloatArray | None = None) -> Match:
        """Pairing, likelihood and its peak; the pairing is made once more at the peak.

        Parameters
        ----------
        evidence : ModalEvidence
            Of all windows.
        start : ndarray, shape (3,), optional
            Ratios to look at as well, e.g. the last posterior's median [-].

        Raises
        ------
        EstimateRefused
            Where no mode of the last window has a partner in the model.
        """
        match = self._match(evidence, self._search.best(self._targets(evidence), start))
        again, first = self._search.refined(self._targets(match.evidence), match.peak.ratios), match
        other = again.model_modes != first.pairing.model_modes
        if other and again.total_cost <= first.pairing.total_cost:
            match = self._match(evidence, again)
        latest = [mode.last_window == evidence.n_windows for mode in evidence.modes]
        if not any(latest[each.identified] for each in match.used):
            raise without_partner(sum(latest))
        return match

    def _targets(self, evidence: ModalEvidence) -> PairingTargets:
        return PairingTargets.of(evidence.modes, evidence.n_windows, reach=self._reach)

    def _match(self, measured: ModalEvidence, pairing: Pairing) -> Match:
        local = self._forward.following(self._prior.stiffness(pairing.ratios))
        evidence = measured
        if measured.level_varied:
            pairing, local, evidence = self._out_of_water(measured, pairing, local)
        used = self._used(evidence, pairing, local, pairing.ratios)
        match = self._match_of(evidence, pairing, local, used, pairing.ratios)
        there = self._used(evidence, pairing, local, match.peak.ratios)
        if _choices(there) == _choices(used):
            return match
        return self._match_of(evidence, pairing, local, there, match.peak.ratios)

    def _used(
        self,
        evidence: ModalEvidence,
        pairing: Pairing,
        local: ForwardModel,
        ratios: FloatArray,
    ) -> tuple[ModeComparison, ...]:
        """What of the paired modes is compared, as the model's neighbours lie at some springs: the
        search ends beside the peak, by another distance for other draws."""
        modes = local.modal(self._prior.stiffness(ratios[None]))
        mac = macs(self._targets(evidence), modes.shapes)[0]
        frequencies = modes.frequencies[0]
        used = self._compared(observations(evidence, pairing, frequencies, self._settings, mac=mac))
        if not used:
            raise without_partner(len(evidence.modes))
        return used

    def _match_of(
        self,
        evidence: ModalEvidence,
        pairing: Pairing,
        local: ForwardModel,
        used: tuple[ModeComparison, ...],
        start: FloatArray,
    ) -> Match:
        """The match of chosen comparisons, its peak sought from some springs."""
        columns = sorted({mode for each in used for mode in each.model_modes})
        forward = local.subset([local.labels[mode] for mode in columns])
        likelihood = ModalLikelihood(
            evidence,
            used,
            model_columns=columns,
            settings=self._settings,
            highest_sigma=self._prior.settings.highest_sigma,
        )
        peak = laplace_peak(likelihood, forward, self._prior, start)
        return Match(pairing, evidence, used, likelihood, local, forward, peak)

    def _out_of_water(
        self, measured: ModalEvidence, pairing: Pairing, local: ForwardModel
    ) -> tuple[Pairing, ForwardModel, ModalEvidence]:
        """The evidence as at the model's level, paired there, and the modes followed from there.

        What the water does to a shape depends on the stiffness, by a quarter for a few percent of
        it; and the first pairing's stiffness is that of windows with water in them. So the water is
        taken out until the stiffness stays.
        """
        for _ in range(WATER_ROUNDS):
            partners, start = partners_in_water(local), pairing.ratios
            evidence = measured.at_model_level(_of_each(partners, pairing))
            pairing = self._search.refined(self._targets(evidence), start)
            local = self._forward.following(self._prior.stiffness(pairing.ratios))
            if np.abs(pairing.ratios - start).max() < SETTLED:
                break
        return pairing, local, measured.at_model_level(_of_each(partners, pairing))

    def _compared(self, found: Sequence[ModeComparison]) -> tuple[ModeComparison, ...]:
        """Those of the modes that the settings name; all where they name none."""
        named, labels = self._settings.modes, self._forward.labels
        return tuple(each for each in found if not named or labels[each.model_modes[0]] in named)


def _choices(used: Sequence[ModeComparison]) -> list[tuple[tuple[int, ...], bool]]:
    """Which modes are compared, and whether in shape, apart from by how much frequencies widen."""
    return [(each.model_modes, each.shape_used) for each in used]


def rise_of_comparison(evidence: ModalEvidence) -> float:
    """Return the water above the model's level in which windows and model are compared [m].

    Parameters
    ----------
    evidence : ModalEvidence
        With the windows' water levels in it, above the model's.

    Returns
    -------
    float
        The windows' mean in steps of RISE_STEP; 0 near the model's level.

    Notes
    -----
    Modes follow the water on a parabola about the level of the comparison. At 3 m it is off by up
    to .09 % in ln f, and neighbours that the water moves together mix as no parabola says (IEA
    15 MW).
    """
    mean = evidence.mean_rise
    return round(mean / RISE_STEP) * RISE_STEP if abs(mean) > FAR_RISE else 0.0


def partners_in_water(forward: ForwardModel) -> list[PartnerInWater]:
    """Return each mode of the model with the water a metre lower, as it is and a metre higher."""
    modes = forward.in_water([-1.0, 0.0, 1.0])
    logs = np.log(modes.frequencies)
    return [PartnerInWater(logs[:, j], modes.shapes[:, j]) for j in range(len(forward.labels))]


def _of_each(partners: Sequence[PartnerInWater], pairing: Pairing) -> list[PartnerInWater | None]:
    """Each identified mode's partner."""
    return [partners[mode] if mode >= 0 else None for mode in pairing.model_modes]


def without_partner(n_modes: int) -> EstimateRefused:
    """Return the refusal of modes of which none is the model's."""
    return EstimateRefused(
        "no-paired-mode", f"none of the {n_modes} identified modes is a mode of the model"
    )


def _check_labels(named: Sequence[str], labels: Sequence[str]) -> None:
    for name in named:
        if name not in labels:
            raise UpdatingError(
                f"likelihood modes name {name!r}; the model's modes that these sensors see are "
                f"{', '.join(labels)}"
            )


def laplace_peak(
    likelihood: ModalLikelihood,
    forward: ForwardModel,
    prior: Prior,
    start: FloatArray,
) -> Peak:
    """Gauss-Newton from start, (3,) ratios, at the σ that is most likely on the way.

    H = Jᵀ Σ(σ)⁻¹ J,   J = dη/dr by differences;   covariance = H⁻¹
    """
    ratios = start
    hessian = np.eye(3)
    for _ in range(GAUSS_NEWTON_STEPS):
        points = ratios + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
        modes = forward.modal(prior.stiffness(points))
        whitened = likelihood.whitened(modes)
        jacobian = (whitened[1:] - whitened[0]).T / DIFFERENCE
        weights = likelihood.weights(whitened[0] ** 2)
        gradient = jacobian.T @ (weights * whitened[0])
        hessian = (jacobian.T * weights) @ jacobian
        if not np.all(np.isfinite(hessian)):
            return Peak(ratios, np.eye(3) * WIDEST**2)
        step = -np.linalg.pinv(hessian, rcond=1e-12) @ gradient
        better = _best_on_line(likelihood, forward, prior, ratios, step)
        if better is None:
            break
        ratios = better
        if np.abs(jacobian @ step).max() < 0.02:
            break
    return Peak(ratios, bounded_inverse(hessian))


def _best_on_line(
    likelihood: ModalLikelihood,
    forward: ForwardModel,
    prior: Prior,
    ratios: FloatArray,
    step: FloatArray,
) -> FloatArray | None:
    """The most likely of a few points along the step; None where standing still is best."""
    trials = np.vstack([ratios, ratios + STEP_LENGTHS[:, None] * step])
    trials = trials[prior.supports(trials)]
    if not len(trials):
        return None
    values = likelihood.log_likelihood(forward.modal(prior.stiffness(trials))).max(axis=1)
    best = int(np.argmax(values))
    return None if np.array_equal(trials[best], ratios) else trials[best]


def bounded_inverse(hessian: FloatArray) -> FloatArray:
    """H⁻¹ with every direction's standard deviation at most WIDEST."""
    values, directions = np.linalg.eigh(hessian)
    variances = 1 / np.maximum(values, 1 / WIDEST**2)
    return (directions * variances) @ directions.T
