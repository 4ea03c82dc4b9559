"""Pooling against an oracle: `python -m tests.benchmarks pooling [--farms 40 40 10] [--seed 7001]`.

Farms are drawn: ln k11, ln k22, ln k12 of each turbine independent with one spread. What a
turbine's windows show is a Gaussian about its truth in the pooling's coordinates, with a covariance
of a library: those of 24 posteriors of drawn modal estimates, as `_farm_pooling` draws them.

gain     the rms error's fall against each turbine alone
oracle   knows the farm's mean and spread
bound    knows the spread, not the mean: what turbines of the farm can show at best
most     the bound's share of the oracle's gain, in expectation and closed form: no estimator that
         must learn the mean from the farm has a larger one
told     a turbine with 90 % of its k22, six windows each; false: of the others. In `soft` it never
         had more, in `watched` it lost a tenth between six windows and six others, and its own
         change is as well known as the difference of the two is
"""

import argparse
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipeline.farm.evidence import StackedEvidence, evidence_of
from pipeline.farm.farm import OUTLYING_PROBABILITY, equal_spreads
from pipeline.farm.own_changes import OwnChange
from pipeline.farm.pooling import PooledDraws, pooled
from pipeline.farm.settings import GibbsSettings, PopulationPrior
from pipeline.updating.population import SpringCoordinates
from sensors.arrays import FloatArray
from tests.benchmarks._farm_pooling import FarmCase, posterior, posteriors_of
from tests.benchmarks._results import keep, kept

SIZES, SPREADS = (5, 20, 100), (0.02, 0.05)
SETTINGS = GibbsSettings(burn_in=80, sweeps=150, rounds=1)  # shorter than a farm's own: for time
SOFT = 0.9  # of k22
KNOWN = ("farm", "spread", "shape", "k22")
FALSE_SHARE = 0.001  # of regular turbines that are called soft
WINDOWS = 6  # of a turbine, where a softer one is looked for


@dataclass(frozen=True, slots=True, eq=False)
class Library:
    """Covariances of one window's evidence, and the coordinates that they are in."""

    covariances: FloatArray
    """(n, 3, 3) in x."""
    coordinates: SpringCoordinates
    """Of the turbine."""


@dataclass(frozen=True, slots=True)
class Pooling:
    """Of farms of one size and spread."""

    turbines: int
    spread: float
    farms: int
    rms_alone: float
    """Of k / truth − 1 over all springs [-]."""
    gain: float
    gain_oracle: float
    gain_bound: float
    share_of_oracle: float
    share_of_bound: float
    most_share_of_oracle: float
    """In expectation, of any estimator that must learn the farm's mean [-]."""
    rms_against_alone: float
    median_against_alone: float
    cover: float
    """Of 90 % intervals."""


def library(count: int = 24, seed: int = 5) -> Library:
    """From posteriors of one window each."""
    posteriors, generator = posteriors_of(FarmCase()), np.random.default_rng(seed)
    covariances = []
    for number in range(count):
        truth = np.exp(0.03 * generator.standard_normal(3))
        drawn = posterior(posteriors, number, truth, 1, generator)
        coordinates = SpringCoordinates(np.array([each.nominal for each in drawn.parameters[:3]]))
        found = evidence_of(drawn, coordinates, generator)
        mean = found.shares @ found.means
        off = found.means - mean
        spread = found.covariances + off[:, :, None] * off[:, None, :]
        covariances.append(np.einsum("k,kij->ij", found.shares, spread))
    return Library(np.array(covariances), coordinates)


def drawn(
    lib: Library, truths: FloatArray, windows: int, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Means (n, 3) and covariances (n, 3, 3) of the turbines' evidence."""
    chosen = generator.integers(len(lib.covariances), size=len(truths))
    covariances = lib.covariances[chosen] / windows
    noise = generator.standard_normal(truths.shape)
    seen = np.einsum("nij,nj->ni", np.linalg.cholesky(covariances), noise)
    return lib.coordinates.of_ratios(truths) + seen, covariances


def draws(
    lib: Library,
    means: FloatArray,
    covariances: FloatArray,
    seed: int,
    change: OwnChange | None = None,
) -> PooledDraws:
    """The product's pooling; `change` is the first turbine's own."""
    changes = () if change is None else (change.in_coordinates(lib.coordinates),)
    evidence = StackedEvidence(
        np.zeros((len(means), 1)), means[:, None], covariances[:, None], changes
    )
    generator, shape = np.random.default_rng([seed, 2]), equal_spreads(lib.coordinates)
    return pooled(evidence, PopulationPrior(), generator, SETTINGS, shape)


def informed(
    means: FloatArray, covariances: FloatArray, population: FloatArray, centre: FloatArray
) -> FloatArray:
    """Posterior means of x, (n, 3), with the farm's mean and covariance known."""
    precision, own = np.linalg.inv(population), np.linalg.inv(covariances)
    weighted = (own @ means[..., None])[..., 0] + precision @ centre
    return np.asarray(np.linalg.solve(own + precision, weighted[..., None])[..., 0])


def expected_errors(
    covariances: FloatArray, population: FloatArray, jacobian: FloatArray
) -> tuple[float, float, float]:
    """Expected mean squares of ratio errors alone, with the oracle, and with the bound [-].

    Parameters
    ----------
    covariances : ndarray, shape (n, 3, 3)
        C of each turbine's evidence in x.
    population : ndarray, shape (3, 3)
        Σ, known.
    jacobian : ndarray, shape (3, 3)
        J, of the ratios by x.

    Notes
    -----
    A turbine alone errs by C. With μ and Σ known its posterior has V = (C⁻¹ + Σ⁻¹)⁻¹. Where μ must
    be learned, its best estimate has the covariance T = (Σᵢ (Cᵢ + Σ)⁻¹)⁻¹, and the turbine errs by
    V + V Σ⁻¹ T Σ⁻¹ V. That is the posterior covariance under a flat prior of μ, hence the least
    mean square of any equivariant estimator. Gelman et al., Bayesian Data Analysis, 3rd ed., §5.4.
    """
    precision = np.linalg.inv(population)
    own = np.linalg.inv(np.linalg.inv(covariances) + precision)
    mean = np.linalg.inv(np.linalg.inv(covariances + population).sum(axis=0))
    lent = own @ precision
    learned = own + lent @ mean @ np.swapaxes(lent, 1, 2)
    alone, oracle, bound = (
        float(np.mean(np.einsum("ij,njk,ik->ni", jacobian, each, jacobian)))
        for each in (covariances, own, learned)
    )
    return alone, oracle, bound


def most_share(lib: Library, turbines: int, spread: float, farms: int = 2000) -> float:
    """Largest share of the oracle's rms gain where the farm's mean must be learned [-]."""
    generator, step = np.random.default_rng(1), 1e-5
    population = spread**2 * equal_spreads(lib.coordinates)
    nominal = lib.coordinates.of_ratios(np.ones(3))
    jacobian = np.array([lib.coordinates.to_ratios(nominal + step * e) - 1 for e in np.eye(3)]).T
    errors = [
        expected_errors(
            lib.covariances[generator.integers(len(lib.covariances), size=turbines)],
            population,
            jacobian / step,
        )
        for _ in range(farms)
    ]
    alone, oracle, bound = np.sqrt(np.mean(errors, axis=0))
    return float((alone - bound) / (alone - oracle))


def measured(lib: Library, turbines: int, spread: float, seeds: Sequence[int]) -> Pooling:
    """Errors and intervals over some farms."""
    errors: dict[str, list[FloatArray]] = {"alone": [], "pooled": [], "oracle": [], "bound": []}
    held = []
    population = spread**2 * equal_spreads(lib.coordinates)
    for seed in seeds:
        generator = np.random.default_rng([seed, turbines, round(1000 * spread)])
        truths = np.exp(spread * generator.standard_normal((turbines, 3)))
        means, covariances = drawn(lib, truths, 1, generator)
        precision = np.linalg.inv(covariances + population)
        weighted = (precision @ means[..., None]).sum(axis=0)[:, 0]
        centre = np.linalg.solve(precision.sum(axis=0), weighted)
        ratios = lib.coordinates.to_ratios(draws(lib, means, covariances, seed).points)
        low, median, high = np.quantile(ratios, [0.05, 0.5, 0.95], axis=0)
        held.append((low <= truths) & (truths <= high))
        for name, found in (
            ("alone", lib.coordinates.to_ratios(means)),
            ("pooled", median),
            ("oracle", _ratios(lib, informed(means, covariances, population, np.zeros(3)))),
            ("bound", _ratios(lib, informed(means, covariances, population, centre))),
        ):
            errors[name].append(found / truths - 1)
    rms = {name: float(np.sqrt(np.mean(np.concatenate(e) ** 2))) for name, e in errors.items()}
    mid = {name: float(np.median(np.abs(np.concatenate(e)))) for name, e in errors.items()}
    gains = {name: 1 - each / rms["alone"] for name, each in rms.items()}
    return Pooling(
        turbines,
        spread,
        len(seeds),
        rms["alone"],
        gains["pooled"],
        gains["oracle"],
        gains["bound"],
        gains["pooled"] / gains["oracle"],
        gains["pooled"] / gains["bound"],
        most_share(lib, turbines, spread),
        rms["pooled"] / rms["alone"] - 1,
        mid["pooled"] / mid["alone"] - 1,
        float(np.mean(np.concatenate(held))),
    )


def _ratios(lib: Library, points: FloatArray) -> FloatArray:
    return lib.coordinates.to_ratios(points)


def softened(
    lib: Library, turbines: int, seeds: Sequence[int], *, watched: bool
) -> dict[str, float]:
    """How often one turbine with less k22 is told, and others falsely; `watched`: it lost it
    between two groups of windows."""
    told = false = regular = 0
    for seed in seeds:
        generator = np.random.default_rng([seed, turbines, 10])
        truths = np.exp(SPREADS[0] * generator.standard_normal((turbines, 3)))
        before = truths[:1].copy()
        truths[0, 1] = SOFT * (before[0, 1] if watched else 1.0)
        means, covariances = drawn(lib, truths, WINDOWS, generator)
        change = None
        if watched:
            earlier = drawn(lib, before, WINDOWS, generator)
            change = own_change_between(lib, earlier, (means[:1], covariances[:1]))
        found = draws(lib, means, covariances, seed, change).outlier_probabilities
        outlying = found >= OUTLYING_PROBABILITY
        told, false = told + int(outlying[0]), false + int(outlying[1:].sum())
        regular += turbines - 1
    return {
        "turbines": turbines,
        "farms": len(seeds),
        "told": told / len(seeds),
        "false": false,
        "others": regular,
    }


def own_change_between(
    lib: Library, before: tuple[FloatArray, FloatArray], after: tuple[FloatArray, FloatArray]
) -> OwnChange:
    """Of one turbine, from its evidence before and after: means (1, 3), covariances (1, 3, 3).
    Each spring has an interval of its own, as a message has."""
    ratios = [lib.coordinates.to_ratios(each[0][0]) for each in (before, after)]
    step = 1e-5
    nearby = lib.coordinates.to_ratios(after[0] + step * np.eye(3))
    jacobian = np.log(nearby / ratios[1]).T / step  # of ln k by x
    covariance = jacobian @ (before[1][0] + after[1][0]) @ jacobian.T
    return OwnChange(np.log(ratios[1] / ratios[0]), np.sqrt(np.diag(covariance)), ratios[1])


def detectable(lib: Library, turbines: int, farms: int, seed: int) -> dict[str, float]:
    """Power to tell the softer turbine of `softened` where one regular turbine of a thousand is
    called soft, by what is known of the farm beside the widths of all posteriors.

    farm       its mean and spread: χ² of the turbine's distance
    spread     but not the mean, which the others show
    shape      but not how large the spread is: by the spread of the others too
    k22        the same, and that it would be k22 alone that differs, and be less: the distance
               along that direction, weighted as is best where the spread is known
    """
    found: dict[str, list[list[float]]] = {name: [[], []] for name in KNOWN}
    for number in range(farms):
        generator = np.random.default_rng([seed + number, turbines, 13])
        for soft in (0, 1):
            truths = np.exp(SPREADS[0] * generator.standard_normal((turbines, 3)))
            if soft:
                truths[0] = [truths[0, 0], SOFT, truths[0, 2]]
            means, covariances = drawn(lib, truths, WINDOWS, generator)
            for name, value in zip(KNOWN, _distances(lib, means, covariances), strict=True):
                found[name][soft].append(value)
    powers = {
        name: float(np.mean(np.array(soft) > np.quantile(regular, 1 - FALSE_SHARE)))
        for name, (regular, soft) in found.items()
    }
    return {"turbines": turbines, "farms": farms, **powers}


def _distances(lib: Library, means: FloatArray, covariances: FloatArray) -> list[float]:
    """Of the first turbine from the others, by what is known; in the order of `KNOWN`."""
    population = SPREADS[0] ** 2 * equal_spreads(lib.coordinates)
    inverse = np.linalg.inv(covariances + population)
    own = float(means[0] @ inverse[0] @ means[0])
    total = np.linalg.inv(inverse[1:].sum(axis=0))
    centre = total @ (inverse[1:] @ means[1:, :, None]).sum(axis=0)[:, 0]
    offset = means[0] - centre
    spread = float(offset @ np.linalg.solve(covariances[0] + population + total, offset))
    rest = means[1:] - centre
    scatter = float(np.einsum("ni,nij,nj->", rest, inverse[1:], rest)) / rest.size
    softer = lib.coordinates.of_ratios(np.array([1.0, SOFT, 1.0]))
    weights = np.linalg.solve(covariances[0] + population + total, softer)
    along = weights @ offset / np.sqrt(weights @ softer * scatter)
    return [own, spread, spread / scatter, float(along)]


def main(arguments: Sequence[str]) -> None:
    """Measure each size and spread, print, write the results."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks pooling")
    parser.add_argument("--farms", type=int, nargs=3, default=(40, 40, 10))
    parser.add_argument("--soft", type=int, default=50, help="farms with one softer turbine")
    parser.add_argument("--limits", type=int, default=20_000, help="farms for what is detectable")
    parser.add_argument(
        "--only-soft", action="store_true", help="what pooling gains stays as it was measured"
    )
    parser.add_argument("--seed", type=int, default=7001)
    chosen = parser.parse_args(arguments)
    lib = library()
    known = (kept("pooling") or {"figures": {}})["figures"]
    results: list[dict[str, float]] = []
    soft: dict[str, list[dict[str, float]]] = {"soft": [], "watched": []}
    if chosen.only_soft:
        results = known["pooling"]
    else:
        for turbines, farms in zip(SIZES, chosen.farms, strict=True):
            for spread in SPREADS:
                found = measured(lib, turbines, spread, range(chosen.seed, chosen.seed + farms))
                results.append(asdict(found))
                print(found, flush=True)
    limits = [detectable(lib, turbines, chosen.limits, chosen.seed) for turbines in SIZES[:2]]
    print(limits, flush=True)
    for turbines in SIZES[:2]:
        for name, rows in soft.items():
            seeds = range(chosen.seed, chosen.seed + chosen.soft)
            rows.append(softened(lib, turbines, seeds, watched=name == "watched"))
            print(name, rows[-1], flush=True)
            _write(chosen, known, results, soft, limits)


def _write(
    chosen: argparse.Namespace,
    known: dict[str, Any],
    results: Sequence[dict[str, float]],
    soft: dict[str, list[dict[str, float]]],
    limits: Sequence[dict[str, float]],
) -> None:
    farms = "" if chosen.only_soft else f" --farms {' '.join(map(str, chosen.farms))}"
    only = " --only-soft" if chosen.only_soft else ""
    command = (
        f"python -m tests.benchmarks pooling{farms} --soft {chosen.soft} "
        f"--limits {chosen.limits} --seed {chosen.seed}{only}"
    )
    first = known.get("command_pooling") if chosen.only_soft else command
    content = {
        "command_pooling": first,
        "pooling": results,
        **soft,
        "detectable": limits,
    }
    keep(
        "pooling",
        content,
        command=command,
        seeds=range(chosen.seed, chosen.seed + max(chosen.soft, *chosen.farms)),
        depends=["pipeline/farm", "pipeline/updating/population.py"],
    )
