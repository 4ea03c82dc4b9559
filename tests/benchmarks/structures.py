"""Random structures of every damping, noise and length: missed, invented, error over the bound.

    python -m tests.benchmarks structures [--first-seed 75001] [--records 60] [--below B] [--keep]

Every seed draws 2 to 10 modes (ζ .3 to 8 %, log-uniform), 2 to 8 channels, noise of 1 to 100 % of
each channel's rms and 5 to 60 minutes. A mode counts where its attainable frequency std is below
1 % and its neighbours are 2 % or more away.

attainable  std of f by the Fisher information of f, ζ and level of all modes at their true values,
            the shapes known:  I_ab = Σ_k tr(S⁻¹ ∂_a S S⁻¹ ∂_b S) over the lines k of the spectrum S
missed      no identified mode within max(3 std, 1 %) with a MAC of .8 (.5 where a component of the
            shape is known to .3 only)
invented    identified modes within max(3 std, 2 %) of no mode of the structure
duplicates  further identified modes beside one that was matched
cover       90 % intervals of f and ζ by class of ζ f T

`--below` leaves out records without a mode whose ζ f T is less: intervals of slow modes.
"""

from argparse import Namespace
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from sensors.arrays import BoolArray, FloatArray
from tests.benchmarks._results import keep
from tests.benchmarks._seeded import report, seeded_options, seeds_of

CLASSES = {"below 3": (0.0, 3.0), "3 to 10": (3.0, 10.0), "above 10": (10.0, np.inf)}  # ζ f T [-]
NINETY = 1.645  # std of a 90 % interval
LONGEST = 150_000  # samples of a record
FAR_OFF = 3.0  # bounds from which an error is listed [-]


@dataclass(frozen=True, slots=True, eq=False)
class Structure:
    """A record and the modes behind it."""

    frequencies: FloatArray
    """(n_modes,) [Hz]"""
    damping_ratios: FloatArray
    """(n_modes,) [-]"""
    shapes: FloatArray
    """(n_modes, n_channels) [-]"""
    attainable: FloatArray
    """Std of each frequency by the Fisher information, (n_modes,) [Hz]."""
    samples: FloatArray
    """(n, n_channels) [m/s²]"""
    sampling_rate: float
    """[Hz]"""

    @property
    def duration(self) -> float:
        """[s]"""
        return len(self.samples) / self.sampling_rate

    @property
    def judged(self) -> BoolArray:
        """Modes that could be found, (n_modes,)."""
        ratio = np.abs(self.frequencies[:, None] / self.frequencies[None, :] - 1)
        np.fill_diagonal(ratio, np.inf)
        return np.asarray((self.attainable < 0.01 * self.frequencies) & (ratio.min(axis=1) >= 0.02))


def draw(seed: int) -> Structure:
    """The structure and record of a seed."""
    generator = np.random.default_rng([seed, 16])

    def log_uniform(low: float, high: float, n: int | None = None) -> Any:
        return np.exp(generator.uniform(np.log(low), np.log(high), n))

    n_modes, n_channels = int(generator.integers(2, 11)), int(generator.integers(2, 9))
    first = log_uniform(0.15, 5.0)
    frequencies = np.sort(first * np.append(1.0, log_uniform(1.01, 30.0, n_modes - 1)))
    damping = log_uniform(0.003, 0.08, n_modes)
    rate = float(generator.uniform(2.5, 6.0) * frequencies.max())
    n = int(min(60 * log_uniform(5.0, 60.0) * rate, LONGEST))
    shapes = generator.standard_normal((n_modes, n_channels))
    shapes /= np.abs(shapes).max(axis=1, keepdims=True)
    level = log_uniform(0.2, 5.0, n_modes)
    lines = np.asarray(np.fft.rfftfreq(n, 1 / rate), dtype=np.float64)
    gains = np.array([_gain(lines, f, z) for f, z in zip(frequencies, damping, strict=True)])
    gains *= (level / np.sqrt(np.mean(np.abs(gains) ** 2, axis=1)))[:, None]
    power = np.abs(gains) ** 2
    signal = np.einsum("mk,mc->c", power, shapes**2) / len(lines)
    noise = log_uniform(0.01, 1.0) ** 2 * signal
    force = generator.standard_normal((2, *gains.shape)) / np.sqrt(2)
    spectrum = np.einsum("mk,mc->kc", gains * (force[0] + 1j * force[1]), shapes)
    white = generator.standard_normal((2, *spectrum.shape)) / np.sqrt(2)
    spectrum += np.sqrt(noise) * (white[0] + 1j * white[1])
    return Structure(
        frequencies,
        damping,
        shapes,
        _attainable(lines, frequencies, damping, power, shapes, noise),
        np.fft.irfft(spectrum * np.sqrt(n), n, axis=0),
        rate,
    )


def _gain(lines: FloatArray, frequency: float, damping: float) -> Any:
    """Acceleration of a mode under a unit force, any scale, (n_lines,)."""
    ratio = lines / frequency
    return ratio**2 / (1 - ratio**2 + 2j * damping * ratio)


def _attainable(
    lines: FloatArray,
    frequencies: FloatArray,
    damping: FloatArray,
    power: FloatArray,
    shapes: FloatArray,
    noise: FloatArray,
) -> FloatArray:
    """Cramér-Rao bound of each f, (n_modes,) [Hz]; f, ζ and level of all modes are unknown."""
    step = 1e-4

    def slope(f_step: float, zeta_step: float) -> FloatArray:
        moved = [
            np.abs(_gain(lines, f * (1 + s * f_step), z * (1 + s * zeta_step))) ** 2
            for s in (1, -1)
            for f, z in zip(frequencies, damping, strict=True)
        ]
        up, down = np.array(moved).reshape(2, len(frequencies), -1)
        return (np.log(up[:, 1:]) - np.log(down[:, 1:])) / (2 * step)

    relative = np.stack([slope(step, 0.0), slope(0.0, step), np.ones_like(power[:, 1:])])
    slopes = (relative * power[:, 1:]).reshape(-1, len(lines) - 1)  # ∂ of each mode's power
    whitened = shapes / np.sqrt(noise)
    own = np.einsum("mc,nc->mn", whitened, whitened)  # ΦᵀN⁻¹Φ
    roots = np.sqrt(power[:, 1:]).T
    inner = np.eye(len(own)) + roots[:, :, None] * own * roots[:, None, :]
    seen = own - np.einsum(
        "mi,kij,jn->kmn", own, roots[:, :, None] * np.linalg.inv(inner) * roots[:, None, :], own
    )  # φᵀ S⁻¹ φ by Woodbury, (n_lines, n_modes, n_modes)
    weight = np.tile(seen**2, (1, 3, 3))
    information = np.einsum("ak,kab,bk->ab", slopes, weight, slopes, optimize=True)
    covariance = np.linalg.pinv(information)
    return np.asarray(frequencies * np.sqrt(np.diag(covariance)[: len(frequencies)]))


@dataclass(frozen=True, slots=True, eq=False)
class Judged:
    """What was found of one record."""

    found: tuple[tuple[int, Mode], ...]
    """Place among the structure's modes, and the identified one."""
    missed: tuple[int, ...]
    invented: tuple[Mode, ...]
    duplicates: int


def judge(structure: Structure, modes: Sequence[Mode]) -> Judged:
    """Assign identified modes, each true mode once, the best known first."""
    free, found, missed = list(modes), [], []
    for place in np.argsort(structure.attainable / structure.frequencies):
        f, shape = float(structure.frequencies[place]), structure.shapes[place]
        alike = [mode for mode in free if _is(mode, f, shape)]
        if alike:
            best = min(alike, key=lambda mode: abs(mode.frequency - f))
            free.remove(best)
            found.append((int(place), best))
        elif structure.judged[place]:
            missed.append(int(place))
    invented = tuple(
        mode for mode in free if not any(_near(mode, float(f), 0.02) for f in structure.frequencies)
    )
    return Judged(tuple(found), tuple(missed), invented, len(free) - len(invented))


def _near(mode: Mode, frequency: float, tolerance: float) -> bool:
    return abs(mode.frequency - frequency) <= max(3 * mode.frequency_std, tolerance * frequency)


def _is(mode: Mode, frequency: float, shape: FloatArray) -> bool:
    if not _near(mode, frequency, 0.01):
        return False
    mac = float(modal_assurance_criterion(mode.shape[None], shape[None])[0, 0])
    return mac > 0.8 or (mac > 0.5 and float(mode.shape_std.max()) > 0.3)


def figures(structures: Sequence[Structure], judged: Sequence[Judged]) -> dict[str, Any]:
    """Of all records."""
    pairs = list(zip(structures, judged, strict=True))
    n_judged = sum(int(structure.judged.sum()) for structure in structures)
    over = np.array(
        [abs(m.frequency - s.frequencies[i]) / s.attainable[i] for s, i, m in _of(pairs)]
    )
    result: dict[str, Any] = {
        "records": len(structures),
        "modes": n_judged,
        "missed": sum(len(each.missed) for each in judged) / n_judged,
        "invented_a_record": sum(len(each.invented) for each in judged) / len(structures),
        "duplicates_a_record": sum(each.duplicates for each in judged) / len(structures),
        "rms_over_bound": float(np.sqrt(np.mean(over**2))),
        "median_over_bound": float(np.median(over)),
    }
    for name, (low, high) in {"pooled": (0.0, np.inf), **CLASSES}.items():
        inside = [
            (
                abs(m.frequency - s.frequencies[i]) <= NINETY * m.frequency_std,
                abs(m.damping_ratio - s.damping_ratios[i]) <= NINETY * m.damping_ratio_std,
            )
            for s, i, m in _of(pairs)
            if low <= s.damping_ratios[i] * s.frequencies[i] * s.duration < high
        ]
        held = np.array(inside).mean(axis=0) if inside else np.full(2, np.nan)
        result[f"cover {name}"] = {"modes": len(inside), "f": held[0], "zeta": held[1]}
    return result


def _of(pairs: Iterable[tuple[Structure, Judged]]) -> list[tuple[Structure, int, Mode]]:
    """Every judged mode that was found."""
    return [(s, i, mode) for s, each in pairs for i, mode in each.found if s.judged[i]]


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    parser = seeded_options("structures", first_seed=75_001, records=60)
    parser.add_argument("--list", action="store_true", help="every mode missed or invented")
    parser.add_argument("--below", type=float, default=np.inf, help="ζ f T of one mode or more")
    options = parser.parse_args(arguments)
    structures, judged = [], []
    for seed in seeds_of(options):
        structure = draw(seed)
        half_widths = structure.damping_ratios * structure.frequencies * structure.duration
        if not (structure.judged & (half_widths < options.below)).any():
            continue
        found = identify(structure.samples, structure.sampling_rate)
        each = judge(structure, found.modes)
        if options.list:
            _print_record(seed, structure, each, found.refused)
        structures.append(replace(structure, samples=np.empty((len(structure.samples), 0))))
        judged.append(each)
    found_figures = figures(structures, judged)
    if np.isfinite(options.below):
        _keep_slow(found_figures, options)
    else:
        del options.below
        report("structures", found_figures, options, seeds=seeds_of(options))


def _keep_slow(found: dict[str, Any], options: Namespace) -> None:
    for title, value in found.items():
        print(f"{title:20s} {value}")
    if options.keep:
        keep(
            "structures-slow",
            found,
            command=f"python -m tests.benchmarks structures --first-seed {options.first_seed} "
            f"--records {options.records} --below {options.below:g} --keep",
            seeds=seeds_of(options),
            depends=("pipeline/oma", "tests/benchmarks/structures.py"),
        )


def _print_record(seed: int, structure: Structure, judged: Judged, refused: Any) -> None:
    duration = structure.duration
    print(
        f"{seed}: {structure.sampling_rate:.3g} Hz {duration:.0f} s "
        f"{structure.samples.shape[1]} ch, {int(structure.judged.sum())} judged"
    )
    for place in judged.missed:
        f, zeta = structure.frequencies[place], structure.damping_ratios[place]
        why = [each.code for each in refused if abs(each.frequency / f - 1) < 0.02]
        gap = np.sort(np.abs(structure.frequencies / f - 1))[1]
        print(
            f"  missed {f:.4g} Hz ({f / structure.sampling_rate:.2g} fs) ζ {100 * zeta:.2g} % ζfT "
            f"{zeta * f * duration:.3g} bound {structure.attainable[place] / f:.2%} gap {gap:.1%} "
            f"{why}"
        )
    for place, mode in judged.found:
        f, bound = structure.frequencies[place], structure.attainable[place]
        zeta = structure.damping_ratios[place]
        if structure.judged[place] and abs(mode.frequency - f) > FAR_OFF * bound:
            print(
                f"  {(mode.frequency - f) / bound:+.1f} bounds off: {f:.4g} Hz "
                f"({f / structure.sampling_rate:.2g} fs) ζ {100 * zeta:.2g} % found "
                f"{100 * mode.damping_ratio:.2g} %, std {mode.frequency_std / bound:.1f} bounds"
            )
    for mode in judged.invented:
        f = mode.frequency
        print(
            f"  invented {f:.4g} Hz ({f / structure.sampling_rate:.2g} fs) "
            f"ζ {100 * mode.damping_ratio:.2g} % std {mode.frequency_std / f:.2%}"
        )
