"""One refresh of an uncertain structure: evidence in, joint posterior and its checks out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import QualityWarning
from pipeline.updating.acceptance import AcceptanceSettings, refusal
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.alternatives import (
    FittedAlternative,
    JointInference,
    JointResult,
    WarmStart,
    modes_to_a_cause,
)
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.joint_model import FINEST_TOLERANCE, JointPeak
from pipeline.updating.structural.periods.relative_change import RelativeSprings, relative_springs
from pipeline.updating.structural.posterior import ErrorBudget, error_budget
from pipeline.updating.structural.predictive_checks import (
    FigureConflict,
    HeldOutChecks,
    figure_conflicts,
    held_out_checks,
)
from pipeline.updating.structural.sensors.blamed_sensor import blamed_sensor
from pipeline.updating.structural.sensors.faults import (
    LEAST_DROP,
    LOST_PAIRS,
    SUSPICIOUS_COST,
    SensorFault,
    fault_named,
    fault_of_sensor,
    likely_wirings,
    sensor_fault,
    still_explained,
    suspicious,
    turned_by,
)
from pipeline.updating.structural.sensors.turned_layouts import likely_angles
from pipeline.updating.structural.water_level import at_model_level, pairing_rise
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel

N_DRAWS = 4000
WIDENING = 1.0  # of the joint Gaussian; 1: on tuning seeds its intervals held .97 at 1.05 [-]
# Of the pairing in ln f, in turn: where the description is off by more than its figures explain,
# modes find their partners only within a wider one. The discrepancy that they show then widens the
# intervals, and the checks say that the description does not hold [-]
TOLERANCES = (FINEST_TOLERANCE, 0.015, 0.03)
LEVEL_ROUNDS = 2  # of taking the known water levels out of the windows
LEVEL_SETTLED = 5e-5  # change of a frequency at which no round follows, a tenth of its floor [-]
SEARCH_GROWTH = 1.25  # of the windows, at which faults are looked for again after none explained
# the evidence: the search costs several times what the rest of a refresh does [-]


@dataclass(frozen=True, slots=True, eq=False)
class JointRefresh:
    """What the evidence reports of springs and figures."""

    result: JointResult
    evidence: ModalEvidence
    """At the model's water level."""
    u: FloatArray
    """(n_draws, n_dim) draws"""
    draws: FloatArray
    """(n_draws, 4) ratios k / nominal and σ [-]"""
    checks: HeldOutChecks
    conflicts: tuple[FigureConflict, ...]
    budget: ErrorBudget
    relative: RelativeSprings | None
    """To the reference period; None without one."""
    fault: SensorFault | None
    """A sensor that is not as its layout states; the posterior takes it into account."""
    refusal: QualityWarning | None = None
    """Why these modes are not this structure's, at any tolerance."""
    other_sign: float = 0.0
    """Probability that k12 has not the described sign [-]; 0 where the coupling is not in doubt."""
    searched_windows: int = 0
    """In the evidence when faults of sensors were last looked for in vain; 0: they explain it, or
    nothing calls for one."""

    @property
    def best(self) -> FittedAlternative:
        """The alternative of the largest evidence."""
        return self.result.best

    @property
    def warm_starts(self) -> tuple[WarmStart, ...]:
        """Where the next refresh begins."""
        tolerance = self._tolerance_needed
        return tuple(replace(each, tolerance=tolerance) for each in self.result.starts)

    @property
    def _tolerance_needed(self) -> float:
        """The finest again where every mode has its partner within three of it."""
        found = self.best.peak.comparison
        largest = float(np.abs(found.errors[found.is_frequency]).max())
        return FINEST_TOLERANCE if largest < 3 * FINEST_TOLERANCE else self.best.fit.tolerance


def joint_refresh(
    inference: JointInference,
    measured: ModalEvidence,
    warm: Sequence[WarmStart],
    generator: np.random.Generator,
    *,
    guards: AcceptanceSettings | None = None,
    reference: ModalEvidence | None = None,
    last_fault: str = "",
    searched_windows: int = 0,
) -> JointRefresh | None:
    """The joint posterior; None where no mode can be compared with any structure.

    Parameters
    ----------
    inference : JointInference
        Of the turbine.
    measured : ModalEvidence
        With the windows' water levels in it.
    warm : sequence of WarmStart
        Of the last refresh.
    generator : numpy.random.Generator
        That the posterior is drawn with.
    guards : AcceptanceSettings, optional
        Thresholds beyond which the modes are not this structure's.
    reference : ModalEvidence, optional
        Evidence of a period to compare with.
    last_fault : str, optional
        Name of the sensor's fault that the last refresh found.
    searched_windows : int, optional
        In the evidence when faults were last looked for in vain.
    """
    guards = guards or AcceptanceSettings()
    level_std = _level_std(inference, measured)
    searches = not searched_windows <= measured.n_windows < SEARCH_GROWTH * searched_windows
    tried = _tried(inference, measured, warm, guards, last_fault, searches=searches)
    if tried is None:
        return None
    in_vain = tried.fault is None and tried.calls_for_a_fault(guards)
    result, evidence, best = tried.result, tried.evidence, tried.result.best
    coordinates = best.fit.coordinates
    u, sigma = result.draws(N_DRAWS, generator, widening=WIDENING)
    covariance = best.posterior.covariance
    relative = None
    if reference is not None:
        if tried.fault is not None:
            reference = tried.fault.corrected(reference)
        relative = relative_springs(
            best.fit.with_level_std(max(level_std, _level_std(inference, reference))),
            at_model_level(reference, best.fit, best.peak.u)
            if reference.level_varied
            else reference,
            evidence,
            best.peak.u,
            sigma=best.posterior.likeliest_sigma,
            causes=modes_to_a_cause(best.fit, best.peak),
        )
    return JointRefresh(
        result=result,
        evidence=evidence,
        u=u,
        draws=np.column_stack([coordinates.springs(u) / coordinates.nominal, sigma]),
        checks=held_out_checks(best.peak, coordinates),
        conflicts=figure_conflicts(best.posterior.mean, covariance, coordinates),
        budget=error_budget(best.peak.u, covariance, coordinates),
        relative=relative,
        fault=tried.fault,
        refusal=tried.refusal(guards),
        other_sign=inference.weight_of_other_sign(best, evidence),
        searched_windows=(
            0 if not in_vain else measured.n_windows if searches else searched_windows
        ),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Attempt:
    """What one tolerance of the pairing makes of the evidence."""

    result: JointResult
    evidence: ModalEvidence
    """At the model's water level."""
    fault: SensorFault | None = None

    @property
    def paired_share(self) -> float:
        """Of the identified modes [-]"""
        return self.result.best.peak.comparison.pairing.paired_share

    @property
    def suspicious(self) -> bool:
        """Whether a fault of one sensor may be behind it."""
        return suspicious(self.result.best.fit, self.result.best.peak)

    def fits_nothing(self, guards: AcceptanceSettings) -> bool:
        """Whether modes find no partners: only wrong cables or another description explain it."""
        return self.result.best.fit.is_rough or self.refusal(guards) is not None

    def calls_for_a_fault(self, guards: AcceptanceSettings) -> bool:
        """Whether something is wrong that a sensor's fault may explain."""
        return self.suspicious or self.fits_nothing(guards)

    def refusal(self, guards: AcceptanceSettings) -> QualityWarning | None:
        """Why the modes are not this structure's."""
        cost = self.result.best.peak.comparison.pairing.cost
        return refusal(self.paired_share, cost, guards)

    def rank(self, guards: AcceptanceSettings) -> tuple[bool, float]:
        """Of attempts that pair too few modes: an answer before a refusal, then who pairs most."""
        return self.refusal(guards) is None, self.paired_share


def _tried(
    inference: JointInference,
    measured: ModalEvidence,
    warm: Sequence[WarmStart],
    guards: AcceptanceSettings,
    last_fault: str,
    *,
    searches: bool,
) -> _Attempt | None:
    """The narrowest tolerance at which enough modes have a partner, or a fault of the sensors says
    why not; else the one at which most have; None where nothing can be compared.

    searches   whether faults are looked for beside the one that the last refresh found
    """
    level_std = _level_std(inference, measured)
    known = _with_fault_named(inference, measured, warm, level_std=level_std, name=last_fault)
    if known is not None and known.paired_share >= guards.paired_share:
        return known
    first = min((each.tolerance for each in warm), default=FINEST_TOLERANCE)
    most: _Attempt | None = None
    for tolerance in (each for each in TOLERANCES if each >= first):
        fitted = _fitted(inference, measured, warm, level_std=level_std, tolerance=tolerance)
        if fitted is None:
            continue
        attempt = _Attempt(*fitted)
        if searches and attempt.calls_for_a_fault(guards):
            attempt = _with_a_fault(
                inference, measured, attempt, guards, level_std=level_std, last=last_fault
            )
            searches = False
        if attempt.fault is not None or attempt.paired_share >= guards.paired_share:
            return attempt
        if most is None or attempt.rank(guards) > most.rank(guards):
            most = attempt
    return most


def _with_fault_named(
    inference: JointInference,
    measured: ModalEvidence,
    warm: Sequence[WarmStart],
    *,
    level_std: float,
    name: str,
    size: float = 0.0,
) -> _Attempt | None:
    """The result with the fault of that name, if it explains the evidence.

    size   of a sensor's figure, where no last fit has it [prior standard deviations]
    """
    fault = fault_named(name, inference.fits[0][1])
    if fault is None:
        return None
    corrected = fault.corrected(measured)
    if fault.places and warm:
        size = fault.size(warm[0].u)

    def allowing(fit: JointFit) -> JointFit:
        same = fault_named(name, fit, size=size)
        return fit if same is None else same.fit

    fitted = _fitted(
        inference.with_fits(allowing),
        corrected,
        warm,
        level_std=level_std,
        tolerance=FINEST_TOLERANCE,
    )
    if fitted is None:
        return None
    result, evidence = fitted
    best = result.best
    as_stated = inference.fit_of(best.alternative.name).with_level_std(level_std)
    fault = replace(fault, fit=best.fit)
    if fault.left_out:
        as_it_came = at_model_level(measured, best.fit, best.peak.u)
    else:
        as_it_came = fault.undone(evidence)
    sized = still_explained(fault, as_stated, as_it_came, best.peak)
    return None if sized is None else _Attempt(result, evidence, sized)


def _fitted(
    inference: JointInference,
    measured: ModalEvidence,
    warm: Sequence[WarmStart],
    *,
    level_std: float,
    tolerance: float,
) -> tuple[JointResult, ModalEvidence] | None:
    """The result, and the evidence as if every window had had the model's water level.

    The windows' water is taken out at the last peak at once, and again at the new one until that
    moves no frequency. Without a last peak, windows whose mean level is far from the model's are
    fitted at that level first: paired with the model's own water, modes take their neighbours.
    """
    evidence, rise = measured, pairing_rise(measured)
    starts = {each.name: each for each in warm}
    if measured.level_varied and warm:
        last = inference.fit_of(warm[0].name).with_level_std(level_std).with_tolerance(tolerance)
        evidence = at_model_level(measured, last, warm[0].u)
    elif rise:
        there = inference.with_fits(lambda fit: fit.with_rise(rise))
        first = there.result(measured, level_std=level_std, tolerance=tolerance)
        if first is not None:
            evidence = at_model_level(measured, first.best.fit.with_rise(0.0), first.best.peak.u)
            starts = {each.name: each for each in first.starts}
    result = inference.result(evidence, level_std=level_std, starts=starts, tolerance=tolerance)
    if result is None:
        return None
    for _ in range(LEVEL_ROUNDS if measured.level_varied else 0):
        again = at_model_level(measured, result.best.fit, result.best.peak.u)
        if _farthest(again, evidence) < LEVEL_SETTLED:
            break
        evidence, starts = again, {each.name: each for each in result.starts}
        result = (
            inference.result(evidence, level_std=level_std, starts=starts, tolerance=tolerance)
            or result
        )
    return result, evidence


def _farthest(evidence: ModalEvidence, other: ModalEvidence) -> float:
    """Largest relative difference of the same modes' frequencies [-]."""
    frequencies = ([mode.frequency for mode in each.modes] for each in (evidence, other))
    return float(np.abs(np.subtract(*map(np.log, frequencies))).max(initial=0.0))


def _with_a_fault(
    inference: JointInference,
    measured: ModalEvidence,
    attempt: _Attempt,
    guards: AcceptanceSettings,
    *,
    level_std: float,
    last: str,
) -> _Attempt:
    """The attempt with the fault of a sensor that explains most; as it was for none.

    First all sensors turned alike and wrong cables, which no fit is needed to tell; then one sensor
    without which the others fit; then what fits best from the peak. Where springs of the other sign
    explain the sensors as they are, no single one is looked for.
    """
    fine = attempt.result.best.fit.with_tolerance(FINEST_TOLERANCE)
    angles = likely_angles(fine, attempt.evidence, attempt.result.best.peak)
    likely = [(fault.name, size) for fault, size in turned_by(fine, angles)]
    likely += [(fault.name, 0.0) for fault in likely_wirings(fine, attempt.evidence)]
    found = _with_likely_fault(inference, measured, attempt, likely, level_std=level_std)
    if found.fault is not None:
        return found
    best = attempt.result.best
    mirrored = inference.of_other_sign(best.alternative, best.fit, best.peak, attempt.evidence)
    if mirrored is not None and not suspicious(*mirrored):
        return found
    found = _with_blamed_sensor(inference, measured, attempt, level_std=level_std)
    if found.fault is None and not attempt.fits_nothing(guards):
        found = _with_sensor_fault(inference, measured, attempt, level_std=level_std, last=last)
    return found


def _with_blamed_sensor(
    inference: JointInference, measured: ModalEvidence, attempt: _Attempt, *, level_std: float
) -> _Attempt:
    """The attempt with what is wrong with the sensor without which the others fit; as it was where
    they fit without none.

    Tubes and water as described are tried first: which fitted the shapes of a wrong sensor best
    tells nothing.
    """
    best, evidence = attempt.result.best, attempt.evidence
    for support in dict.fromkeys(("", best.alternative.support)):
        alike = next((fit for each, fit in inference.fits if each.support == support), best.fit)
        fit = alike.with_level_std(level_std).with_tolerance(FINEST_TOLERANCE)
        blamed = blamed_sensor(fit, evidence, best.peak)
        if blamed is None or blamed[1].misfit > best.peak.misfit - LEAST_DROP:
            continue
        fault, peak = fault_of_sensor(fit, evidence, *blamed)
        warm = _warm(inference, peak, support=support)
        anew = _with_fault_named(inference, measured, warm, level_std=level_std, name=fault.name)
        if anew is not None:
            return anew
    return attempt


def _warm(inference: JointInference, peak: JointPeak, *, support: str) -> list[WarmStart]:
    """Starts of all alternatives at the peak of one with a fault; those of other tubes and water
    count as lost until a descent tells otherwise."""
    return [
        WarmStart(each.name, peak.u, peak.relative_cost, lost=each.support != support)
        for each, _ in inference.fits
    ]


def _with_likely_fault(
    inference: JointInference,
    measured: ModalEvidence,
    attempt: _Attempt,
    faults: Sequence[tuple[str, float]],
    *,
    level_std: float,
) -> _Attempt:
    """The attempt with the first of some faults that explains the evidence, else with that which
    explains most; as it was for none.

    The blades' alternatives are fitted anew with each, since which was best with wrong shapes tells
    nothing; those of tubes and water that are neither described nor likeliest without a fault only
    with the fault that is taken.

    faults   names, and sizes in prior standard deviations
    """
    best: _Attempt | None = None
    alike = inference.with_support_of(attempt.result.best.alternative)
    for name, size in faults:
        found = _with_fault_named(alike, measured, (), level_std=level_std, name=name, size=size)
        if found is None or found.paired_share <= attempt.paired_share - LOST_PAIRS:
            continue
        if best is None or found.result.best.peak.misfit < best.result.best.peak.misfit:
            best = found
        if best.result.best.peak.relative_cost <= SUSPICIOUS_COST:
            break
    if best is None or best.fault is None:
        return attempt
    starts = best.result.starts
    name, size = best.fault.name, best.fault.size(best.result.best.peak.u)
    every = _with_fault_named(
        inference, measured, starts, level_std=level_std, name=name, size=size
    )
    return every or best


def _with_sensor_fault(
    inference: JointInference,
    measured: ModalEvidence,
    attempt: _Attempt,
    *,
    level_std: float,
    last: str,
) -> _Attempt:
    """The attempt with the likeliest fault of a sensor taken into account; as it was for none.

    A fault that changes shapes by much may have led to a wrong structure and a wrong valley: every
    alternative is fitted anew from where the fault was found.
    """
    best, evidence = attempt.result.best, attempt.evidence
    peak = best.fit.settled(evidence, best.peak.u) or best.peak  # by the floors alone
    found = sensor_fault(best.fit, evidence, peak, last=last)
    if found is None:
        return attempt
    fault, peak = found
    warm = _warm(inference, peak, support=best.alternative.support)
    anew = _with_fault_named(inference, measured, warm, level_std=level_std, name=fault.name)
    return anew or _with_fault(inference, attempt, fault, peak)


def _with_fault(
    inference: JointInference, attempt: _Attempt, fault: SensorFault, peak: JointPeak
) -> _Attempt:
    corrected = fault.corrected(attempt.evidence)
    fitted = inference.refitted(attempt.result.best, fault.fit, corrected, peak)
    return _Attempt(JointResult((fitted,)), corrected, fault)


def _level_std(inference: JointInference, evidence: ModalEvidence) -> float:
    """Of the water level that all windows have in common [m]: an error of the gauge is the same in
    every window, and a tide that nothing reports is counted as if it were."""
    prior, unknown = inference.prior, evidence.unknown_level_share
    return float(np.hypot(prior.known_level_std, unknown * prior.unknown_level_std))


def model_at(fit: JointFit, u: FloatArray, layout: SensorLayout) -> ModalModel:
    """The structure with the figures of a point, its modes followed from the springs there."""
    return ModalModel(fit.structure_at(u), layout).following(fit.coordinates.springs(u))
