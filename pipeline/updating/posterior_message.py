"""The posterior as it is published: quantiles, pairs, checks of every mode, and the warnings."""

from dataclasses import dataclass

import numpy as np

from pipeline.messages import (
    HALF_INTERVAL,
    FoundationPosterior,
    ModalEstimate,
    ModePair,
    ParameterSummary,
    RelativeStiffness,
)
from pipeline.updating.acceptance import (
    AcceptanceSettings,
    Fit,
    contraction,
    contradictions,
    misfit_warnings,
    mode_information,
    predictive_misfits,
    reduced_chi_square,
    unconverged,
    unidentified_springs,
)
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.forward_model import ModesOfStiffness
from pipeline.updating.likelihood.pairing import DIFFERENCE, PairingTargets, macs
from pipeline.updating.model_matching import Match
from pipeline.updating.prior import PARAMETER_NAMES, PARAMETER_UNITS, Prior
from pipeline.updating.samplers.interface import PosteriorDraws
from sensors.arrays import FloatArray

CHECKED_DRAWS = 50  # of the posterior, for its predictions of each mode
MOST_DRAWS = 1000  # in a FoundationPosterior


def posterior_message(
    estimate: ModalEstimate,
    match: Match,
    draws: PosteriorDraws,
    median: FloatArray,
    *,
    now: FloatArray,
    prior: Prior,
    guards: AcceptanceSettings,
) -> FoundationPosterior:
    """The posterior after one window.

    Parameters
    ----------
    estimate : ModalEstimate
        Of the window that was the last to enter the evidence.
    match : Match
        Pairing and likelihood of all windows.
    draws : PosteriorDraws
        Of the stiffness that all windows have in common, with which their modes are compared.
    median : ndarray, shape (3,)
        Ratios of the same, at which the model's modes are shown; uncertain figures follow [-].
    now : ndarray, shape (n_draws, 4)
        Draws of the stiffness in the estimate's window: what is published [-].
    prior : Prior
        Of the ratios.
    guards : AcceptanceSettings
        Thresholds of the quality warnings.
    """
    evidence = match.evidence
    modes = match.all_modes.modal(prior.stiffness(median[None]))
    fit = _fit(match, prior.stiffness(median[None]))
    parameters = spring_summaries(now, prior)
    pairs = _pairs(evidence, match, modes, _mode_check(match, prior, draws))
    against = contradictions(fit, guards)
    return FoundationPosterior(
        turbine=estimate.turbine,
        window=estimate.window,
        time_ns=estimate.end_ns,
        n_windows=evidence.n_windows,
        parameters=parameters,
        correlation=np.asarray(np.corrcoef(now[:, :3].T)),
        draws=thinned_draws(now, prior),
        pairs=pairs,
        model_labels=tuple(match.all_modes.labels),
        model_frequencies=modes.frequencies[0],
        model_shapes=largest_component_one(modes.shapes[0]),
        sampler=draws.sampler,
        ess=draws.ess,
        rhat=draws.rhat,
        autocorrelation_time=draws.autocorrelation_time,
        reduced_chi_square=fit.reduced_chi_square,
        paired_share=fit.paired_share,
        pairing_cost=fit.pairing_cost,
        trusted=not against and not unconverged(draws.warnings),
        warnings=(
            *against,
            *draws.warnings,
            *misfit_warnings(pairs, guards),
            *unidentified_springs(parameters, guards),
        ),
    )


def _fit(match: Match, theta: FloatArray) -> Fit:
    """How well the model fits at theta, (1, 3)."""
    return Fit(
        reduced_chi_square=reduced_chi_square(_misfits(match, theta)),
        paired_share=match.pairing.paired_share,
        pairing_cost=match.pairing.cost,
    )


def relative_stiffness(
    logs: FloatArray, stds: FloatArray, reference_ns: int
) -> tuple[RelativeStiffness, ...]:
    """Springs over those of a reference period, from ln of the ratios and their deviations.

    Parameters
    ----------
    logs : ndarray, shape (3,)
        ln of the ratios [-].
    stds : ndarray, shape (3,)
        Their standard deviations [-].
    reference_ns : int
        End of the reference period [ns].
    """
    ends = np.exp(logs[:, None] + stds[:, None] * HALF_INTERVAL * np.array([-1.0, 0.0, 1.0]))
    return tuple(
        RelativeStiffness(name, float(median), float(low), float(high), reference_ns)
        for name, (low, median, high) in zip(PARAMETER_NAMES, ends, strict=True)
    )


def spring_summaries(
    drawn: FloatArray, prior: Prior, log_intervals: FloatArray | None = None
) -> tuple[ParameterSummary, ...]:
    """Quantiles of every draw, k in its own unit.

    Parameters
    ----------
    drawn : ndarray, shape (n_draws, 4)
        Ratios k / nominal, and σ [-].
    prior : Prior
        With the nominal springs.
    log_intervals : ndarray, shape (3,), optional
        Widths of 90 % intervals of ln |k| beforehand, where the springs are known to a factor [-];
        None: known within the prior's box.
    """
    values = drawn * np.append(prior.nominal, 1.0)
    bounds = prior.settings
    quantiles = np.sort(np.quantile(values, [0.05, 0.5, 0.95], axis=0), axis=0)
    low, _, high = quantiles
    widths = (high - low) / np.abs(np.append(prior.nominal, 1.0))
    box = bounds.highest_ratio - bounds.lowest_ratio
    extents = np.array([box, box, box, bounds.highest_sigma])
    if log_intervals is not None:
        widths[:3] = np.abs(np.log(high[:3] / low[:3]))
        extents[:3] = log_intervals / 0.9
    return tuple(
        ParameterSummary(
            name=name,
            unit=unit,
            nominal=float(nominal),
            median=float(median),
            p05=float(low),
            p95=float(high),
            contraction=contraction(width, extent),
        )
        for name, unit, nominal, width, extent, (low, median, high) in zip(
            (*PARAMETER_NAMES, "sigma"),
            (*PARAMETER_UNITS, "-"),
            (*prior.nominal, 1.0),
            widths.tolist(),
            extents.tolist(),
            quantiles.T,
            strict=True,
        )
    )


def thinned_draws(flat: FloatArray, prior: Prior) -> FloatArray:
    """(n <= 1000, 4) draws spread evenly over all, k in their units."""
    chosen = np.linspace(0, len(flat) - 1, min(MOST_DRAWS, len(flat))).round().astype(int)
    return flat[chosen] * np.append(prior.nominal, 1.0)


def _misfits(match: Match, theta: FloatArray) -> FloatArray:
    """(n_observations,) model minus identified frequency at theta, (1, 3), in standard deviations
    at σ = 0; floor and neighbours' gaps included."""
    rows = match.likelihood.frequency_components
    errors = match.likelihood.errors(match.forward.modal(theta))[0, rows]
    return np.asarray(errors / np.sqrt(np.diag(match.likelihood.measurement_covariance)[rows]))


def _pairs(
    evidence: ModalEvidence, match: Match, modes: ModesOfStiffness, check: "_ModeCheck"
) -> tuple[ModePair, ...]:
    mac = macs(PairingTargets.of(evidence.modes, evidence.n_windows), modes.shapes)[0]
    return tuple(
        ModePair(
            identified=evidence.modes[each.identified].name,
            model=match.all_modes.labels[each.model_modes[0]],
            frequency=evidence.modes[each.identified].frequency,
            frequency_std=evidence.modes[each.identified].frequency_std,
            model_frequency=float(modes.frequencies[0, each.model_modes[0]]),
            mac=float(mac[each.identified, each.model_modes[0]]),
            shape_used=each.shape_used,
            misfit=float(check.misfits[number]),
            information=float(check.information[number]),
        )
        for number, each in enumerate(match.used)
    )


@dataclass(frozen=True, slots=True, eq=False)
class _ModeCheck:
    """What each observation contributes, and how badly it fits."""

    misfits: FloatArray  # (n_observations,) posterior predictive [standard deviations]
    information: FloatArray  # (n_observations,) share


def _mode_check(match: Match, prior: Prior, draws: PosteriorDraws) -> _ModeCheck:
    flat = draws.flat[np.linspace(0, len(draws.flat) - 1, CHECKED_DRAWS).round().astype(int)]
    rows = match.likelihood.frequency_components
    points, sigma = flat[:, :-1], flat[:, -1]
    modes = match.forward.modal(prior.stiffness(points))
    variances = np.diag(match.likelihood.measurement_covariance)[rows]
    misfits = predictive_misfits(
        match.likelihood.errors(modes)[:, rows],
        variances,
        np.outer(sigma**2, match.likelihood.reference[rows]),
    )
    steps = DIFFERENCE * np.eye(3, len(match.peak.ratios))  # of the springs alone
    near = match.peak.ratios + np.vstack([np.zeros_like(match.peak.ratios), steps])
    errors = match.likelihood.errors(match.forward.modal(prior.stiffness(near)))
    everything = np.diag(match.likelihood.measurement_covariance)
    everything = everything + np.median(sigma) ** 2 * match.likelihood.reference
    information = mode_information(
        (errors[1:] - errors[0]).T / DIFFERENCE,
        1 / everything,
        (np.searchsorted(rows, np.arange(errors.shape[1]), side="right") - 1).tolist(),
    )
    return _ModeCheck(misfits, information)


def largest_component_one(shapes: FloatArray) -> FloatArray:
    """(n_model, n_channels) with each shape's largest component 1."""
    largest = np.argmax(np.abs(shapes), axis=1)[:, None]
    return shapes / np.take_along_axis(shapes, largest, axis=1)
