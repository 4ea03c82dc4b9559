"""Discrete alternatives of the structure, each fitted by itself and weighed by the evidence.

A monopile is flooded or not; its tubes shear or only bend; blades behave as the description's
reduced ones or as converged ones. Between such structures no figure leads from one to the other, so
each is a model of its own:

    p(u | d) = Σ_a p(a | d) p(u | d, a),   p(a | d) ∝ p(a) |H_a|^(−1/2) exp(−cost_a / 2)

with costs at one σ for all, that of the best, in which a mode without a partner costs its rejection
(`joint_fit`), so that alternatives that pair different modes can be compared. Where the best misses
the modes by more than their errors, φ = cost per degree of freedom > 1, differences of misfit are
worth 1/φ of what they are otherwise, those of the prior as much as ever: a quasi-likelihood. Over
many windows errors that stay outgrow those that were counted on, and a structure with a figure at
six standard deviations of its prior would else win by what is no more than their pattern.
Springs of the other sign are no such alternative, since a posterior's k12 is counted in the
description's: where the coupling has left the data, their weight is only reported.
Sources: MacKay, "Information Theory, Inference, and Learning Algorithms" (2003), chapter 28;
McCullagh and Nelder, "Generalized Linear Models" (1989), chapter 9, for φ.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import FEW_STARTS, LARGEST_COST, JointFit
from pipeline.updating.structural.joint_model import FINEST_TOLERANCE, JointPeak
from pipeline.updating.structural.posterior import JointPosterior, joint_posterior
from pipeline.updating.structural.prior import (
    GaussianBelief,
    JointCoordinates,
    StructuralPrior,
)
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.structure.description import TurbineDescription

LEAST_ALTERNATIVE_WEIGHT = 1e-3  # of an alternative that draws are taken from [-]
HOPELESS = 60.0  # cost above a rival's at which a structure has lost: e^-30 of its probability
LEAST_PAIRED = 0.5  # of what a rival pairs: alternatives are weighed by the same modes [-]
COST_GROWTH = 1.15  # of the last fit's cost, up to which a warm start is as good as it was [-]
UNDESCRIBED_FLOODING = 0.1  # prior probability that water inside is not as described [-]
LEAST_COUPLING = 0.25  # k12² / (k11 k22) over the described, below which the sign is in doubt: of
# 12 towers of the other sign (seeds 18700 to 18705) all ended near 0; springs of .8 to 1.25 of the
# nominal ones have .4 and more [-]
OTHER_SIGN = 0.1  # prior probability that k12 has not the described sign [-]
SIGMA_POINTS = 60
ROUGH_CAUSES = 2.0  # of what a description that does not hold gets wrong, whatever the number of
# modes: so many errors are independent; chosen on `model-error` and two runs of another code [-]


@dataclass(frozen=True, slots=True)
class Alternative:
    """One structure of several."""

    name: str
    """ "" for the description as it is; "flooded", "reduced blades", …"""
    probability: float
    """Prior [-]"""
    support: str = ""
    """What it says of tubes and water, whatever of the blades."""


_Fit = tuple[Alternative, JointFit]
_End = tuple[Alternative, JointFit, JointPeak]


@dataclass(frozen=True, slots=True, eq=False)
class WarmStart:
    """Where an alternative's last fit ended."""

    name: str
    """Of the alternative."""
    u: FloatArray
    """(n_dim,)"""
    relative_cost: float
    """Per degree of freedom"""
    tolerance: float = FINEST_TOLERANCE
    """Of the pairing in ln f [-]"""
    lost: bool = False
    """Whether it was hopelessly behind another."""

    def good_cost(self, wanted: float) -> float:
        """At which no further start is tried: where the structure is not the described one, no
        start ends below what is wanted, and the last window has tried them all."""
        return max(wanted, COST_GROWTH * self.relative_cost)


@dataclass(frozen=True, slots=True, eq=False)
class FittedAlternative:
    """An alternative with its peak and its share of the posterior."""

    alternative: Alternative
    fit: JointFit
    peak: JointPeak
    posterior: JointPosterior
    weight: float


@dataclass(frozen=True, slots=True, eq=False)
class JointResult:
    """The posterior over all alternatives; the likeliest first."""

    fitted: tuple[FittedAlternative, ...]
    lost: tuple[WarmStart, ...] = ()
    """Where the fits of the alternatives ended that are hopelessly behind: near there they begin
    when there is more evidence, at a tenth of what a search costs."""

    @property
    def starts(self) -> tuple[WarmStart, ...]:
        """Where the next fit of each alternative begins, the likeliest first."""
        fitted = (
            WarmStart(
                each.alternative.name,
                np.ascontiguousarray(each.peak.u),
                each.peak.relative_cost,
                each.fit.tolerance,
            )
            for each in self.fitted
        )
        return (*fitted, *self.lost)

    @property
    def best(self) -> FittedAlternative:
        """The alternative of the largest evidence."""
        return self.fitted[0]

    def draws(
        self, n: int, generator: np.random.Generator, *, widening: float
    ) -> tuple[FloatArray, FloatArray]:
        """(n, n_dim) points u and (n,) σ."""
        weights = np.array([each.weight for each in self.fitted])
        weights = np.where(weights >= LEAST_ALTERNATIVE_WEIGHT, weights, 0.0)
        counts = generator.multinomial(n, weights / weights.sum())
        parts = [
            each.posterior.draws(int(count), generator, widening=widening)
            for each, count in zip(self.fitted, counts, strict=True)
            if count
        ]
        order = generator.permutation(n)
        return (
            np.concatenate([u for u, _ in parts])[order],
            np.concatenate([sigma for _, sigma in parts])[order],
        )


class JointInference:
    """All alternatives of one turbine."""

    def __init__(
        self,
        fits: Sequence[tuple[Alternative, JointFit]],
        *,
        structure: TurbineDescription,
        layout: SensorLayout,
        prior: StructuralPrior,
        highest_sigma: float,
        other_sign: Callable[[str], JointFit] | None = None,
    ) -> None:
        """other_sign: alternative's name → its fit with k12 of the other sign; None: not asked."""
        self.fits = tuple(fits)
        self._other_sign = other_sign
        self.structure = structure
        self.layout = layout
        self.prior = prior
        self._highest_sigma = highest_sigma

    def with_springs(
        self, belief: Callable[[JointCoordinates], GaussianBelief]
    ) -> "JointInference":
        """The same with a prior of the springs, made for the coordinates."""
        return self.with_fits(lambda fit: fit.with_belief(belief(fit.coordinates)))

    def with_fits(self, change: Callable[[JointFit], JointFit]) -> "JointInference":
        """The same with every alternative's fit changed."""
        return self._of([(each, change(fit)) for each, fit in self.fits])

    def _of(self, fits: Sequence[tuple[Alternative, JointFit]]) -> "JointInference":
        return JointInference(
            fits,
            structure=self.structure,
            layout=self.layout,
            prior=self.prior,
            highest_sigma=self._highest_sigma,
            other_sign=self._other_sign,
        )

    def with_support_of(self, alternative: Alternative) -> "JointInference":
        """The same with only those alternatives whose tubes and water are like one's, or as
        described."""
        likely = (alternative.support, "")
        return self._of([(each, fit) for each, fit in self.fits if each.support in likely])

    def fit_of(self, name: str) -> JointFit:
        """The alternative of that name; the first where none has it."""
        return next((fit for each, fit in self.fits if each.name == name), self.fits[0][1])

    def result(
        self,
        evidence: ModalEvidence,
        *,
        level_std: float,
        starts: Mapping[str, WarmStart] | None = None,
        tolerance: float = FINEST_TOLERANCE,
    ) -> JointResult | None:
        """The joint posterior; None where no alternative can be compared with the evidence.

        Parameters
        ----------
        evidence : ModalEvidence
            Of all windows.
        level_std : float
            Of the water level in the evidence [m].
        starts : mapping of str to WarmStart, optional
            Alternative's name → where its last fit ended.
        tolerance : float, optional
            Of the pairing in ln f [-].
        """
        found = []
        fits = [
            (each, fit.with_level_std(level_std).with_tolerance(tolerance))
            for each, fit in (
                _of_unlike_supports(self.fits) if tolerance > FINEST_TOLERANCE else self.fits
            )
        ]
        peaks, lost = self._peaks(evidence, fits, starts or {})
        for alternative, fit, peak in peaks:
            found.append((alternative, fit, *self._with_discrepancy(fit, evidence, peak)))
        if not found:
            return None
        weights = self._weights(found, evidence)
        fitted = [
            FittedAlternative(alternative, fit, peak, posterior, weight)
            for (alternative, fit, peak, posterior), weight in zip(found, weights, strict=True)
        ]
        return JointResult(tuple(sorted(fitted, key=lambda each: -each.weight)), lost)

    def _peaks(
        self,
        evidence: ModalEvidence,
        fits: Sequence[_Fit],
        starts: Mapping[str, WarmStart],
    ) -> tuple[list[_End], tuple[WarmStart, ...]]:
        """Those of the alternatives that have not lost, with their peaks by the floors alone, and
        where the others ended."""
        warm = {each.name: starts[each.name] for each, _ in self.fits if each.name in starts}
        in_order = sorted(fits, key=lambda one: _has_lost(warm, one[0]))
        unlike = _of_unlike_supports(in_order)
        alike = [one for one in in_order if one not in unlike]
        found = _ends(unlike, evidence, warm)
        # blades of another mesh cannot help a structure that is another one
        if _least_cost(found) <= LARGEST_COST:
            found += _ends(alike, evidence, warm, beside=found)
            alike = []
        if self._has_the_other_sign(found, evidence):
            peaks = _not_lost(found)  # no start finds a valley of the described sign
        else:
            peaks = _improved(found, evidence, warm)
        if _least_cost(peaks) <= LARGEST_COST:  # further starts have found the valley
            ends = _ends(alike, evidence, warm, beside=found, start=peaks[0][2].u)
            peaks += _improved(ends, evidence, warm, known=peaks[0][2].u)
        kept = _not_lost(peaks)
        names = {each.name for each, *_ in kept}
        lost = tuple(
            WarmStart(
                each.name, np.ascontiguousarray(end.u), end.relative_cost, fit.tolerance, lost=True
            )
            for each, fit, end in found
            if each.name not in names
        )
        return kept, lost

    def _with_discrepancy(
        self, fit: JointFit, evidence: ModalEvidence, peak: JointPeak
    ) -> tuple[JointPeak, JointPosterior]:
        """Peak and posterior, fitted again with the discrepancy σ that the first fit shows."""
        posterior = self._posterior(peak, fit)
        sigma = posterior.likeliest_sigma
        if sigma > 0:
            again = fit.best(evidence, [peak.u], sigma=sigma, good_cost=np.inf)
            if again is not None:
                return again, self._posterior(again, fit)
        return peak, posterior

    def refitted(
        self, fitted: FittedAlternative, fit: JointFit, evidence: ModalEvidence, peak: JointPeak
    ) -> FittedAlternative:
        """An alternative with other priors and its peak there, alone."""
        peak, posterior = self._with_discrepancy(fit, evidence, peak)
        return FittedAlternative(fitted.alternative, fit, peak, posterior, 1.0)

    def weight_of_other_sign(self, best: FittedAlternative, evidence: ModalEvidence) -> float:
        """Posterior probability of springs of the other sign against the best alternative's [-]; 0
        where the data hold the described coupling."""
        mirrored = self.of_other_sign(best.alternative, best.fit, best.peak, evidence)
        if mirrored is None:
            return 0.0
        fit, end = mirrored
        described = replace(best.alternative, probability=1 - OTHER_SIGN)
        other = replace(best.alternative, probability=OTHER_SIGN)
        found = [
            (described, best.fit, best.peak, best.posterior),
            (other, fit, *self._with_discrepancy(fit, evidence, end)),
        ]
        return self._weights(found, evidence)[1]

    def _has_the_other_sign(self, ends: Sequence[_End], evidence: ModalEvidence) -> bool:
        """Whether no alternative is good, and the best one is with springs of the other sign."""
        best = min(ends, key=lambda one: one[2].excess, default=None)
        if best is None or best[2].relative_cost <= best[1].settings.good_cost:
            return False
        mirrored = self.of_other_sign(*best, evidence)
        return mirrored is not None and mirrored[1].relative_cost <= best[1].settings.good_cost

    def of_other_sign(
        self, alternative: Alternative, fit: JointFit, peak: JointPeak, evidence: ModalEvidence
    ) -> tuple[JointFit, JointPeak] | None:
        """An alternative with springs of the other sign, and where it ends; None where the data
        hold the described coupling, or nothing can be compared."""
        coordinates = fit.coordinates
        k11, k22, k12 = coordinates.springs(peak.u) / coordinates.nominal
        if self._other_sign is None or k12**2 >= LEAST_COUPLING * k11 * k22:
            return None
        mirrored = self._other_sign(alternative.name).with_level_std(coordinates.level_std)
        mirrored = mirrored.with_tolerance(fit.tolerance)
        end = mirrored.best(evidence, most_starts=FEW_STARTS)
        return None if end is None else (mirrored, end)

    def _posterior(self, peak: JointPeak, fit: JointFit) -> JointPosterior:
        return joint_posterior(
            peak,
            fit.coordinates,
            highest_sigma=self._highest_sigma,
            n_sigma=SIGMA_POINTS,
            common=modes_to_a_cause(fit, peak),
        )

    def _weights(
        self,
        found: Sequence[tuple[Alternative, JointFit, JointPeak, JointPosterior]],
        evidence: ModalEvidence,
    ) -> list[float]:
        sigma = min(posterior.likeliest_sigma for *_, posterior in found)
        dispersion = max(1.0, min(peak.relative_cost for _, _, peak, _ in found))
        logs = []
        for alternative, fit, peak, _ in found:
            cost, log_determinant = fit.judged(peak, evidence, sigma)
            prior = fit.coordinates.prior_cost(peak.u)
            if not fit.is_rough:
                cost = (cost - prior) / dispersion + prior
            cost -= peak.degrees
            log_likelihood = -0.5 * (cost + log_determinant) / modes_to_a_cause(fit, peak)
            logs.append(np.log(alternative.probability) + log_likelihood)
        weights = np.exp(np.array(logs) - max(logs))
        return [float(weight) for weight in weights / weights.sum()]


def _ends(
    fits: Sequence[_Fit],
    evidence: ModalEvidence,
    warm: Mapping[str, WarmStart],
    *,
    beside: Sequence[_End] = (),
    start: FloatArray | None = None,
) -> list[_End]:
    """Where each fit ends from few starts.

    beside   ends that are known
    start    (n_dim,) that is tried first by those without a warm one
    """
    found: list[_End] = []
    for each, fit in fits:
        last = warm.get(each.name)
        if last is None:
            known = [] if start is None else [start]
            end = fit.best(evidence, known, most_starts=FEW_STARTS)
        else:
            # what had lost cannot win where another holds: one descent tells that it still has
            holds = _least_cost([*beside, *found]) <= fit.settings.good_cost
            good = np.inf if holds and last.lost else last.good_cost(fit.settings.good_cost)
            end = fit.best(evidence, [last.u], good_cost=good, most_starts=FEW_STARTS)
        if end is not None:
            found.append((each, fit, end))
    return found


def _improved(
    ends: Sequence[_End],
    evidence: ModalEvidence,
    warm: Mapping[str, WarmStart],
    *,
    known: FloatArray | None = None,
) -> list[_End]:
    """Those that have not lost, the cheapest first, from further starts where they are no good.

    known   (n_dim,) the best peak of others: the valleys are of figures that all alternatives
            have, so that one searches for all; None: the first of these searches
    """
    peaks: list[_End] = []
    for each, fit, end in sorted(_not_lost(ends), key=lambda one: one[2].excess):
        good = warm[each.name].good_cost(fit.settings.good_cost) if each.name in warm else None
        if not fit.is_rough:  # a rough one's other valleys are no better
            best = peaks[0][2].u if known is None and peaks else known
            starts = None if best is None else [best]
            end = fit.improved(evidence, end, good_cost=good, starts=starts)
        peaks.append((each, fit, end))
    return peaks


def _least_cost(ends: Sequence[_End]) -> float:
    """Per degree of freedom; infinite of none."""
    return min((end.relative_cost for *_, end in ends), default=np.inf)


def _of_unlike_supports(fits: Sequence[_Fit]) -> list[_Fit]:
    """The first of each tubes and water: a description that is off by percents cannot tell blades
    whose frequencies differ by three tenths of one."""
    first: dict[str, _Fit] = {}
    for each, fit in fits:
        first.setdefault(each.support, (each, fit))
    return list(first.values())


def _has_lost(warm: Mapping[str, WarmStart], alternative: Alternative) -> bool:
    return alternative.name in warm and warm[alternative.name].lost


def _not_lost(peaks: Sequence[_End]) -> list[_End]:
    """Those whose cost is not hopelessly above the lowest, and that pair about as many modes.

    What a mode without a partner costs is bounded, and so is the cost of a structure that pairs
    next to nothing: of a tower of nine modes 54 above chance, less than `HOPELESS`, and without the
    determinant of modes that it leaves out it would outweigh a structure that explains all of them.
    """
    lowest = min((peak.excess for *_, peak in peaks), default=np.inf)
    most = max((peak.comparison.pairing.paired_share for *_, peak in peaks), default=0.0)
    return [
        (each, fit, peak)
        for each, fit, peak in peaks
        if peak.excess <= lowest + HOPELESS * modes_to_a_cause(fit, peak)
        and peak.comparison.pairing.paired_share >= LEAST_PAIRED * most
    ]


def modes_to_a_cause(fit: JointFit, peak: JointPeak) -> float:
    """Modes to each independent error of a rough model: its evidence counts that much less; 1 where
    the description holds."""
    return max(1.0, len(peak.comparison.used) / ROUGH_CAUSES) if fit.is_rough else 1.0
