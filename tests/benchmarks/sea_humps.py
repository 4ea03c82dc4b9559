"""Humps of a sea beside a tower's first modes: reported as modes, and modes taken for the sea.

    python -m tests.benchmarks sea_humps [--first-seed 200000] [--records 40] [--keep]

Every seed draws two first bending modes at .15 to .3 Hz (ζ .3 to 2 %, in three of ten records up to
8 %), two second ones, 600 s of eight channels under coloured forces with 1 to 20 % of noise, and a
JONSWAP sea (peak .06 to .13 Hz, γ 2 to 6) whose hump is .5 to 3 times as strong: in half of the
records a force on the first modes, else what all channels of a direction show alike. The same
tower without the sea shows what is lost.

hump        an identified mode below .75 of the first mode's frequency, which none of the tower has
sea         what was refused there as the sea's
lost        first modes refused as the sea's
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.oma.identification import Identification, identify
from sensors.arrays import ComplexArray, FloatArray
from sensors.sea_spectrum import jonswap
from tests.benchmarks._seeded import report, seeded_options, seeds_of

RATE, DURATION = 10.0, 600.0
BELOW = 0.75  # of the first frequency
HEIGHTS = np.array([0.3, 0.55, 0.75, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class Tower:
    """Modes of a tower, as eight channels see them."""

    frequencies: FloatArray
    """(4,) [Hz]"""
    damping_ratios: FloatArray
    """(4,) [-]"""
    shapes: FloatArray
    """(4, 8) [-]"""
    axis: float
    """Direction of the first mode [rad]."""

    def gains(self, lines: FloatArray) -> ComplexArray:
        """Accelerations under unit forces, (4, n_lines)."""
        ratio = lines / self.frequencies[:, None]
        return np.asarray(ratio**2 / (1 - ratio**2 + 2j * self.damping_ratios[:, None] * ratio))


def tower(generator: np.random.Generator) -> Tower:
    """A tower that stands or, in three of ten, turns."""
    first = generator.uniform(0.15, 0.30)
    low, high = (0.003, 0.02) if generator.random() < 0.7 else (0.02, 0.08)
    damping = [_log_uniform(generator, low, high), _log_uniform(generator, 0.003, 0.02)]
    second = first * generator.uniform(5, 8)
    bent = HEIGHTS ** generator.uniform(1.6, 2.0)
    twice = np.sin(np.pi * HEIGHTS * generator.uniform(0.95, 1.15)) - 0.6 * HEIGHTS**2
    axes = generator.uniform(0, np.pi, 2)
    angles = (axes[0], axes[0] + np.pi / 2, axes[1], axes[1] + np.pi / 2)
    shapes = [
        np.column_stack([shape * np.cos(a), shape * np.sin(a)]).ravel()
        for shape, a in zip((bent, bent, twice, twice), angles, strict=True)
    ]
    return Tower(
        np.array(
            [
                first,
                first * (1 + generator.uniform(0.005, 0.04)),
                second,
                second * generator.uniform(1.01, 1.1),
            ]
        ),
        np.append(damping, generator.uniform(0.005, 0.02, 2)),
        np.array(shapes),
        float(axes[0]),
    )


def record(seed: int, *, with_sea: bool) -> tuple[Tower, FloatArray]:
    """A tower and its samples, (n, 8)."""
    generator = np.random.default_rng([seed, 77])
    structure = tower(generator)
    n = round(RATE * DURATION)
    lines = np.asarray(np.fft.rfftfreq(n, 1 / RATE)[1:])
    modal = structure.gains(lines) * _noise(generator, 4, len(lines))
    modal *= lines ** (-generator.uniform(0, 2) / 2)
    levels = np.array([1.0, np.exp(generator.uniform(-1.2, 1.2)), 0.5, 0.5])
    modal *= (levels / np.sqrt((np.abs(modal) ** 2).sum(axis=1)))[:, None]
    spectrum = modal.T @ structure.shapes
    share = _log_uniform(generator, 0.01, 0.2)
    if with_sea:
        spectrum = spectrum + _hump(structure, lines, spectrum, generator)
    rms = np.sqrt((np.abs(spectrum) ** 2).sum(axis=0) / len(lines))
    spectrum = spectrum + share * rms * _noise(generator, len(lines), 8)
    samples = np.fft.irfft(np.vstack([np.zeros((1, 8)), spectrum]), n, axis=0) * n
    return structure, np.asarray(samples / samples.std())


def _hump(
    structure: Tower, lines: FloatArray, spectrum: ComplexArray, generator: np.random.Generator
) -> ComplexArray:
    """What a sea adds, (n_lines, 8)."""
    sea = np.sqrt(
        jonswap(
            lines,
            peak_frequency=generator.uniform(0.06, 0.13),
            peak_enhancement=generator.uniform(2, 6),
        )
    )
    heading, spread = generator.uniform(0, np.pi), generator.uniform(0, 0.4)
    strength = _log_uniform(generator, 0.5, 3.0)
    along, across = _noise(generator, 2, len(lines)) * sea * np.array([[1.0], [spread]])
    turn = heading - structure.axis
    if generator.random() < 0.5:
        forces = np.tanh(np.minimum((2 * np.pi * lines) ** 2 / 9.81 * 30, 50)) * np.array(
            [
                along * np.cos(turn) + across * np.sin(turn),
                along * np.sin(turn) - across * np.cos(turn),
            ]
        )
        hump = (structure.gains(lines)[:2] * forces).T @ structure.shapes[:2]
    else:
        along, across = (part * lines ** (generator.uniform(0, 4) / 2) for part in (along, across))
        direction = np.tile([np.cos(heading), np.sin(heading)], 4)
        side = np.tile([-np.sin(heading), np.cos(heading)], 4)
        hump = np.outer(along, direction) + np.outer(across, side)
    below = lines < 0.8 * structure.frequencies[0]
    wanted = strength * np.sqrt((np.abs(spectrum) ** 2).sum(axis=0).max())
    return np.asarray(hump * wanted / np.sqrt((np.abs(hump[below]) ** 2).sum(axis=0).max()))


def _noise(generator: np.random.Generator, *shape: int) -> ComplexArray:
    parts = generator.standard_normal((2, *shape)) / np.sqrt(2)
    return np.asarray(parts[0] + 1j * parts[1])


def _log_uniform(generator: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(generator.uniform(np.log(low), np.log(high))))


def figures(seeds: Sequence[int]) -> dict[str, dict[str, float]]:
    """Of the records with a sea and without."""
    result = {}
    for title, with_sea in (("with a sea", True), ("without", False)):
        each = []
        for seed in seeds:
            structure, samples = record(seed, with_sea=with_sea)
            each.append((structure, identify(samples, RATE)))
        result[title] = _counted(each)
    return result


def _counted(each: Sequence[tuple[Tower, Identification]]) -> dict[str, float]:
    humps = warned = sea = lost = found = 0
    for structure, window in each:
        first = float(structure.frequencies[0])
        low = [mode for mode in window.modes if mode.frequency < BELOW * first]
        refused = [reason.frequency for reason in window.refused if reason.code == "sea"]
        humps += bool(low)
        warned += any(warning.code == "sea" for warning in window.warnings)
        sea += any(frequency < BELOW * first for frequency in refused)
        lost += sum(frequency >= BELOW * first for frequency in refused)
        found += any(BELOW * first < mode.frequency < 1.3 * first for mode in window.modes)
    return {
        "records": len(each),
        "first_bending_found": found,
        "hump_as_a_mode": humps,
        "warned": warned,
        "refused_as_the_sea": sea,
        "modes_lost_to_the_sea": lost,
    }


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    options = seeded_options("sea_humps", first_seed=200_000, records=40).parse_args(arguments)
    report("sea_humps", figures(seeds_of(options)), options, seeds=seeds_of(options))
