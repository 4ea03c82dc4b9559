"""What pooling a farm gains, on posteriors of drawn modal estimates: seconds a turbine.

A farm's ln k11, ln k22, ln k12 are drawn from a Gaussian each. Windows are drawn about the modes of
each turbine's springs with errors of the size that ten minutes give (`_drawn`), and each turbine's
posterior is the product's own: all floors on, sampled from the whole prior.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.farm.farm import Farm, pooled_farm
from pipeline.messages import FoundationPosterior
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from sensors.structure.foundation import SpringSign
from tests.benchmarks._drawn import LAYOUT, PAPERS_MODES
from tests.benchmarks.calibration import CASES, Posteriors, evidence_of_stream
from tests.pipeline.farm.farms import posterior_of

SPRINGS = ("k11", "k22", "k12")


@dataclass(frozen=True, slots=True)
class FarmCase:
    """A kind of farm."""

    turbines: int = 20
    spread: float = 0.02  # standard deviation of ln k over the farm [-]
    common: float = 0.0  # correlation of the three springs over the farm [-]
    modes: str = "paper"  # "paper": its eleven; "all": what the sensors see
    windows: int = 6  # of a turbine that is not new
    sign: SpringSign = "published"
    outlier: float = 0.85  # an outlier's k22 over what the farm lies about


@dataclass(frozen=True, slots=True, eq=False)
class DrawnFarm:
    """One farm: truths, and every turbine's posterior after one window and after several."""

    truths: FloatArray  # (n_turbines, 3) k / nominal
    new: tuple[FoundationPosterior, ...]  # one window
    old: tuple[FoundationPosterior, ...]  # several
    outlying: FoundationPosterior  # of the first turbine, were it an outlier; several windows


def posteriors_of(case: FarmCase) -> Posteriors:
    """The updating as a scenario has it."""
    model = ModalModel(load_turbine("iea15mw_monopile").with_sign(case.sign), LAYOUT)
    if case.modes == "paper":
        model = model.subset(PAPERS_MODES)
    return Posteriors.of(LikelihoodSettings(), model=model)


def drawn_farm(case: FarmCase, posteriors: Posteriors, seed: int) -> DrawnFarm:
    """Truths, windows and posteriors of a seed."""
    generator = np.random.default_rng([seed, 1717])
    covariance = np.full((3, 3), case.common) + (1 - case.common) * np.eye(3)
    factor = case.spread * np.linalg.cholesky(covariance)
    truths = np.exp(generator.standard_normal((case.turbines, 3)) @ factor.T)
    new = [posterior(posteriors, n, each, 1, generator) for n, each in enumerate(truths)]
    old = [posterior(posteriors, n, each, case.windows, generator) for n, each in enumerate(truths)]
    soft = np.array([truths[0, 0], case.outlier, truths[0, 2]])
    outlying = posterior(posteriors, 0, soft, case.windows, generator)
    return DrawnFarm(truths, tuple(new), tuple(old), outlying)


def posterior(
    posteriors: Posteriors,
    number: int,
    truth: FloatArray,
    windows: int,
    generator: np.random.Generator,
) -> FoundationPosterior:
    """Of a turbine with (3,) true k / nominal after some windows; a thousand draws, as sent."""
    evidence = evidence_of_stream(posteriors.true_modes(truth), CASES[0], windows, generator)
    _, drawn = posteriors.draws(evidence, generator)
    kept = drawn.flat[np.linspace(0, len(drawn.flat) - 1, 1000).astype(int), :3]
    nominal = posteriors.model.nominal
    return posterior_of(f"t{number + 1}", kept, nominal=nominal, window=windows - 1)


def errors(farm: Farm, truths: FloatArray, *, own: bool) -> FloatArray:
    """(n_turbines, 3) medians over truth, less one; the turbines' own or with the farm's help."""
    springs = [each.own if own else each.pooled for each in farm.turbines]
    medians = [[each.median / each.nominal for each in three] for three in springs]
    return np.array(medians) / truths - 1


def held(farm: Farm, truths: FloatArray) -> NDArray[np.bool_]:
    """(n_turbines, 3) whether the pooled 90 % interval has the truth."""
    bounds = np.array(
        [[(k.p05 / k.nominal, k.p95 / k.nominal) for k in each.pooled] for each in farm.turbines]
    )
    return np.asarray((bounds[..., 0] <= truths) & (truths <= bounds[..., 1]))


def print_pooling(case: FarmCase, seeds: Sequence[int], newcomers: int) -> None:
    """The gain of turbines with one window, and what is called an outlier."""
    posteriors = posteriors_of(case)
    together: list[list[FloatArray]] = [[], [], []]
    alone: list[list[FloatArray]] = [[], [], []]
    flagged = falsely = regular = 0
    for seed in seeds:
        drawn = drawn_farm(case, posteriors, seed)
        _note(together, pooled_farm(drawn.new), drawn.truths)
        for number in range(newcomers):  # each in turn the only one with a single window
            mixed = [*drawn.old[:number], drawn.new[number], *drawn.old[number + 1 :]]
            _note(alone, pooled_farm(mixed), drawn.truths, slice(number, number + 1))
        farm = pooled_farm([drawn.outlying, *drawn.old[1:]])
        flagged += farm.turbines[0].outlying
        regular += len(farm.turbines) - 1
        falsely += sum(each.outlying for each in farm.turbines[1:])
        print(f"  seed {seed}: {farm.turbines[0].text}")
        print(_row("    so far, all with one window", together), flush=True)
    kind = f"{case.turbines} turbines, ln k spread by {case.spread:.0%}"
    kind += f", {case.sign}, {case.modes} modes"
    kind += f", springs correlated by {case.common:g}" if case.common else ""
    print(f"{len(seeds)} farms of {kind}, seeds {seeds[0]}…{seeds[-1]}")
    print(_row("all with one window", together))
    if newcomers:
        print(_row(f"one window, the others {case.windows}", alone))
    print(
        f"a turbine with {case.outlier:g} of the farm's k22: flagged in {flagged} of {len(seeds)}; "
        f"of the others {falsely} of {regular} flagged"
    )


def _note(
    lists: list[list[FloatArray]],
    farm: Farm,
    truths: FloatArray,
    which: slice = slice(None),
) -> None:
    lists[0].append(errors(farm, truths, own=True)[which])
    lists[1].append(errors(farm, truths, own=False)[which])
    lists[2].append(held(farm, truths)[which])


def _row(name: str, noted: list[list[FloatArray]]) -> str:
    own, pooled, inside = (np.concatenate(each) for each in noted)
    one, other = np.median(np.abs(own), axis=0), np.median(np.abs(pooled), axis=0)
    overall = 1 - np.median(np.abs(pooled)) / np.median(np.abs(own))
    return (
        f"{name:28s} median error % alone {_three(100 * one)}, pooled {_three(100 * other)}; "
        f"falls by {_three(100 * (1 - other / one), 0)} %, all springs together "
        f"{100 * overall:.0f} %; pooled 90 % intervals hold {_three(inside.mean(axis=0))} "
        f"of {len(own)}"
    )


def _three(values: FloatArray, digits: int = 2) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
