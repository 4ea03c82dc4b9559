"""Run the example over seeds and sign conventions, in two processes."""

import os
import signal
import threading
from collections.abc import Callable, Iterator, MutableMapping, Sequence
from concurrent.futures import FIRST_COMPLETED, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import product
from multiprocessing import (
    active_children,
    connection,
    get_context,
    parent_process,
    resource_tracker,
)

import numpy as np
from scipy.signal import find_peaks
from scipy.stats import gaussian_kde

from pipeline.reproduction.example import Example, ExamplePosterior, run_example
from pipeline.reproduction.paper import LABELS, SAMPLES
from sensors.arrays import FloatArray, one_blas_thread
from sensors.structure.foundation import SPRING_SIGNS, SpringSign

PROCESSES = 2
STUDY_LOOKS = 1.0  # between two looks at how far they are [s]
NOTABLE_STEP = 0.005  # of a run's share: smaller ones are not passed on [-]
PEAK_GRID = 200  # points of a marginal's density
NOTABLE_PEAK = 0.1  # of the highest peak, by which another stands out of the valleys beside it: the
# kernel makes ripples on a flank where draws are few


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """All seeds in both signs."""

    examples: tuple[Example, ...]
    """Results by sign, then seed."""
    samples: int
    """Samples of TMCMC as published."""

    def of(self, sign: SpringSign) -> tuple[Example, ...]:
        """Return the seeds of one sign, in order."""
        return tuple(example for example in self.examples if example.sign == sign)

    @property
    def first(self) -> Example:
        """The one that tables and figure show: the first seed in the published sign."""
        return self.of("published")[0]


def run_study(
    seeds: Sequence[int],
    *,
    signs: Sequence[SpringSign] = SPRING_SIGNS,
    samples: int = SAMPLES,
    report: Callable[[float], None] | None = None,
) -> Study:
    """Run every seed in every sign.

    Parameters
    ----------
    seeds : sequence of int
        Of the simulation and of the samplers.
    signs : sequence of SpringSign
        Of k12.
    samples : int
        Of TMCMC as published.
    report : callable, optional
        Called every second or so with how many runs are done, fractions included.

    Raises
    ------
    UpdatingError
        If a seed shows none of the publication's modes.
    """
    tasks = list(product(signs, seeds))
    found: dict[tuple[SpringSign, int], Example] = {}
    context = get_context("spawn")
    with ExitStack() as stack:
        with _interrupts_held():
            manager = stack.enter_context(context.Manager())
            pool = stack.enter_context(
                ProcessPoolExecutor(PROCESSES, mp_context=context, initializer=_follow_parent)
            )
            stack.enter_context(_ended_at_once())
            shares = manager.dict()
            running = {
                pool.submit(_one, sign, seed, samples, shares): (sign, seed) for sign, seed in tasks
            }
        waiting = set(running)
        while waiting:
            done, waiting = wait(waiting, timeout=STUDY_LOOKS, return_when=FIRST_COMPLETED)
            for each in done:
                found[running[each]] = each.result()
                shares[running[each]] = 1.0
            if report:
                report(sum(shares.values()))
    return Study(tuple(found[task] for task in tasks), samples)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Have Ctrl-C wait until processes have been started, which never get it then: a terminal sends
    it to all of them, and each would print where it was."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # its start would let interrupts through again
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _follow_parent() -> None:
    """End with the process that started this one, however that ends."""
    parent = parent_process()
    assert parent is not None

    def end() -> None:
        connection.wait([parent.sentinel])
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


@contextmanager
def _ended_at_once() -> Iterator[None]:
    """End the processes that run where this one is interrupted: they would be waited for."""
    try:
        yield
    except KeyboardInterrupt:
        for process in active_children():
            process.terminate()
        raise


def _one(
    sign: SpringSign,
    seed: int,
    samples: int,
    shares: MutableMapping[tuple[SpringSign, int], float],
) -> Example:
    def report(share: float) -> None:
        if share - shares.get((sign, seed), 0.0) > NOTABLE_STEP:
            shares[sign, seed] = share

    with one_blas_thread():
        return run_example(seed, sign, samples=samples, report=report)


def map_errors(example: Example) -> FloatArray:
    """Return the errors of k11, k22, k12 at the published sampler's MAP, shape (3,) [%]."""
    return 100.0 * (example.published.highest[:3] - 1)


def n_peaks(posterior: ExamplePosterior) -> int:
    """Most peaks of the three marginal densities, by a kernel estimate."""
    counts = []
    for values in posterior.draws[:, :3].T:
        low, high = np.quantile(values, [0.0005, 0.9995]).tolist()
        grid = np.linspace(low, high, PEAK_GRID)
        density = gaussian_kde(values[:: max(1, len(values) // 4000)])(grid)
        peaks, _ = find_peaks(density, prominence=NOTABLE_PEAK * density.max())
        counts.append(len(peaks))
    return max(counts)


def found_counts(examples: Sequence[Example]) -> dict[str, int]:
    """Return in how many seeds each of the eleven modes was found."""
    return {
        label: sum(np.isfinite(example.modes[row].frequency) for example in examples)
        for row, label in enumerate(LABELS)
    }


def lowest_start(example: Example) -> float:
    """γ of the start that ended lowest; of several that ended alike, the one nearest to 1."""
    least = min(descent.objective for descent in example.descents)
    alike = [d for d in example.descents if d.objective <= least * (1 + 1e-6) + 1e-12]
    return float(min((d.start[0] for d in alike), key=lambda gamma: abs(np.log(gamma))))
