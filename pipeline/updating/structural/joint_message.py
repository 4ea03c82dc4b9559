"""The posterior of an uncertain structure as it is published."""

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.special import ndtri

from pipeline.messages import (
    UNCERTAIN_STRUCTURE,
    FigureError,
    FigureShare,
    FoundationPosterior,
    ModalEstimate,
    ModePair,
    ParameterSummary,
    QualityWarning,
    RelativeStiffness,
    StructureAlternative,
)
from pipeline.updating.acceptance import (
    AcceptanceSettings,
    contraction,
    mode_information,
    reduced_chi_square,
    unidentified_springs,
    what_differs,
)
from pipeline.updating.likelihood.pairing import macs
from pipeline.updating.posterior_message import (
    largest_component_one,
    relative_stiffness,
    spring_summaries,
    thinned_draws,
)
from pipeline.updating.prior import PARAMETER_NAMES, Prior
from pipeline.updating.structural.joint_model import FINEST_TOLERANCE
from pipeline.updating.structural.posterior import figure_errors, systematic_errors
from pipeline.updating.structural.predictive_checks import UNPREDICTED
from pipeline.updating.structural.prior import N_SPRINGS
from pipeline.updating.structural.refresh import JointRefresh
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.components import RotorNacelle
from sensors.structure.figures import LEVEL
from sensors.structure.foundation import FoundationSprings

SAMPLER = "laplace"
WORTH_NAMING = 0.02  # share of a spring's variance from which a figure stands in the budget [-]
UNLABELLED = "?"
"""Label of a mode of the model that the description has no label for."""
LEAST_ALTERNATIVE = 1e-3  # probability from which an alternative is named [-]
NORMAL_90 = float(np.ptp(ndtri([0.05, 0.95])))  # width of the 90 % interval [std]
HALF_NORMAL_90 = float(np.ptp(ndtri([0.525, 0.975])))


def joint_message(
    estimate: ModalEstimate,
    found: JointRefresh,
    model: ModalModel,
    *,
    now: FloatArray,
    prior: Prior,
    guards: AcceptanceSettings,
    reference_ns: int,
) -> FoundationPosterior:
    """The posterior after one window.

    Parameters
    ----------
    estimate : ModalEstimate
        Of the window.
    found : JointRefresh
        The joint posterior after it.
    model : ModalModel
        With the figures at the peak, its modes followed from the springs there.
    now : ndarray, shape (n_draws, 4)
        Ratios of the springs in the estimate's window, and σ [-].
    prior : Prior
        Of the ratios.
    guards : AcceptanceSettings
        Thresholds of the quality warnings.
    reference_ns : int
        End of the reference period [ns].
    """
    best = found.best
    comparison = best.peak.comparison
    shown = model.modal(model.theta_reference)
    pairs = _pairs(found, model)
    parameters = spring_summaries(now, prior, best.fit.coordinates.spring_intervals())
    doubts = distrust(found, guards)
    return FoundationPosterior(
        turbine=estimate.turbine,
        window=estimate.window,
        time_ns=estimate.end_ns,
        n_windows=found.evidence.n_windows,
        parameters=parameters,
        correlation=np.asarray(np.corrcoef(now[:, :3].T)),
        draws=thinned_draws(now, prior),
        pairs=pairs,
        model_labels=tuple(model.labels),
        model_frequencies=shown.frequencies[0],
        model_shapes=largest_component_one(shown.shapes[0]),
        sampler=SAMPLER,
        ess=float(len(now)),
        rhat=float("nan"),
        autocorrelation_time=float("nan"),
        reduced_chi_square=reduced_chi_square(found.checks.frequency_misfits),
        paired_share=comparison.pairing.paired_share,
        pairing_cost=comparison.pairing.cost,
        trusted=not doubts,
        warnings=(
            *doubts,
            *_misfits(pairs, found),
            *unidentified_springs(parameters, guards),
            *_unstated_mass(best.fit.model.described.foundation),
            *_unstated_inertia(best.fit.model.described.rotor_nacelle),
        ),
        figures=_figures(found),
        structure=UNCERTAIN_STRUCTURE,
        budget=_budget(found),
        alternatives=_alternatives(found),
        unpredicted_share=found.checks.unpredicted_share,
        relative=_relative(found, reference_ns),
        figure_errors=_figure_errors(found),
    )


def distrust(found: JointRefresh, guards: AcceptanceSettings) -> tuple[QualityWarning, ...]:
    """Why the data contradict every structure that the priors allow; empty for a posterior that may
    be trusted."""
    doubts = []
    if found.fault is not None:
        use = "they are left out" if found.fault.left_out else "its shapes are read so"
        doubts.append(QualityWarning("sensor", f"{found.fault.text}: {use}"))
    if found.best.fit.is_rough:
        doubts.append(
            QualityWarning(
                "description-off",
                f"modes find their partners only within {found.best.fit.tolerance:.1%} in "
                f"frequency (usually {FINEST_TOLERANCE:.1%}): the structure is not the described "
                "one, and the intervals are those of a rough model",
            )
        )
    share = found.checks.unpredicted_share
    if share > guards.unpredicted_share:
        doubts.append(
            QualityWarning(
                "unpredicted",
                f"{share:.1%} of the modes are not what the others predict (at most "
                f"{guards.unpredicted_share:.0%} expected): the structure differs from the "
                "description by more than its figures",
            )
        )
    paired = found.best.peak.comparison.pairing.paired_share
    if paired < guards.paired_share:
        doubts.append(
            QualityWarning(
                "few-pairs",
                f"only {paired:.0%} of the identified modes are modes of the model (at least "
                f"{guards.paired_share:.0%} expected)",
            )
        )
    unlike = found.best.peak.comparison.unlike_share
    if unlike > guards.unlike_share:
        doubts.append(
            QualityWarning(
                "shapes-unlike",
                f"{unlike:.0%} of the mode shapes that could be compared are not those of the "
                f"model (at most {guards.unlike_share:.0%} expected), so only frequencies enter: "
                "are the layout's directions, heights and channels right?",
            )
        )
    if found.other_sign > guards.other_sign:
        doubts.append(
            QualityWarning(
                "springs-sign",
                f"k12 of the other sign explains the modes better (probability "
                f"{found.other_sign:.0%}): the description has [foundation] sign = "
                f'"{found.best.fit.model.described.foundation.sign}"',
            )
        )
    doubts += [
        QualityWarning(
            "figure-outside-prior",
            f"{each.name} lies {'above' if each.deviations > 0 else 'below'} the description, "
            f"{abs(each.deviations):.1f} times as far as its prior lets it be moved",
        )
        for each in found.conflicts
        if abs(each.deviations) > guards.figure_deviation
    ]
    return tuple(doubts)


def _misfits(pairs: tuple[ModePair, ...], found: JointRefresh) -> tuple[QualityWarning, ...]:
    """One sentence for each mode that the others do not predict."""
    return tuple(
        QualityWarning(
            "mode-misfit",
            f"mode {pair.identified or '?'} at {pair.frequency:.4g} Hz, taken for "
            f"{_named(pair.model)}, is not what the other modes predict ({what_differs(pair)}): it "
            "counts little",
        )
        for pair, p in zip(pairs, found.checks.p_values, strict=True)
        if p < UNPREDICTED
    )


def _unstated_mass(foundation: FoundationSprings) -> tuple[QualityWarning, ...]:
    """Of a pile: springs have no mass, and nothing says whether the pile's is to be counted."""
    if foundation.sign != "embedded-pile" or foundation.moving_mass is not None:
        return ()
    return (
        QualityWarning(
            "pile-mass",
            "the description states no moving_mass under [foundation]: a real pile's mass makes "
            "these springs too low (0: the foundation has none)",
        ),
    )


def _unstated_inertia(top: RotorNacelle) -> tuple[QualityWarning, ...]:
    """Of a nacelle as a point mass: without moments of inertia none is inferred."""
    if top.has_inertia or not any(body.mass for body in top.bodies):
        return ()
    return (
        QualityWarning(
            "nacelle-inertia",
            "the description states no inertia under [[rotor_nacelle.bodies]]: modes that turn the "
            "tower's top are off, for which a sensor may be named",
        ),
    )


def _named(label: str) -> str:
    """A mode of the model in words."""
    return "a mode that the description has not" if label == UNLABELLED else f"the model's {label}"


def _pairs(found: JointRefresh, model: ModalModel) -> tuple[ModePair, ...]:
    comparison, evidence = found.best.peak.comparison, found.evidence
    labels = mode_labels(found, model)
    modes = comparison.linearisation
    mac = macs(found.best.fit.targets(evidence), modes.shapes[None])[0]
    D = comparison.variances + comparison.floors
    information = mode_information(
        comparison.jacobian[:, :N_SPRINGS],
        comparison.robust_weights(D) / D,
        comparison.groups.tolist(),
    )
    return tuple(
        ModePair(
            identified=evidence.modes[each.identified].name,
            model=labels[each.model_modes[0]],
            frequency=evidence.modes[each.identified].frequency,
            frequency_std=evidence.modes[each.identified].frequency_std,
            model_frequency=float(modes.frequencies[each.model_modes[0]]),
            mac=float(mac[each.identified, each.model_modes[0]]),
            shape_used=each.shape_used,
            misfit=float(found.checks.frequency_misfits[number]),
            information=float(information[number]),
        )
        for number, each in enumerate(comparison.used)
    )


def mode_labels(found: JointRefresh, model: ModalModel) -> tuple[str, ...]:
    """The description's labels of the fit's modes; UNLABELLED for one that it has none for."""
    modes = found.best.peak.comparison.linearisation
    shown = model.modal(model.theta_reference)
    logs, shapes = np.log(shown.frequencies[0]), shown.shapes[0]
    products = (modes.shapes @ shapes.T) ** 2
    norms = np.outer((modes.shapes**2).sum(axis=1), (shapes**2).sum(axis=1))
    cost = ((np.log(modes.frequencies)[:, None] - logs) / 0.01) ** 2
    cost = np.minimum(cost + ((1 - products / norms) / 0.15) ** 2, 1e3)
    rows, columns = linear_sum_assignment(np.nan_to_num(cost, nan=1e3))
    labels = [UNLABELLED] * len(modes.frequencies)
    for row, column in zip(rows.tolist(), columns.tolist(), strict=True):
        if cost[row, column] < 9.0:
            labels[row] = model.labels[column]
    return tuple(labels)


def _figures(found: JointRefresh) -> tuple[ParameterSummary, ...]:
    """Figures as factors to the described value or in their unit, the level, then the sensors."""
    coordinates = found.best.fit.coordinates
    summaries = []
    departures = coordinates.departures(found.u)
    for figure, values in zip(coordinates.figures, departures.T, strict=True):
        relative = figure.definition.unit == "-"
        before = (HALF_NORMAL_90 if figure.half_normal else NORMAL_90) * figure.std
        unit = figure.definition.unit
        summaries.append(_summary(figure.name, unit, values + relative, float(relative), before))
    if coordinates.level_std > 0:
        before = NORMAL_90 * coordinates.level_std
        summaries.append(_summary(LEVEL, "m", coordinates.level(found.u), 0.0, before))
    sensors = coordinates.sensors(found.u)
    for sensor, values in zip(found.best.fit.sensors.figures, sensors.T, strict=True):
        before = NORMAL_90 * sensor.std
        summaries.append(_summary(sensor.name, sensor.unit, values * sensor.std, 0.0, before))
    return tuple(summaries)


def _summary(
    name: str, unit: str, values: FloatArray, nominal: float, before: float
) -> ParameterSummary:
    low, median, high = np.quantile(values, [0.05, 0.5, 0.95]).tolist()
    return ParameterSummary(
        name=name,
        unit=unit,
        nominal=nominal,
        median=median,
        p05=low,
        p95=high,
        contraction=contraction(high - low, before / 0.9),
    )


def _budget(found: JointRefresh) -> tuple[FigureShare, ...]:
    """Figures that matter, the largest first; the rest are summed as "other figures"."""
    budget = found.budget
    shares = [
        FigureShare(name, *row)
        for name, row in zip(budget.names, budget.shares.tolist(), strict=True)
    ]
    large = [each for each in shares if max(each.k11, each.k22, each.k12) >= WORTH_NAMING]
    large.sort(key=lambda each: -max(each.k11, each.k22, each.k12))
    rest = [each for each in shares if each not in large]
    others = FigureShare(
        "other figures",
        *(sum(getattr(each, name) for each in rest) for name in PARAMETER_NAMES),
    )
    return (*large, others)


def _figure_errors(found: JointRefresh) -> tuple[FigureError, ...]:
    """Of the figures and the level, then of what identification and mesh do to all turbines."""
    best = found.best
    coordinates = best.fit.coordinates
    figures = figure_errors(best.peak.u, best.posterior.covariance, coordinates)
    systematic = systematic_errors(best.peak, best.posterior, coordinates)
    names = [*(figure.name for figure in coordinates.figures), LEVEL]
    names += [f"systematic {name}" for name in PARAMETER_NAMES]
    rows = np.vstack([figures, systematic])
    return tuple(FigureError(name, *row) for name, row in zip(names, rows.tolist(), strict=True))


def _alternatives(found: JointRefresh) -> tuple[StructureAlternative, ...]:
    return tuple(
        StructureAlternative(each.alternative.name, each.weight)
        for each in found.result.fitted
        if each.weight >= LEAST_ALTERNATIVE
    )


def _relative(found: JointRefresh, reference_ns: int) -> tuple[RelativeStiffness, ...]:
    if found.relative is None:
        return ()
    stds = np.sqrt(np.diag(found.relative.covariance))
    return relative_stiffness(found.relative.mean, stds, reference_ns)
