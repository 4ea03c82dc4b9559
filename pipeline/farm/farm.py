"""A farm: every turbine's foundation with what the others lend it, and those unlike the others.

    FoundationPosterior of each turbine ──► evidence ──► pooling ──► Farm
    FoundationEvent ──► own change ──────────┘
                                                                      ├ PooledTurbine each
                                                                      └ StiffnessPopulation

Turbines of one design share the description, and with it its errors: what the figures of the
structure, the mesh and the identification have wrong moves all of them alike, however many there
are. So the turbines are pooled as the nominal description reads them, by what their own
measurements leave open, and one draw ξ of the description's errors is added to all of them
(`evidence`). Where the figures differ from turbine to turbine instead, they stand in the spread
that the pooling infers, and deviations are those of the springs with what the figures make of them.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.farm.evidence import (
    FEWEST_DRAWS,
    StackedEvidence,
    TurbineEvidence,
    common_errors,
    evidence_of,
)
from pipeline.farm.own_changes import OwnChange, beside_the_others, own_change
from pipeline.farm.pooling import PooledDraws, pooled
from pipeline.farm.settings import FarmError, GibbsSettings, PopulationPrior
from pipeline.messages import FoundationEvent, FoundationPosterior, ParameterSummary
from pipeline.state.phrases import count_noun
from pipeline.updating.population import SpringCoordinates, StiffnessPopulation
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.arrays import FloatArray

# Probability from which a turbine is reported to be unlike the others: with one in twenty thought
# to be, evidence of 23 to 1. Chosen on tuning seeds; tests/benchmarks/results/pooling.json has what
# it finds and how often it is wrong.
OUTLYING_PROBABILITY = 0.55
MOST_FARM_DRAWS = 1000  # of a turbine's springs, that are kept
POPULATION_DRAWS = 100  # of mean and spread, that make the prior of one more turbine
FEWEST_TURBINES = 2


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A turbine whose posterior could not be pooled."""

    turbine: str
    reason: str


@dataclass(frozen=True, slots=True)
class PoolingSettings:
    """How a farm is pooled."""

    population: PopulationPrior = field(default_factory=PopulationPrior)
    gibbs: GibbsSettings = field(default_factory=GibbsSettings)
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Interval:
    """A quantity's median with its 90 % interval."""

    median: float
    p05: float
    p95: float

    @property
    def half_width(self) -> float:
        """Half of the interval."""
        return (self.p95 - self.p05) / 2

    @classmethod
    def of(cls, draws: FloatArray) -> "Interval":
        """Return median and 90 % interval of (n,) draws."""
        p05, median, p95 = np.quantile(draws, [0.05, 0.5, 0.95]).tolist()
        return cls(median, p05, p95)


@dataclass(frozen=True, slots=True, eq=False)
class PooledTurbine:
    """One turbine of a farm. Springs in the order k11, k22, k12."""

    turbine: str
    window: int
    """The last that entered its own posterior."""
    time_ns: int
    """End of that window."""
    n_windows: int
    own: tuple[ParameterSummary, ...]
    """As it published them."""
    pooled: tuple[ParameterSummary, ...]
    """With what the others lend it."""
    deviations: tuple[Interval, ...]
    """From the farm's centre, k / k_centre − 1 [-]."""
    own_change: OwnChange | None
    """By its own measurements."""
    outlier_probability: float
    text: str
    """One sentence about it."""
    draws: FloatArray
    """(n_draws <= 1000, 3) k11 [N/m], k22 [N·m/rad], k12 [N/rad]."""

    @property
    def outlying(self) -> bool:
        """Whether it is reported to be unlike the others."""
        return self.outlier_probability >= OUTLYING_PROBABILITY


@dataclass(frozen=True, slots=True, eq=False)
class Farm:
    """All turbines, what they have in common, and what may be expected of one more."""

    turbines: tuple[PooledTurbine, ...]
    """In the order of their names."""
    left_out: tuple[LeftOut, ...]
    centre: tuple[ParameterSummary, ...]
    """k11, k22, k12 that the farm lies about."""
    spread: tuple[Interval, ...]
    """Standard deviations of ln k11, ln k22, ln k12 [-]."""
    population: StiffnessPopulation
    ess: float
    """Smallest effective sample size of the pooling."""
    rhat: float
    """Its largest split R̂."""


def pooled_farm(
    messages: Sequence[FoundationPosterior | FoundationEvent],
    settings: PoolingSettings | None = None,
) -> Farm:
    """The farm of the latest posterior of each turbine, and of their events.

    Parameters
    ----------
    messages : sequence of FoundationPosterior or FoundationEvent
        Of all turbines. The same messages, in whatever order, give the same farm.
    settings : PoolingSettings, optional
        The defaults where left out.

    Raises
    ------
    FarmError
        If fewer than two turbines can be pooled.
    """
    settings = settings or PoolingSettings()
    members, left_out = members_of([e for e in messages if isinstance(e, FoundationPosterior)])
    if len(members) < FEWEST_TURBINES:
        missing = "".join(f"; {each.turbine}: {each.reason}" for each in left_out)
        raise FarmError(
            f"{len(members)} of {count_noun(len(members) + len(left_out), 'turbine')} can be "
            f"pooled; at least {FEWEST_TURBINES} are needed{missing}"
        )
    generator = np.random.default_rng(settings.seed)
    coordinates = SpringCoordinates(nominal_of(members[0]))
    changes = _own_changes(members, messages)
    evidence = [
        _with_change(evidence_of(each, coordinates, generator), change, coordinates)
        for each, change in zip(members, beside_the_others(changes), strict=True)
    ]
    drawn = pooled(
        StackedEvidence.of([each.of_the_description() for each in evidence]),
        settings.population,
        generator,
        settings.gibbs,
        equal_spreads(coordinates),
    )
    figures, common = common_errors(evidence)
    population = _population(members, drawn, coordinates, settings.population, figures, common)
    with_errors = drawn.with_common_errors(common, generator) if figures else drawn
    return _pooled_farm(members, left_out, with_errors, coordinates, population, changes)


def _own_changes(
    members: Sequence[FoundationPosterior],
    messages: Sequence[FoundationPosterior | FoundationEvent],
) -> list[OwnChange | None]:
    events = [each for each in messages if isinstance(each, FoundationEvent)]
    return [own_change(each, events) for each in members]


def _with_change(
    evidence: TurbineEvidence, change: OwnChange | None, coordinates: SpringCoordinates
) -> TurbineEvidence:
    if change is None:
        return evidence
    return replace(evidence, change=change.in_coordinates(coordinates))


def equal_spreads(coordinates: SpringCoordinates) -> FloatArray:
    """Covariance (3, 3) of x where ln k11, ln k22, ln k12 have unit variance and are independent.

    S = G⁻¹ G⁻ᵀ with d ln k = G dx to first order about the nominal foundation; see `log_spreads`.
    """
    coupling = coordinates.nominal[2] / np.sqrt(coordinates.nominal[0] * coordinates.nominal[1])
    gradient = np.array([[1, 0, 0], [0, 1, 0], [0.5, 0.5, (1 - coupling**2) / coupling]])
    inverse = np.linalg.inv(gradient)
    return np.asarray(inverse @ inverse.T, dtype=np.float64)


def _pooled_farm(
    members: Sequence[FoundationPosterior],
    left_out: tuple[LeftOut, ...],
    drawn: PooledDraws,
    coordinates: SpringCoordinates,
    population: StiffnessPopulation,
    changes: Sequence[OwnChange | None],
) -> Farm:
    centres = coordinates.to_ratios(drawn.means)  # (n_draws, 3)
    spreads = log_spreads(drawn, coordinates)
    farm_spread = tuple(Interval.of(column) for column in spreads.T)
    turbines = tuple(
        _pooled_turbine(
            posterior,
            coordinates.to_ratios(drawn.points[:, number]),
            centres,
            spreads=np.median(spreads, axis=0),
            probability=float(drawn.outlier_probabilities[number]),
            change=changes[number],
        )
        for number, posterior in enumerate(members)
    )
    return Farm(
        turbines=turbines,
        left_out=left_out,
        centre=_summaries(centres * coordinates.nominal, members[0]),
        spread=farm_spread,
        population=population,
        ess=drawn.ess,
        rhat=drawn.rhat,
    )


def _population(
    members: Sequence[FoundationPosterior],
    drawn: PooledDraws,
    coordinates: SpringCoordinates,
    prior: PopulationPrior,
    figures: tuple[str, ...],
    common: FloatArray,
) -> StiffnessPopulation:
    chosen = _evenly(len(drawn.means), POPULATION_DRAWS)
    return StiffnessPopulation(
        turbines=tuple(each.turbine for each in members),
        nominal=coordinates.nominal,
        means=drawn.means[chosen],
        covariances=drawn.covariances[chosen],
        outlier_shares=drawn.outlier_shares[chosen],
        outlier_std=prior.outlier_std,
        figures=figures,
        common=common.mean(axis=0),
    )


def _pooled_turbine(
    posterior: FoundationPosterior,
    ratios: FloatArray,
    centres: FloatArray,
    *,
    spreads: FloatArray,
    probability: float,
    change: OwnChange | None,
) -> PooledTurbine:
    """ratios, centres: (n_draws, 3) k / nominal, of the turbine and the farm; spreads: (3,) of
    ln k over the farm."""
    deviations = tuple(Interval.of(column) for column in (ratios / centres - 1).T)
    standing_out = [
        abs(each.median) / np.hypot(spread, each.half_width)
        for each, spread in zip(deviations, spreads, strict=True)
    ]
    stiffness = ratios * nominal_of(posterior)
    return PooledTurbine(
        turbine=posterior.turbine,
        window=posterior.window,
        time_ns=posterior.time_ns,
        n_windows=posterior.n_windows,
        own=posterior.parameters[:3],
        pooled=_summaries(stiffness, posterior),
        deviations=deviations,
        own_change=change,
        outlier_probability=probability,
        text=_sentence(posterior.turbine, deviations, int(np.argmax(standing_out)), probability)
        + _change_clause(change),
        draws=stiffness[_evenly(len(stiffness), MOST_FARM_DRAWS)],
    )


def _sentence(turbine: str, deviations: Sequence[Interval], spring: int, probability: float) -> str:
    """The spring that stands out most, and how sure it is that the turbine is unlike the others."""
    off, name = deviations[spring], PARAMETER_NAMES[spring]
    side, sign = ("below", -100) if off.median < 0 else ("above", 100)
    low, high = sorted((sign * off.p05, sign * off.p95))
    size = f"{name} {sign * off.median:.1f} % [{low:.1f}, {high:.1f}] {side} the farm's"
    if probability >= OUTLYING_PROBABILITY:
        return f"{turbine}: {size}, unlike the others with probability {_probability(probability)}"
    return f"{turbine}: {size}, like the others with probability {_probability(1 - probability)}"


def _change_clause(change: OwnChange | None) -> str:
    """The spring that changed most surely by the turbine's own measurements."""
    if change is None:
        return ""
    spring = int(np.argmax(np.abs(change.logs) / change.stds))
    size = 100 * np.expm1(change.logs[spring])
    return f"; by its own measurements {PARAMETER_NAMES[spring]} has changed by {size:+.1f} %"


def _probability(value: float) -> str:
    """ "> .999" or ".98": no probability is ever certain."""
    return "> .999" if value > 0.999 else f"{value:.3f}".lstrip("0")


def log_spreads(drawn: PooledDraws, coordinates: SpringCoordinates) -> FloatArray:
    """(n_draws, 3) standard deviations of ln k11, ln k22 and ln |k12| over the farm [-].

    Parameters
    ----------
    drawn : PooledDraws
        With means and covariances of the population.
    coordinates : SpringCoordinates
        Of the draws.

    Notes
    -----
        ln |k12| = ½ (ln k11 + ln k22) + ln |ρ|,   d ln |ρ| / dz = (1 − ρ²) / ρ

    to first order about the farm's mean.
    """
    coupling = coordinates.nominal[2] / np.sqrt(coordinates.nominal[0] * coordinates.nominal[1])
    rho = np.tanh(drawn.means[:, 2] + np.arctanh(coupling))
    gradient = np.column_stack([np.full((len(rho), 2), 0.5), (1 - rho**2) / rho])
    coupled = np.einsum("ni,nij,nj->n", gradient, drawn.covariances, gradient)
    own = drawn.covariances[:, [0, 1], [0, 1]]
    return np.sqrt(np.column_stack([own, coupled]))


def _summaries(
    stiffness: FloatArray, posterior: FoundationPosterior
) -> tuple[ParameterSummary, ...]:
    """Quantiles of (n, 3) springs in their units, under the names and units of a posterior."""
    quantiles = np.quantile(stiffness, [0.05, 0.5, 0.95], axis=0).T.tolist()
    return tuple(
        ParameterSummary(
            name=own.name,
            unit=own.unit,
            nominal=own.nominal,
            median=median,
            p05=p05,
            p95=p95,
        )
        for own, (p05, median, p95) in zip(posterior.parameters[:3], quantiles, strict=True)
    )


def _evenly(length: int, most: int) -> FloatArray:
    """(min(length, most),) indices spread over all."""
    return np.linspace(0, length - 1, min(length, most)).round().astype(int)


def members_of(
    posteriors: Sequence[FoundationPosterior],
) -> tuple[list[FoundationPosterior], tuple[LeftOut, ...]]:
    """Return the latest posterior of each turbine that can be pooled, and why others cannot."""
    latest: dict[str, FoundationPosterior] = {}
    for each in sorted(posteriors, key=lambda posterior: posterior.time_ns):
        latest[each.turbine] = each
    ordered = [latest[name] for name in sorted(latest, key=in_order)]
    nominals = Counter(tuple(nominal_of(each).tolist()) for each in ordered)
    common = np.array(max(nominals, key=lambda nominal: nominals[nominal])) if nominals else None
    members, left_out = [], []
    for each in ordered:
        reason = _reason_against(each, common)
        if reason:
            left_out.append(LeftOut(each.turbine, reason))
        else:
            members.append(each)
    return members, tuple(left_out)


def _reason_against(posterior: FoundationPosterior, nominal: FloatArray | None) -> str:
    """Return why a posterior cannot be pooled; "" where it can."""
    if not posterior.trusted:
        return "its posterior is not trusted"
    if posterior.population:
        return f"its posterior began with a population's prior ({posterior.population})"
    if nominal is None or not np.allclose(nominal_of(posterior), nominal, rtol=1e-6, atol=0.0):
        return "its nominal foundation is another one than the other turbines'"
    if len(posterior.draws) < FEWEST_DRAWS:
        return f"its posterior has {len(posterior.draws)} draws; {FEWEST_DRAWS} are needed"
    k11, k22, k12 = posterior.draws[:, :3].T
    possible = np.isfinite(posterior.draws).all() and np.all((k11 > 0) & (k11 * k22 > k12**2))
    return "" if possible else "its posterior has springs that no foundation has"


def nominal_of(posterior: FoundationPosterior) -> FloatArray:
    """(3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad] that a posterior's ratios are of."""
    return np.array([posterior.parameter(name).nominal for name in PARAMETER_NAMES])


def in_order(name: str) -> tuple[tuple[int, str], ...]:
    """Return a key by which turbine 2 comes before turbine 10."""
    parts = re.split(r"(\d+)", name)
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in parts)
