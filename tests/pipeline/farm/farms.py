"""Farms of drawn posteriors: a truth a turbine, and draws about an estimate of it."""

from dataclasses import replace

import numpy as np

from pipeline.messages import (
    FigureError,
    FoundationEvent,
    FoundationPosterior,
    ParameterSummary,
    StiffnessChange,
)
from pipeline.updating.prior import PARAMETER_NAMES, PARAMETER_UNITS
from tests.pipeline.example_messages import START_NS

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])  # [foundation-updating] Eq. 12
SPREAD = 0.02  # of ln k over a farm [-]
# of ln k after one window of the paper's eleven modes: standard deviations 1.1 1.7 2.3 %,
# correlations .8 .92 .94
POSTERIOR_FACTOR = (
    np.array([1.1, 1.7, 2.3])[:, None]
    * np.linalg.cholesky(np.array([[1.0, 0.8, 0.92], [0.8, 1.0, 0.94], [0.92, 0.94, 1.0]]))
    * 0.01
)


def posterior_of(
    turbine: str, ratios: np.ndarray, *, nominal: np.ndarray = NOMINAL, window: int = 0
) -> FoundationPosterior:
    """A posterior with these draws, (n, 3) k / nominal."""
    draws = np.column_stack([ratios * nominal, np.full(len(ratios), 0.001)])
    low, median, high = np.quantile(draws, [0.05, 0.5, 0.95], axis=0)
    parameters = tuple(
        ParameterSummary(name, unit, float(known), float(m), float(lo), float(hi))
        for name, unit, known, lo, m, hi in zip(
            (*PARAMETER_NAMES, "sigma"),
            (*PARAMETER_UNITS, "-"),
            (*nominal, 1.0),
            low,
            median,
            high,
            strict=True,
        )
    )
    return FoundationPosterior(
        turbine=turbine,
        window=window,
        time_ns=START_NS + (window + 1) * 600_000_000_000,
        n_windows=window + 1,
        parameters=parameters,
        correlation=np.corrcoef(ratios.T),
        draws=draws,
        pairs=(),
        model_labels=(),
        model_frequencies=np.empty(0),
        model_shapes=np.empty((0, 0)),
        sampler="importance",
        ess=1000.0,
        rhat=1.0,
        autocorrelation_time=float("nan"),
        reduced_chi_square=1.0,
        paired_share=1.0,
        pairing_cost=0.3,
    )


def drawn_farm(
    n: int, *, seed: int, outlier: int | None = None, nominal: np.ndarray = NOMINAL
) -> tuple[list[FoundationPosterior], np.ndarray]:
    """Posteriors t1 … tn of a farm that spreads by SPREAD, and the truth, (n, 3) k / nominal.

    outlier   number of the turbine, from 1, whose k22 is 15 % lower than it would have been
    """
    generator = np.random.default_rng(seed)
    truth = SPREAD * generator.standard_normal((n, 3))
    if outlier is not None:
        truth[outlier - 1, 1] += np.log(0.85)
    centre = truth + generator.standard_normal((n, 3)) @ POSTERIOR_FACTOR.T
    cloud = generator.standard_normal((1000, 3)) @ POSTERIOR_FACTOR.T
    posteriors = [
        posterior_of(f"t{number + 1}", np.exp(each + cloud), nominal=nominal)
        for number, each in enumerate(centre)
    ]
    return posteriors, np.exp(truth)


def of_one_description(
    n: int, *, seed: int, error: float = 0.1
) -> tuple[list[FoundationPosterior], np.ndarray]:
    """A farm whose description has one figure wrong, which moves all turbines alike.

    error   of ln k11, ln k22, ln k12 by one standard deviation of the figure's prior [-]
    """
    posteriors, truth = drawn_farm(n, seed=seed)
    generator = np.random.default_rng([seed, 1])
    xi = float(generator.standard_normal())
    moved = []
    for each in posteriors:
        cloud = np.exp(error * (generator.standard_normal((len(each.draws), 1)) - xi))
        again = posterior_of(each.turbine, each.draws[:, :3] / NOMINAL * cloud)
        made = (FigureError("added_mass", error, error, error),)
        moved.append(replace(again, structure="uncertain", figure_errors=made))
    return moved, truth


def event_of(
    posterior: FoundationPosterior,
    k22: float,
    *,
    std: float = 0.01,
    windows_ago: int = 0,
    kind: str = "foundation",
) -> FoundationEvent:
    """A change of k22 [-], known to a standard deviation, that a turbine's own windows showed."""
    time_ns = posterior.time_ns - windows_ago * 600_000_000_000
    changes = tuple(
        StiffnessChange(name, size, size - 1.6449 * std, size + 1.6449 * std, size, std)
        for name, size in zip(PARAMETER_NAMES, (0.0, k22, 0.0), strict=True)
    )
    return FoundationEvent(
        turbine=posterior.turbine,
        window=posterior.window - windows_ago,
        time_ns=time_ns,
        kind=kind,
        probability=1.0,
        since_ns=time_ns - 600_000_000_000,
        since_earliest_ns=time_ns - 600_000_000_000,
        since_latest_ns=time_ns - 600_000_000_000,
        changes=changes if kind == "foundation" else (),
        shifts=(),
        text="the foundation has changed",
    )


def untrusted(posterior: FoundationPosterior) -> FoundationPosterior:
    """The same, contradicted by its own data."""
    return replace(posterior, trusted=False)
