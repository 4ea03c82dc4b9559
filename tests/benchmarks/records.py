"""Unknown structures in records of every kind: what is found blind in a text file of channels.

    python -m tests.benchmarks records [--records 100] [--first-seed 3001] [--list]

Every seed draws a shear frame of 2 to 10 storeys under random loads on its storeys, 2 to 8
channels of it, and how it was measured: 15 to 425 Hz, 1 to 60 minutes, accelerations, velocities,
displacements or a mixture, 1 to 10 % of noise, and one difficulty. The record is written as CSV
and read back. A mode could be found where it lies below 0.4 of the sampling rate, the record
holds 100 of its periods, and its peak stands ten times above the noise in a channel.

found      an identified mode within max(3 std, 1 %) of the true frequency, MAC .8 or more
spurious   identified modes near no mode that the structure has
cover      95 % intervals of the found modes' frequencies
"""

import argparse
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.linalg import eigh
from scipy.signal import decimate, lfilter

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.offline.identify_file import FileIdentification, identify_file
from sensors.arrays import FloatArray

OVERSAMPLING = 4  # of the simulation over the record
EDGE = 0.4  # of the sampling rate; above it an anti-alias filter lies
FEWEST_PERIODS = 100
LONGEST = 400_000  # samples of a record
EXPECTED = {"uneven-clock": "uneven clock", "non-stationary": "shut-down"}  # code: difficulty
PEAK_OVER_NOISE = 10.0  # of power spectral densities
QUANTITIES = ("acceleration", "velocity", "displacement")
UNITS = {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m"}


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """A shear frame clamped at its foot: the modes that a record of it may show."""

    frequencies: FloatArray  # (n_modes,) [Hz]
    damping_ratios: FloatArray  # (n_modes,) [-]
    shapes: FloatArray  # (n_storeys, n_modes), scaled to unit modal mass [-]


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """A measurement as a file holds it, and the truth behind it."""

    times: FloatArray  # (n,) [s]
    samples: FloatArray  # (n, n_channels)
    quantities: tuple[str, ...]  # of each channel
    sampling_rate: float  # [Hz]
    frequencies: FloatArray  # of all modes below half the sampling rate [Hz]
    shapes: FloatArray  # of these, as the channels see them, (n_modes, n_channels)
    findable: NDArray[np.bool_]  # (n_modes,)
    difficulty: str


def random_frame(generator: np.random.Generator, first_frequency: float) -> Frame:
    """2 to 10 storeys of unlike masses and stiffnesses; damping ratios .5 to 3 %."""
    n = int(generator.integers(2, 11))
    mass = generator.uniform(0.5, 1.5, n)
    k = generator.uniform(0.5, 1.5, n) * np.linspace(1.5, 0.7, n)
    stiffness = np.diag(k + np.append(k[1:], 0.0)) - np.diag(k[1:], 1) - np.diag(k[1:], -1)
    values, vectors = eigh(stiffness, np.diag(mass))
    omega = np.sqrt(values)
    return Frame(
        frequencies=first_frequency * omega / omega[0],
        damping_ratios=generator.uniform(0.005, 0.03, n),
        shapes=vectors,
    )


def plain(load: FloatArray, rate: float, generator: np.random.Generator) -> FloatArray:
    """Stationary white loads."""
    return load


def coloured(load: FloatArray, rate: float, generator: np.random.Generator) -> FloatArray:
    """Loads that fall with frequency, as of wind and sea."""
    corner = np.exp(-2 * np.pi * 0.02)
    return np.asarray(lfilter([1 - corner], [1, -corner], load, axis=0)) + 0.05 * load


def gusty(load: FloatArray, rate: float, generator: np.random.Generator) -> FloatArray:
    """Loads whose strength wanders by a factor of two about its mean."""
    knots = np.exp(0.5 * generator.standard_normal(12))
    return load * np.interp(np.linspace(0, 11, len(load)), np.arange(12), knots)[:, None]


def shut_down(load: FloatArray, rate: float, generator: np.random.Generator) -> FloatArray:
    """Loads five times as strong for a tenth of the record."""
    strength = np.ones(len(load))
    begin = int(generator.uniform(0.1, 0.8) * len(load))
    strength[begin : begin + len(load) // 10] = 5.0
    return load * strength[:, None]


LOADS: dict[str, Callable[[FloatArray, float, np.random.Generator], FloatArray]] = {
    "plain": plain,
    "coloured load": coloured,
    "gusty load": gusty,
    "shut-down": shut_down,
    "uneven clock": plain,
}


def draw_record(seed: int, longest: int = LONGEST) -> Record:
    """The record of a seed, of `longest` samples at most; seeds in turn go through the
    difficulties."""
    generator = np.random.default_rng(seed)
    difficulty = list(LOADS)[seed % len(LOADS)]
    rate = float(np.exp(generator.uniform(np.log(15), np.log(425))))
    duration = float(np.exp(generator.uniform(np.log(60), np.log(3600))))
    duration = min(duration, longest / rate)
    first = float(
        np.exp(generator.uniform(np.log(max(rate / 200, 60 / duration)), np.log(rate / 8)))
    )
    frame = random_frame(generator, first)
    places = generator.choice(
        len(frame.shapes),
        size=int(generator.integers(2, min(8, len(frame.shapes)) + 1)),
        replace=False,
    )
    mixed = generator.random() < 0.3
    one = QUANTITIES[int(generator.integers(3))] if generator.random() < 0.5 else "acceleration"
    quantities = tuple(str(generator.choice(QUANTITIES)) if mixed else one for _ in places)
    response, modal_share = simulate(
        frame, places, quantities, LOADS[difficulty], rate, duration, generator
    )
    deviation = generator.uniform(0.01, 0.1) * response.std(axis=0)
    times = np.arange(len(response)) / rate
    if difficulty == "uneven clock":
        even = times
        times = np.sort(even + generator.uniform(-0.2, 0.2, len(even)) / rate)
        response = CubicSpline(even, response, axis=0)(np.clip(times, even[0], even[-1]))
    samples = response + deviation * generator.standard_normal(response.shape)
    below = frame.frequencies < 0.5 * rate
    peak = modal_share / (np.pi * frame.damping_ratios * frame.frequencies)[:, None]  # [unit²/Hz]
    heard = (peak > PEAK_OVER_NOISE * 2 * deviation**2 / rate).any(axis=1)
    inside = (frame.frequencies < EDGE * rate) & (frame.frequencies * duration > FEWEST_PERIODS)
    seen = frame.shapes[places].T  # of mixed quantities, the shapes of accelerations
    return Record(
        times=times,
        samples=samples,
        quantities=quantities,
        sampling_rate=rate,
        frequencies=frame.frequencies[below],
        shapes=seen[below],
        findable=(heard & inside)[below],
        difficulty=difficulty,
    )


def simulate(
    frame: Frame,
    places: NDArray[np.int_],
    quantities: tuple[str, ...],
    load_of: Callable[[FloatArray, float, np.random.Generator], FloatArray],
    rate: float,
    duration: float,
    generator: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """What the channels read without noise, (n, n_channels), and the variance that each mode adds
    to each of them, (n_modes, n_channels)."""
    fine = OVERSAMPLING * rate
    n_warm = round(3 / (frame.damping_ratios * frame.frequencies).min() / 2 * fine)
    n = round(duration * rate) * OVERSAMPLING
    load = generator.standard_normal((n_warm + n, len(frame.shapes)))
    forces = load_of(load, fine, generator) @ frame.shapes
    response = np.zeros((n, len(places)))
    variances = np.empty((len(frame.frequencies), len(places)))
    for mode, (f, zeta) in enumerate(zip(frame.frequencies, frame.damping_ratios, strict=True)):
        by_quantity = {
            q: oscillator(f, zeta, fine, forces[:, mode], q)[n_warm:] for q in set(quantities)
        }
        seen = np.column_stack(
            [
                by_quantity[q] * frame.shapes[p, mode]
                for q, p in zip(quantities, places, strict=True)
            ]
        )
        variances[mode] = seen.var(axis=0)
        response += seen
    return decimate(response, OVERSAMPLING, ftype="fir", axis=0), variances


def oscillator(
    frequency: float, damping: float, rate: float, force: FloatArray, quantity: str
) -> FloatArray:
    """Response to an impulse of `force` at every step: one complex coordinate, whose derivatives
    are its products with the pole μ, so that all quantities are of one instant."""
    omega = 2 * np.pi * frequency
    pole = (-damping + 1j * np.sqrt(1 - damping**2)) * omega
    coordinate = lfilter([1.0 / pole.imag], [1.0, -np.exp(pole / rate)], force.astype(complex))
    power = 2 - QUANTITIES.index(quantity)
    return np.asarray((pole**power * coordinate).imag)


def write(record: Record, path: Path) -> None:
    """As a logger would: a time column in seconds, units in brackets."""
    titles = [f"ch{i + 1} [{UNITS[q]}]" for i, q in enumerate(record.quantities)]
    columns = np.column_stack([record.times, record.samples])
    np.savetxt(
        path, columns, delimiter=",", header=",".join(["t [s]", *titles]), comments="", fmt="%.9g"
    )


@dataclass(frozen=True, slots=True)
class Judged:
    """How a record's modes were found."""

    findable: int = 0
    found: int = 0
    covered: int = 0
    modes: int = 0
    spurious: int = 0
    rejected: int = 0
    false_alarms: int = 0  # warnings of what the record has not

    def __add__(self, other: "Judged") -> "Judged":
        return Judged(*(getattr(self, n) + getattr(other, n) for n in self.__slots__))


def judge(record: Record, modes: tuple[Mode, ...]) -> Judged:
    """Each true mode is found once at most."""
    free = list(modes)
    found = covered = 0
    for place in np.flatnonzero(record.findable):
        mode = _nearest(free, record.frequencies[place], record.shapes[place])
        if mode is not None:
            free.remove(mode)
            found += 1
            covered += abs(mode.frequency - record.frequencies[place]) <= 1.96 * mode.frequency_std
    spurious = sum(not any(_near(mode, f, 0.02) for f in record.frequencies) for mode in free)
    return Judged(int(record.findable.sum()), found, covered, len(modes), spurious)


def false_alarms(record: Record, found: FileIdentification) -> int:
    """Warnings of a difficulty that the record does not have."""
    return sum(EXPECTED.get(w.code) != record.difficulty for w in found.warnings)


def _near(mode: Mode, frequency: float, tolerance: float) -> bool:
    return abs(mode.frequency - frequency) <= max(3 * mode.frequency_std, tolerance * frequency)


def _nearest(modes: list[Mode], frequency: float, shape: FloatArray) -> Mode | None:
    alike = [mode for mode in modes if _near(mode, frequency, 0.01) and _mac(mode, shape) >= 0.8]
    return min(alike, key=lambda mode: abs(mode.frequency - frequency), default=None)


def _mac(mode: Mode, shape: FloatArray) -> float:
    return float(modal_assurance_criterion(mode.shape[None], shape[None])[0, 0])


def run(record: Record, folder: Path) -> FileIdentification:
    """Through the file, as a user does it."""
    path = folder / "record.csv"
    write(record, path)
    return identify_file(path)


def main(arguments: list[str]) -> None:
    """Print what is found, by difficulty and by quantity."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks records")
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=3001)
    parser.add_argument("--list", action="store_true", help="every record")
    options = parser.parse_args(arguments)
    sums: dict[str, Judged] = defaultdict(Judged)
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(options.first_seed, options.first_seed + options.records):
            record = draw_record(seed)
            began = time.process_time()
            found = run(record, Path(folder))
            spent = time.process_time() - began
            modes = found.estimates[0].modes if found.estimates else ()
            judged = replace(
                judge(record, modes),
                rejected=len(found.rejected),
                false_alarms=false_alarms(record, found),
            )
            kinds = set(record.quantities)
            quantity = kinds.pop() if len(kinds) == 1 else "mixed"
            for key in (record.difficulty, quantity, "all"):
                sums[key] += judged
            if options.list:
                _print_record(seed, record, quantity, judged, found, spent)
    print(f"{'':16s} findable found  cover spurious rejected false alarms")
    for key, s in sums.items():
        print(
            f"{key:16s} {s.findable:8d} {s.found / max(1, s.findable):5.2f} "
            f"{s.covered / max(1, s.found):6.2f} {s.spurious:8d} {s.rejected:8d} "
            f"{s.false_alarms:12d}"
        )


def _print_record(
    seed: int,
    record: Record,
    quantity: str,
    judged: Judged,
    found: FileIdentification,
    spent: float,
) -> None:
    codes = sorted({warning.code for warning in found.warnings})
    print(
        f"{seed} {record.difficulty:14s} {quantity:12s} {record.samples.shape[1]} ch "
        f"{record.sampling_rate:6.1f} Hz {len(record.times) / record.sampling_rate:6.0f} s "
        f"{judged.found} of {judged.findable}, spurious {judged.spurious}, "
        f"{spent:.1f} s CPU, {codes}"
    )
