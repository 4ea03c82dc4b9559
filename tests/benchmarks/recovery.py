"""A known foundation is recovered from simulated accelerations: simulate → identify → update.

    python -m tests.benchmarks recovery [--seeds 20] [--first-seed 1001] [--windows 6]
        [--load strong|weak] [--sign published|embedded-pile] [--processes 2]

Each seed draws its own true stiffness, uniform in .8 to 1.25 of nominal, and its own loads and
noise. The updater is given nothing but the blocks; it starts from the whole prior. The simulator
integrates the full model on twice the elements, the updater its reduced one; otherwise they share
the structure, as in the paper.
"""

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FoundationPosterior, ModalEstimate, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.updating.prior import PARAMETER_NAMES, Prior
from pipeline.updating.updater import FoundationUpdater, UpdatingSettings
from sensors.layout import SensorLayout, biaxial_layout
from sensors.loads import BroadbandLoad, WaveBandLoad
from sensors.simulated import SimulatedTower, SimulationSettings
from sensors.turbine.description import TurbineDescription, load_turbine
from sensors.turbine.foundation import SpringSign
from sensors.turbine.modal import ModalModel

FloatArray = NDArray[np.float64]

FIRST_SEED = 1001  # of the truths and the loads. The floors and tails of the likelihood were chosen
# while looking at seeds 1001 to 1010: other first seeds are the honest test
LOWEST, HIGHEST = 0.8, 1.25  # true stiffness / nominal [-]
LOADS = {  # rms forces [N]: broadband on tower and a blade, waves fore-aft and side-side
    "strong": (50e3, 15e3, 300e3, 60e3),
    "weak": (20e3, 0.0, 1e6, 2e5),
}
LAYOUT = biaxial_layout(
    "bench", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)


@dataclass(frozen=True, slots=True)
class Case:
    """One run."""

    seed: int
    windows: int
    load: str
    sign: SpringSign


@dataclass(frozen=True, slots=True)
class Recovery:
    """What came out of one run; the posterior after its last window."""

    seed: int
    truth: FloatArray  # (3,) ratios to nominal
    posterior: FoundationPosterior | None
    rejected: tuple[WindowRejected, ...]
    identify_s: float  # CPU a window
    update_s: float  # CPU a window


def true_ratios(seed: int) -> FloatArray:
    """(3,) drawn from the positive definite part of the box."""
    prior = Prior(load_turbine("iea15mw_monopile").nominal)
    generator = np.random.default_rng(seed)
    while True:
        ratios = generator.uniform(LOWEST, HIGHEST, 3)
        if prior.supports(ratios):
            return ratios


def described(sign: SpringSign) -> TurbineDescription:
    """The turbine with that sign convention of k12."""
    return load_turbine("iea15mw_monopile").with_sign(sign)


def estimates(case: Case, layout: SensorLayout = LAYOUT) -> list[ModalEstimate | WindowRejected]:
    """Simulated and identified windows of one case."""
    tower, blade, fore_aft, side_side = LOADS[case.load]
    settings = SimulationSettings(
        duration=600.0 * case.windows,
        seed=case.seed,
        stiffness_ratios=tuple(true_ratios(case.seed)),
        broadband=BroadbandLoad(tower_rms=tower, blade_rms=blade),
        waves=WaveBandLoad(fore_aft_rms=fore_aft, side_side_rms=side_side),
    )
    node = IdentificationNode()
    answers = list(node.handle(layout))
    for block in SimulatedTower(described(case.sign), layout, settings):
        answers.extend(node.handle(block))
    return [each for each in answers if isinstance(each, ModalEstimate | WindowRejected)]


def updated(
    windows: Sequence[ModalEstimate | WindowRejected],
    case: Case,
    settings: UpdatingSettings | None = None,
) -> tuple[list[FoundationPosterior], list[WindowRejected]]:
    """Posterior after each accepted window, and the rejections of both nodes."""
    forward = ModalModel(described(case.sign), LAYOUT)
    updater = FoundationUpdater(forward, LAYOUT, settings, seed=case.seed)
    state = updater.initial_state()
    posteriors, rejected = [], []
    for window in windows:
        answer: FoundationPosterior | WindowRejected
        if isinstance(window, ModalEstimate):
            state, answer = updater.updated(state, window)
        else:
            answer = window
        (posteriors if isinstance(answer, FoundationPosterior) else rejected).append(answer)
    return posteriors, rejected


def recovered(case: Case) -> Recovery:
    """One seed from loads to posterior."""
    begun = time.process_time()
    windows = estimates(case)
    identified = time.process_time()
    posteriors, rejected = updated(windows, case)
    ended = time.process_time()
    return Recovery(
        seed=case.seed,
        truth=true_ratios(case.seed),
        posterior=posteriors[-1] if posteriors else None,
        rejected=tuple(rejected),
        identify_s=(identified - begun) / case.windows,
        update_s=(ended - identified) / case.windows,
    )


def main(arguments: list[str]) -> None:
    """Run the seeds and print the table."""
    parser = argparse.ArgumentParser(prog="recovery", description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--windows", type=int, default=6)
    parser.add_argument("--load", choices=sorted(LOADS), default="strong")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args(arguments)
    cases = [
        Case(chosen.first_seed + number, chosen.windows, chosen.load, chosen.sign)
        for number in range(chosen.seeds)
    ]
    results = []
    with ProcessPoolExecutor(chosen.processes) as pool:
        for result in pool.map(recovered, cases):
            print(line(result), flush=True)
            results.append(result)
    print(table(results))


def figures(result: Recovery) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(covered, error, half width), each (3,): in or out, and shares of the truth [-]."""
    assert result.posterior is not None
    parameters = [result.posterior.parameter(name) for name in PARAMETER_NAMES]
    nominal = np.array([each.nominal for each in parameters])
    low = np.array([each.p05 for each in parameters]) / nominal
    high = np.array([each.p95 for each in parameters]) / nominal
    median = np.array([each.median for each in parameters]) / nominal
    covered = ((low <= result.truth) & (result.truth <= high)).astype(float)
    return covered, median / result.truth - 1, (high - low) / 2 / result.truth


def line(result: Recovery) -> str:
    """One seed in words."""
    if result.posterior is None:
        return f"seed {result.seed}: no posterior; {[each.reason for each in result.rejected]}"
    covered, error, half = figures(result)
    posterior = result.posterior
    each = "  ".join(
        f"{name} {100 * e:+6.2f} ± {100 * h:4.2f} %{' ' if c else '!'}"
        for name, c, e, h in zip(PARAMETER_NAMES, covered, error, half, strict=True)
    )
    return (
        f"seed {result.seed}: {each}  σ {100 * posterior.parameter('sigma').median:.3f} %  "
        f"χ² {posterior.reduced_chi_square:4.1f}  paired {posterior.paired_share:.2f} "
        f"({len(posterior.pairs)})  cost {posterior.pairing_cost:4.1f}  "
        f"{'trusted' if posterior.trusted else 'UNTRUSTED'}  τ {posterior.autocorrelation_time:.1f}"
        f"  ess {posterior.ess:.0f}  {result.update_s:.1f} s  rejected {len(result.rejected)}"
    )


def table(results: Sequence[Recovery]) -> str:
    """Coverage, errors and widths over all seeds that gave a posterior."""
    good = [figures(result) for result in results if result.posterior is not None]
    covered, error, half = (np.array(column) for column in zip(*good, strict=True))
    rows = {
        f"90 % intervals that hold the truth, of {len(good)}": covered.sum(axis=0),
        "median error %": 100 * np.median(np.abs(error), axis=0),
        "worst error %": 100 * np.abs(error).max(axis=0),
        "median half width %": 100 * np.median(half, axis=0),
        "rms error / (half width / 1.645)": np.sqrt(np.mean((error / (half / 1.645)) ** 2, axis=0)),
    }
    text = [f"{'':45s}" + "".join(f"{name:>9s}" for name in PARAMETER_NAMES)]
    text += [f"{name:45s}" + "".join(f"{v:9.2f}" for v in values) for name, values in rows.items()]
    trusted = sum(r.posterior is not None and r.posterior.trusted for r in results)
    seconds = [np.mean([getattr(r, n) for r in results]) for n in ("identify_s", "update_s")]
    text.append(f"trusted {trusted} of {len(results)}; pooled cover {covered.mean():.3f}")
    text.append(
        f"CPU a window: simulating and identifying {seconds[0]:.2f} s, updating {seconds[1]:.2f} s"
    )
    return "\n".join(text)
