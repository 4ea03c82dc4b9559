"""Identification: speed against public implementations, and what it finds blind.

    python -m tests.benchmarks identification [speed] [blind SEEDS [FIRST_SEED]] [keep]
    python -m tests.benchmarks identification rates SEEDS FIRST_SEED [keep]

`speed` measures CPU time on one thread, 8 channels, 600 s; peers (pyOMA-2, koma-python) are
measured in the same run where they are installed. `blind` simulates the parked turbine at its
nominal foundation, an hour a seed, and identifies its six windows with the default settings;
`rates` does it at the sampling rates of other loggers. `keep` writes the results.
"""

import importlib.util
import logging
import time
import tracemalloc
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.oma.ssi.ssi_cov import lag_covariances, signal_subspace, system_modes
from pipeline.oma.ssi.uncertainty import (
    frequency_damping_deviations,
    order_deviations,
    pole_deviations,
    projected_deviations,
    shape_deviations,
    state_deviations,
)
from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import FullModes, full_modes
from sensors.simulation.tower import SimulatedTower, SimulationSettings
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep

LAYOUT = biaxial_layout(
    "benchmark", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
TABLE_1 = {  # label: direction and frequency at the nominal foundation [Hz]
    "1": ("SS", 0.1573),
    "2": ("FA", 0.1586),
    "3": ("FA", 0.6298),
    "4": ("SS", 1.0764),
    "5": ("FA", 1.0997),
    "6": ("FA", 1.8163),
    "7": ("FA", 2.5983),
    "8": ("FA", 3.8002),
    "9": ("FA", 5.8584),
    "10": ("FA", 10.468),
    "11": ("FA", 12.117),
}
HIGHEST_JUDGED = 12.5  # [Hz]
FIRST_SEED = 1000
WINDOWS_OF_SET = 6  # of a seed
EDGE = 0.43  # of the sampling rate, from which an anti-alias filter lies [-]
RATES = (20.0, 25.0, 50.0, 64.0, 100.0, 128.0, 200.0, 256.0)  # of loggers [Hz]
SLOW_MODES = ("1", "2", "3", "4", "5", "6")  # that speak most of the foundation


def main(arguments: list[str]) -> None:
    """Print the tables asked for; both by default, `blind` with 4 seeds."""
    if not arguments or "speed" in arguments:
        ratios = speed()
        if "keep" in arguments:
            keep(
                "identification-speed",
                ratios,
                command="python -m tests.benchmarks identification speed keep",
                seeds=(FIRST_SEED,),
                depends=("pipeline/oma",),
            )
    if "rates" in arguments:
        n_seeds, first = (int(word) for word in arguments if word.isdigit())
        found = at_rates(n_seeds, first)
        if "keep" in arguments:
            keep(
                "identification-rates",
                found,
                command=f"python -m tests.benchmarks identification rates {n_seeds} {first} keep",
                seeds=range(first, first + n_seeds),
                depends=(
                    "pipeline/oma",
                    "sensors/simulation",
                    "tests/benchmarks/identification.py",
                ),
            )
    if not arguments or "blind" in arguments:
        after = arguments[arguments.index("blind") + 1 :] if arguments else []
        numbers = [int(word) for word in after if word.isdigit()]
        first = numbers[1] if len(numbers) > 1 else FIRST_SEED
        figures = blind(numbers[0] if numbers else 4, first)
        if "keep" in arguments:
            keep(
                "identification-blind",
                figures,
                command="python -m tests.benchmarks identification "
                f"blind {numbers[0]} {first} keep",
                seeds=range(first, first + numbers[0]),
                depends=(
                    "pipeline/oma",
                    "sensors/simulation",
                    "tests/benchmarks/identification.py",
                ),
            )


def parked_record(seed: int, duration: float, sampling_rate: float = 40.0) -> FloatArray:
    settings = SimulationSettings(seed=seed, duration=duration, sampling_rate=sampling_rate)
    tower = SimulatedTower(load_turbine("iea15mw_monopile"), LAYOUT, settings)
    return np.concatenate(list(tower.samples())).astype(np.float64)


# --- speed ---------------------------------------------------------------------------------------


def cpu(function: Callable[[], object], repetitions: int = 5) -> float:
    """Median CPU time of a call [s]."""
    times = []
    for _ in range(repetitions):
        begin = time.process_time()
        function()
        times.append(time.process_time() - begin)
    return float(np.median(times))


def in_turns(functions: dict[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Median CPU time of each [s]. Called in turns, so that whatever else keeps the machine busy
    meets all of them alike; the first round warms up."""
    times: dict[str, list[float]] = {name: [] for name in functions}
    for _ in range(rounds + 1):
        for name, function in functions.items():
            times[name].append(cpu(function, 1))
    return {name: float(np.median(each[1:])) for name, each in times.items()}


def ratios_to_peers(title: str, times: dict[str, float]) -> dict[str, float]:
    """Print the times; what each peer took over ours [-]."""
    ours, *others = times.items()
    print(f"  {title}: pilewatch {ours[1]:.3f}")
    for name, theirs in others:
        print(f"    {name} {theirs:.3f}: {theirs / ours[1]:.1f} times as long")
    return {name: round(theirs / ours[1], 1) for name, theirs in others}


def speed() -> dict[str, Any]:
    """CPU time over that of the peers that are installed."""
    record = parked_record(FIRST_SEED, 600.0)
    thirty = record[: 600 * 30] - record[: 600 * 30].mean(axis=0)  # taken as sampled at 30 Hz
    thirty /= thirty.std(axis=0)
    print("SSI-cov, 8 channels, 18 000 samples, all channels references, CPU s on one thread")
    plain: dict[str, Callable[[], object]] = {
        "ours": lambda: every_order(thirty, rows=100, orders=range(2, 62, 2))
    }
    plain |= peers(thirty, rows=100, highest=60)
    figures: dict[str, Any] = {}
    figures["without uncertainty"] = ratios_to_peers(
        "without uncertainty, 100 block rows, orders 2..60 step 2", in_turns(plain, 5)
    )
    uncertain: dict[str, Callable[[], object]] = {
        "ours": lambda: every_uncertainty(thirty, rows=30, orders=range(2, 31))
    }
    if importlib.util.find_spec("pyoma2"):
        uncertain["pyOMA-2"] = lambda: run_pyoma(
            thirty, rows=30, highest=30, step=1, uncertain=True
        )
    figures["with uncertainty"] = ratios_to_peers(
        "with uncertainty of every pole, 30 block rows, orders 2..30", in_turns(uncertain, 5)
    )
    memory = peak_memory(lambda: every_uncertainty(thirty, rows=60, orders=range(2, 31)))
    print(f"  peak memory with uncertainty, 60 block rows: {memory:.0f} MB")
    if importlib.util.find_spec("pyoma2"):
        theirs = peak_memory(lambda: run_pyoma(thirty, rows=60, highest=30, step=1, uncertain=True))
        figures["memory"] = {"pyOMA-2": round(theirs / memory)}
        print(f"    pyOMA-2 {theirs:.0f} MB: {theirs / memory:.0f} times as much")
    whole = cpu(lambda: identify(record, 40.0), 3)
    print(f"  all bands, 10 min at 40 Hz, samples to modes: {whole:.3f}")
    return figures | {"ten_minutes_cpu_s": round(whole, 2)}


def every_order(samples: FloatArray, *, rows: int, orders: Sequence[int]) -> None:
    covariances = lag_covariances(
        samples, n_lags=2 * rows, block_length=(len(samples) - 2 * rows) // 4
    )
    subspace = signal_subspace(covariances.mean, block_rows=rows, highest_order=max(orders))
    for _ in system_modes(subspace, orders=orders, sampling_interval=1 / 30):
        pass


def every_uncertainty(samples: FloatArray, *, rows: int, orders: Sequence[int]) -> None:
    """f, ζ and φ of every pole of every order, as pyOMA-2 computes them."""
    length = (len(samples) - 2 * rows) // 50
    covariances = lag_covariances(samples, n_lags=2 * rows, block_length=length)
    subspace = signal_subspace(covariances.mean, block_rows=rows, highest_order=max(orders))
    projected = projected_deviations(subspace, covariances.deviations)
    for system in system_modes(subspace, orders=orders, sampling_interval=1 / 30):
        chosen = np.arange(len(system.poles))
        moved = state_deviations(order_deviations(projected, system), chosen)
        frequency_damping_deviations(system.poles, pole_deviations(moved), 1 / 30)
        shape_deviations(moved)


def peak_memory(function: Callable[[], object]) -> float:
    """Above the level before the call [MB]."""
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    function()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return (peak - before) / 1e6


def peers(samples: FloatArray, *, rows: int, highest: int) -> dict[str, Callable[[], object]]:
    """What is installed of the public implementations."""
    found: dict[str, Callable[[], object]] = {}
    if importlib.util.find_spec("koma"):
        found["koma-python"] = lambda: run_koma(samples, rows=rows, highest=highest)
    if importlib.util.find_spec("pyoma2"):
        found["pyOMA-2"] = lambda: run_pyoma(samples, rows=rows, highest=highest, step=2)
    return found


def run_koma(samples: FloatArray, *, rows: int, highest: int) -> None:
    from koma.oma import covssi

    covssi(samples, 30.0, rows, np.arange(2, highest + 2, 2), showinfo=False)


def run_pyoma(
    samples: FloatArray, *, rows: int, highest: int, step: int, uncertain: bool = False
) -> None:
    from pyoma2.algorithms import SSI
    from pyoma2.setup.single import SingleSetup

    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        setup = SingleSetup(samples.copy(), fs=30.0)
        setup.add_algorithms(
            SSI(name="ssi", br=rows, ordmin=2, ordmax=highest, step=step, calc_unc=uncertain)
        )
        setup.run_by_name("ssi")
    logging.disable(logging.NOTSET)


# --- blind ---------------------------------------------------------------------------------------


def blind(n_seeds: int, first_seed: int = FIRST_SEED) -> dict[str, float]:
    """Print the table; return its main figures."""
    truth = full_modes(
        load_turbine("iea15mw_monopile"),
        LAYOUT,
        tube_refinement=2,
        highest_frequency=1.1 * HIGHEST_JUDGED,  # a mode judged may belong to a true one above
    )
    windows: list[Sequence[Mode]] = []
    spent = 0.0
    for seed in range(first_seed, first_seed + n_seeds):
        record = parked_record(seed, 3600.0)
        begin = time.process_time()
        windows += [identify(part, 40.0).modes for part in np.split(record, 6)]
        spent += time.process_time() - begin
    print(f"{len(windows)} windows of 10 min, {spent / len(windows):.2f} s CPU each")
    print(
        " mode    true Hz  found  rms f %  mean MAC  cover95  std empirical/stated: f     ζ     φ"
    )
    everything = [judged_mode(label, truth, windows) for label in TABLE_1]
    covered = np.concatenate([np.abs(each.z) < 1.96 for each in everything])
    print(f"95 % intervals of f, pooled: {covered.mean():.3f} (.92 to .98)")
    ratios = np.median([each.ratios for each in everything if each.often], axis=0)
    print("std empirical / stated, median over modes: " + ", ".join(f"{r:.2f}" for r in ratios))
    print("  of f, ζ, φ (.85 to 1.2)")
    figures = {"windows": float(len(windows)), "cpu_s": spent / len(windows)}
    for label, each in zip(TABLE_1, everything, strict=True):
        figures[f"found_{label}"] = len(each.z) / len(windows)
        figures[f"rms_percent_{label}"] = each.rms_percent
    figures["cover95"] = float(covered.mean())
    for label in ("7", "11"):
        share = mixtures(label, truth, windows)
        figures[f"mixtures_{label}"] = share
        print(f"mode {label}: a mixture passed off as one in {share:.3f} of windows (at most .02)")
    figures["spurious"], figures["duplicates"] = false_modes(truth, windows)
    return figures | high_band_bias(truth, windows, n_seeds)


def at_rates(n_seeds: int, first_seed: int) -> dict[str, float]:
    """Print and return what is found of each mode at each logger's rate, where the rate reaches.

    The simulator has no anti-alias filter: what lies above half a rate is folded into the record,
    and modes that are none are not counted.
    """
    truth = full_modes(
        load_turbine("iea15mw_monopile"), LAYOUT, tube_refinement=2, highest_frequency=13.5
    )
    figures: dict[str, float] = {"windows": float(WINDOWS_OF_SET * n_seeds)}
    shares, rarest, holds = [], [], []
    for rate in RATES:
        records = (parked_record(first_seed + k, 3600.0, rate) for k in range(n_seeds))
        windows = [
            identify(part, rate).modes
            for record in records
            for part in np.split(record, WINDOWS_OF_SET)
        ]
        print(f"{rate:g} Hz")
        reached = [label for label in TABLE_1 if TABLE_1[label][1] < EDGE * rate]
        everything = {label: judged_mode(label, truth, windows) for label in reached}
        found = {label: len(each.z) / len(windows) for label, each in everything.items()}
        holds += [np.abs(each.z) < 1.96 for each in everything.values()]
        shares.append(float(np.mean(list(found.values()))))
        rarest.append(min(found[label] for label in SLOW_MODES))
        figures[f"found_{rate:g}"], figures[f"rarest_slow_{rate:g}"] = shares[-1], rarest[-1]
    figures["cover95"] = float(np.mean(np.concatenate(holds)))
    return figures | {"least_found": min(shares), "rarest_slow": min(rarest)}


def high_band_bias(
    truth: FullModes, windows: Sequence[Sequence[Mode]], n_sets: int
) -> dict[str, float]:
    """Print and return the largest mean error of a mode above 5 Hz over independent sets of
    windows, its standard error, and how many modes a window has near the anti-alias edge."""
    sets = [windows[k * WINDOWS_OF_SET : (k + 1) * WINDOWS_OF_SET] for k in range(n_sets)]
    biases = []
    for f, shape in zip(truth.frequencies, truth.shapes, strict=True):
        if not 5.0 < f < HIGHEST_JUDGED:
            continue
        means = []
        for each in sets:
            found = [m.frequency for modes in each if (m := match(modes, float(f), shape))]
            if found:
                means.append(100 * (np.mean(found) / f - 1))
        if len(means) >= max(2, n_sets // 2):
            biases.append(
                (
                    float(f),
                    float(np.mean(means)),
                    float(np.std(means, ddof=1) / np.sqrt(len(means))),
                )
            )
    for f, mean, error in sorted(biases, key=lambda each: -abs(each[1]))[:4]:
        print(f"bias of {f:.3f} Hz: {mean:+.3f} % (standard error {error:.3f} %)")
    edge = sum(mode.frequency > EDGE * 40.0 for modes in windows for mode in modes) / len(windows)
    print(f"{len(biases)} modes of 5 to {HIGHEST_JUDGED} Hz; above {EDGE} fs {edge:.2f} a window")
    worst = max(biases, key=lambda each: abs(each[1]), default=(np.nan, np.nan, np.nan))
    return {
        "bias_modes": float(len(biases)),
        "bias_largest_percent": worst[1],
        "bias_largest_standard_error": worst[2],
        "bias_rms_percent": float(np.sqrt(np.mean([each[1] ** 2 for each in biases]))),
        "above_edge_a_window": edge,
    }


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """How well one mode was found over many windows."""

    z: FloatArray  # (n_found,) error of f over its stated std
    ratios: FloatArray  # (3,) empirical over stated std of f, ζ and φ
    often: bool  # found in half of the windows
    rms_percent: float  # of the frequency's error; NaN where found too rarely


def judged_mode(label: str, truth: FullModes, windows: Sequence[Sequence[Mode]]) -> Judged:
    """Prints one line."""
    index = true_index(label, truth)
    f, shape = truth.frequencies[index], truth.shapes[index]
    found = [mode for modes in windows if (mode := match(modes, float(f), shape)) is not None]
    if len(found) < 3:
        print(f"{label:>5} {f:10.4f} {len(found) / len(windows):6.2f}")
        return Judged(np.empty(0), np.full(3, np.nan), often=False, rms_percent=float("nan"))
    error = np.array([mode.frequency - f for mode in found])
    z = error / np.array([mode.frequency_std for mode in found])
    macs = [mac(mode.shape, shape) for mode in found]
    ratios = std_ratios(found)
    rms = float(100 * np.sqrt(np.mean(error**2)) / f)
    print(
        f"{label:>5} {f:10.4f} {len(found) / len(windows):6.2f} "
        f"{rms:8.3f} {np.mean(macs):9.4f} "
        f"{np.mean(np.abs(z) < 1.96):8.2f} {'':25}" + " ".join(f"{r:5.2f}" for r in ratios)
    )
    return Judged(z, ratios, often=2 * len(found) >= len(windows), rms_percent=rms)


def std_ratios(found: Sequence[Mode]) -> FloatArray:
    """(3,) scatter of f, ζ and φ over the windows by the root of the mean stated variance.

    Shapes are compared with one component, the one most often the largest, set to 1.
    """
    unit = int(np.bincount([mode.unit_component for mode in found]).argmax())
    alike = [mode for mode in found if mode.unit_component == unit]
    quantities = (
        ([m.frequency for m in found], [m.frequency_std for m in found]),
        ([m.damping_ratio for m in found], [m.damping_ratio_std for m in found]),
    )
    ratios = [float(np.std(v, ddof=1) / np.sqrt(np.mean(np.square(s)))) for v, s in quantities]
    shapes = np.array([np.delete(m.shape, unit) for m in alike])
    stds = np.array([np.delete(m.shape_std, unit) for m in alike])
    scatter = shapes.std(axis=0, ddof=1) if len(alike) > 2 else np.full(shapes.shape[1], np.nan)
    ratios.append(float(np.median(scatter / np.sqrt((stds**2).mean(axis=0)))))
    return np.array(ratios)


def mixtures(label: str, truth: FullModes, windows: Sequence[Sequence[Mode]]) -> float:
    """Share of windows with a mode beside this one and its partner that is neither of the two.

    Beside: nearer to the pair's middle than three times their distance. Neither: the true mode
    nearest to it lies beyond 3 std, or has a MAC below .8 with it.
    """
    index = true_index(label, truth)
    gaps = np.abs(truth.frequencies - truth.frequencies[index])
    gaps[index] = np.inf
    partner = int(np.argmin(gaps))
    middle = truth.frequencies[[index, partner]].mean()
    wrong = 0
    for modes in windows:
        beside = [m for m in modes if abs(m.frequency - middle) <= 3 * gaps[partner]]
        wrong += any(not is_true(mode, truth) for mode in beside)
    return wrong / len(windows)


def is_true(mode: Mode, truth: FullModes) -> bool:
    """Whether the nearest true mode is within 3 std and has the shape."""
    nearest = int(np.argmin(np.abs(truth.frequencies - mode.frequency)))
    error = abs(truth.frequencies[nearest] - mode.frequency)
    return bool(error <= 3 * mode.frequency_std and mac(mode.shape, truth.shapes[nearest]) >= 0.8)


def true_index(label: str, truth: FullModes) -> int:
    direction, frequency = TABLE_1[label]
    distance = np.abs(truth.frequencies / frequency - 1)
    distance[[d != direction for d in truth.directions]] = np.inf
    return int(np.argmin(distance))


def mac(shape_1: FloatArray, shape_2: FloatArray) -> float:
    return float(modal_assurance_criterion(shape_1[None], shape_2[None])[0, 0])


def match(modes: Sequence[Mode], f: float, shape: FloatArray) -> Mode | None:
    """The nearest mode within three std or half a percent that has the shape."""
    near = [
        mode
        for mode in modes
        if abs(mode.frequency - f) <= max(3 * mode.frequency_std, 0.005 * f)
        and mac(mode.shape, shape) >= 0.9
    ]
    return min(near, key=lambda mode: abs(mode.frequency - f), default=None)


def false_modes(truth: FullModes, windows: Sequence[Sequence[Mode]]) -> tuple[float, float]:
    """Print and return how many modes are no true one, and how many found twice, a window."""
    spurious = duplicates = count = 0
    for modes in windows:
        taken: list[int] = []
        for mode in (m for m in modes if m.frequency <= HIGHEST_JUDGED):
            count += 1
            gap = np.abs(truth.frequencies - mode.frequency)
            near = gap <= max(3 * mode.frequency_std, 0.005 * mode.frequency)
            alike = modal_assurance_criterion(mode.shape[None], truth.shapes)[0] >= 0.8
            if not (near & alike).any():
                spurious += 1
                continue
            nearest = int(np.argmin(np.where(near & alike, gap, np.inf)))
            duplicates += nearest in taken
            taken.append(nearest)
    n = len(windows)
    print(
        f"a window: {count / n:.1f} modes below {HIGHEST_JUDGED} Hz, {spurious / n:.2f} spurious, "
        f"{duplicates / n:.2f} duplicates"
    )
    return spurious / n, duplicates / n
