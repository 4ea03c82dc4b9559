"""A known foundation is recovered from simulated accelerations: simulate → identify → update.

    python -m tests.benchmarks recovery [--seeds 20] [--first-seed 1001] [--windows 6]
        [--load strong|weak] [--sign published|embedded-pile] [--structure finer|exact|…]
        [--processes 2] [--every-window] [--eleven] [--keep FOLDER]

Each seed draws its own true stiffness, uniform in .8 to 1.25 of nominal, and its own loads and
noise. The updater is given nothing but the blocks; it starts from the whole prior. The simulator
integrates the full model on twice the elements, the updater its reduced one; otherwise they share
the structure, as in the paper, unless --structure names another.

The posterior is refreshed after the first window and after the last one; what lies between enters
its evidence. With --every-window it is refreshed, and a change looked for, each time.

What it gave for k11, k22, k12, on seeds that no floor, tail or tolerance was chosen on:

    six windows        seeds                         hold the truth  median error %  worst %
    strong             2011..2032, 7001..7020        39, 42, 40      .30  .14  .36   1.4   .7  1.6
                       9001..9018                    18, 18, 18      .44  .12  .26   1.4   .7  1.9
    weak               2001..2020, 7001..7020        40, 38, 40      .30  .42  .48   1.8  1.3  2.4
                       9001..9018                    18, 16, 18      .52  .40  .47   1.1  1.4  1.9
    strong, --eleven   2011..2032, 7001..7020        40, 42, 40      .52  .60  .72   2.6  1.7  2.7
                       9001..9020                    20, 20, 20      .44  .39  .63   1.8  1.9  1.7
    embedded-pile      3001..3020, 7001..7020        40, 40, 40      1.3  1.8  2.2   4.1  6.0  7.2
                       9001..9020                    18, 18, 18      1.6  1.9  2.6   6.1 10.1 12.5

    one window
    strong             2011..2032, 7001..7020        37, 41, 37      .37  .46  .69   3.2  1.5  2.7
                       9001..9018                    16, 18, 18      .42  .39  .70   1.8   .9  2.1
    weak               2001..2020, 7001..7020        37, 35, 36      .53  .73  .97   5.7  3.1  5.0
                       9001..9018                    17, 16, 15      .81  .48  1.2   2.7  2.1  3.0

Seeds 9001.. with today's six bands, the others with three. Median half widths of their six windows:
1.1 .9 1.3 % (strong), 1.3 1.0 1.5 %, 1.9 2.0 2.6 %, 4.8 6.1 7.6 %; of one strong window 1.6 1.3
1.9 %. rms of error over standard deviation .4 to 1.0. Wrong pairs: one, mode 10 of seed 9005. A
refresh 1.3 s CPU with all modes, .9 s with the eleven. Of structures that differ, seeds 7001..7020
with one window and with two: `guards`.
"""

import argparse
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from pipeline.messages import FoundationPosterior, ModalEstimate, ModePair, WindowRejected
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.prior import PARAMETER_NAMES
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.updater import FoundationUpdater
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from tests.benchmarks._cases import (
    LAYOUT,
    LOADS,
    SAME_STRUCTURES,
    STRUCTURES,
    Case,
    Window,
    described,
    kept,
    true_ratios,
)

FIRST_SEED = 1001  # of the truths and the loads. The floors and tails of the likelihood were chosen
# while looking at seeds 1001 to 1010: other first seeds are the honest test
PAPERS_MODES = tuple(str(number) for number in range(1, 12))
HIGHEST_PAIRED = 14.0  # [Hz], where a mode of the model may have risen to from 12.5 Hz at nominal
APART, RESOLUTION = 0.02, 1.5 / 600.0  # of a right pair: [-], [Hz]


@dataclass(frozen=True, slots=True)
class Recovery:
    """What came out of one run."""

    seed: int
    truth: FloatArray  # (3,) ratios to nominal
    first: FoundationPosterior | None  # after one window
    posterior: FoundationPosterior | None  # after the last one
    rejected: tuple[WindowRejected, ...]
    identify_s: float  # CPU a window
    update_s: float  # CPU of the last refresh
    wrong_pairs: tuple[ModePair, ...]  # in the last posterior


@dataclass(frozen=True, slots=True)
class Options:
    """How a case is run."""

    every_window: bool = False
    keep: Path | None = None
    settings: UpdatingSettings | None = None


def answers(
    windows: Sequence[Window], case: Case, options: Options
) -> tuple[list[FoundationPosterior | WindowRejected], float]:
    """What the updater says to the windows it is asked about, and the last refresh's CPU [s]."""
    forward = ModalModel(described(case.sign), LAYOUT)
    updater = FoundationUpdater(forward, LAYOUT, options.settings, seed=case.seed)
    state = updater.initial_state()
    found: list[FoundationPosterior | WindowRejected] = []
    seconds = 0.0
    for number, window in enumerate(windows):
        if not isinstance(window, ModalEstimate):
            found.append(window)
        elif options.every_window or number in (0, len(windows) - 1):
            begun = time.process_time()
            state, answer = updater.updated(state, window)
            seconds = time.process_time() - begun
            found.append(answer)
        else:
            state = replace(state, evidence=state.evidence.with_estimate(window))
    return found, seconds


def recovered(case: Case, options: Options) -> Recovery:
    """One seed from loads to posterior."""
    begun = time.process_time()
    windows = kept(case, options.keep)
    identified = time.process_time()
    found, seconds = answers(windows, case, options)
    posteriors = [each for each in found if isinstance(each, FoundationPosterior)]
    last = found[-1] if found else None
    return Recovery(
        seed=case.seed,
        truth=true_ratios(case.seed),
        first=posteriors[0] if posteriors and posteriors[0].n_windows == 1 else None,
        posterior=last if isinstance(last, FoundationPosterior) else None,
        rejected=tuple(each for each in found if isinstance(each, WindowRejected)),
        identify_s=(identified - begun) / case.windows,
        update_s=seconds,
        wrong_pairs=wrong_pairs(last, case) if isinstance(last, FoundationPosterior) else (),
    )


def wrong_pairs(posterior: FoundationPosterior, case: Case) -> tuple[ModePair, ...]:
    """Pairs whose model mode is not, at the true stiffness, the identified one.

    Another of the true modes is nearer to it by more than ten minutes resolve, and the shape does
    not speak for its partner; or it is none of them, further than 2 % from its partner. A partner
    that was identified with a large error is still the right one. None where the true structure is
    not the model's: there are no right pairs then.
    """
    if case.structure not in SAME_STRUCTURES:
        return ()
    model = ModalModel(described(case.sign), LAYOUT, highest_frequency=HIGHEST_PAIRED)
    median = np.array([posterior.parameter(name).median for name in PARAMETER_NAMES])
    local = model.following(median)  # names change places where modes cross on the way to nominal
    modes = local.modal(np.array([median, model.nominal * true_ratios(case.seed)]))
    shown, true = modes.frequencies
    apart = angle(modal_assurance_criterion(modes.shapes[1], modes.shapes[1]))
    found = []
    for pair in posterior.pairs:
        own = int(np.argmin(np.abs(shown - pair.model_frequency)))
        distances = np.abs(true - pair.frequency)
        nearest = int(np.argmin(distances))
        # by the triangle of angles, a shape this near to its partner's is nearer to no other
        own_shape = 2 * angle(pair.mac) < apart[own, nearest]
        taken = distances[own] - distances[nearest] > RESOLUTION and not own_shape
        if taken or distances[own] > APART * pair.frequency:
            found.append(pair)
    return tuple(found)


def angle(mac: FloatArray | float) -> FloatArray:
    """Between two shapes, arccos √MAC [rad]."""
    return np.asarray(np.arccos(np.sqrt(np.clip(mac, 0.0, 1.0))))


def main(arguments: list[str]) -> None:
    """Run the seeds and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks recovery")
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=FIRST_SEED)
    parser.add_argument("--windows", type=int, default=6)
    parser.add_argument("--load", choices=sorted(LOADS), default="strong")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--structure", choices=tuple(STRUCTURES), default="finer")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--every-window", action="store_true", help="refresh after each window")
    parser.add_argument("--eleven", action="store_true", help="compare the paper's modes only")
    parser.add_argument("--keep", type=Path, help="folder of windows identified once for all")
    chosen = parser.parse_args(arguments)
    compared = LikelihoodSettings(modes=PAPERS_MODES if chosen.eleven else ())
    options = Options(chosen.every_window, chosen.keep, UpdatingSettings(likelihood=compared))
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.seeds)
    cases = [
        Case(seed, chosen.windows, chosen.load, chosen.sign, chosen.structure) for seed in seeds
    ]
    results = []
    with ProcessPoolExecutor(chosen.processes) as pool:
        for result in pool.map(partial(recovered, options=options), cases):
            print(lines(result), flush=True)
            results.append(result)
    print_tables(results, chosen.windows)


def print_tables(results: Sequence[Recovery], n_windows: int) -> None:
    """After one window and after all, and what was trusted."""
    first = [each.first for each in results]
    last = [each.posterior for each in results]
    for name, posteriors in (("one window", first), (f"{n_windows} windows", last)):
        print(f"\n{name}")
        print(table([(r.truth, p) for r, p in zip(results, posteriors, strict=True) if p]))
        print(
            f"trusted {sum(p is not None and p.trusted for p in posteriors)}, refused "
            f"{posteriors.count(None)} of {len(results)}"
        )
    identify, update = (
        np.mean([getattr(r, n) for r in results]) for n in ("identify_s", "update_s")
    )
    print(f"\nwrong pairs {sum(len(each.wrong_pairs) for each in results)}")
    print(f"CPU: simulating and identifying a window {identify:.2f} s, a refresh {update:.2f} s")


def figures(
    truth: FloatArray, posterior: FoundationPosterior
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(covered, error, half width), each (3,): in or out, and shares of the truth [-]."""
    parameters = [posterior.parameter(name) for name in PARAMETER_NAMES]
    nominal = np.array([each.nominal for each in parameters])
    bounds = np.array([[each.p05, each.p95] for each in parameters]) / nominal[:, None]
    low, high = np.sort(bounds, axis=1).T
    median = np.array([each.median for each in parameters]) / nominal
    covered = ((low <= truth) & (truth <= high)).astype(float)
    return covered, median / truth - 1, (high - low) / 2 / truth


def lines(result: Recovery) -> str:
    """One seed in words: after one window, after all."""
    every = [] if result.first is None else [_line(result, result.first)]
    if result.posterior is None:
        every.append(f"{result.seed}: refused; {[each.reason for each in result.rejected]}")
    elif result.posterior is not result.first:
        every.append(_line(result, result.posterior))
    every += [
        f"{result.seed}: wrongly {pair.frequency:.4f} ± {pair.frequency_std:.4f} Hz with the "
        f"model's {pair.model} at {pair.model_frequency:.4f} Hz, MAC {pair.mac:.3f}"
        for pair in result.wrong_pairs
    ]
    return "\n".join(every)


def _line(result: Recovery, posterior: FoundationPosterior) -> str:
    covered, error, half = figures(result.truth, posterior)
    each = "  ".join(
        f"{name} {100 * e:+6.2f} ± {100 * h:4.2f} %{' ' if c else '!'}"
        for name, c, e, h in zip(PARAMETER_NAMES, covered, error, half, strict=True)
    )
    return (
        f"{result.seed}, {posterior.n_windows}: {each}  "
        f"σ {100 * posterior.parameter('sigma').median:.3f} %  "
        f"χ² {posterior.reduced_chi_square:4.1f}  paired {posterior.paired_share:.2f} "
        f"({len(posterior.pairs)})  cost {posterior.pairing_cost:4.2f}  "
        f"{'trusted' if posterior.trusted else 'UNTRUSTED'}  ess {posterior.ess:.0f} of "
        f"{posterior.sampler}  {result.update_s:.1f} s"
    )


def table(found: Sequence[tuple[FloatArray, FoundationPosterior]]) -> str:
    """Coverage, errors and widths over all seeds that gave a posterior. found: truth and it."""
    if not found:
        return "no posterior"
    columns = zip(*(figures(*each) for each in found), strict=True)
    covered, error, half = (np.array(column) for column in columns)
    rows = {
        f"90 % intervals that hold the truth, of {len(found)}": covered.sum(axis=0),
        "median error %": 100 * np.median(np.abs(error), axis=0),
        "worst error %": 100 * np.abs(error).max(axis=0),
        "median half width %": 100 * np.median(half, axis=0),
        "rms error / (half width / 1.645)": np.sqrt(np.mean((error / (half / 1.645)) ** 2, axis=0)),
    }
    text = [f"{'':45s}" + "".join(f"{name:>9s}" for name in PARAMETER_NAMES)]
    text += [f"{name:45s}" + "".join(f"{v:9.2f}" for v in values) for name, values in rows.items()]
    text.append(f"pooled cover {covered.mean():.3f}")
    return "\n".join(text)
