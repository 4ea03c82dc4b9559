"""First bending modes beside the harmonics of a rotor whose speed wanders and is measured.

    python -m tests.benchmarks harmonics [--first-seed 71001] [--records 100] [--keep]

Every seed takes a pair of first bending modes of `close_modes` and adds 1P, 3P and 6P of a rotor:
3P lies 5 to 10 % below or above the pair, at .5 to 3 times the strongest channel's rms; the speed
wanders by 1 % (30 s correlation) and is measured at 1 Hz to .1 %.

found       of the two first modes, as in `close_modes`
cover       90 % intervals of the found modes' ζ and f
harmonics   windows in which a mode is reported within 1.5 % of 1P, 3P or 6P that is none of the two
"""

from collections.abc import Sequence

import numpy as np
from scipy.signal import lfilter

from pipeline.oma.identification import identify
from sensors.arrays import FloatArray
from tests.benchmarks._seeded import report, seeded_options, seeds_of
from tests.benchmarks.close_modes import Hidden, bending_pair, has_shape, is_at

WANDER, CORRELATION = 0.01, 30.0  # std of the speed over its mean [-], time [s]


def turning(seed: int) -> tuple[Hidden, FloatArray, FloatArray, float]:
    """The structure, its samples with harmonics, the measured speed at each [rpm], 3P [Hz]."""
    generator = np.random.default_rng([seed, 3])
    record = bending_pair(seed)
    quiet, rate = record.samples, record.sampling_rate
    time = np.arange(len(quiet)) / rate
    share = generator.uniform(0.05, 0.1)
    first, second = sorted(record.frequencies[:2].tolist())
    passing = float(generator.choice([first * (1 - share), second * (1 + share)]))
    keeps = np.exp(-1 / (rate * CORRELATION))
    wander = lfilter([1.0], [1.0, -keeps], generator.standard_normal(len(quiet)))
    speed = 20 * passing * (1 + WANDER * (wander - wander.mean()) / wander.std())
    angle = 2 * np.pi * np.cumsum(speed / 60) / rate
    size = np.sqrt(2) * quiet.std(axis=0).max() * np.exp(generator.uniform(np.log(0.5), np.log(3)))
    direction = generator.standard_normal(2) @ record.shapes[:2]
    direction /= np.abs(direction).max()
    blades = np.cos(3 * angle + 1) + 0.3 * np.cos(6 * angle + 2) + 0.2 * np.cos(angle)
    every = round(rate)
    noise = 1 + 0.001 * generator.standard_normal(len(speed[::every]))
    measured = np.interp(time, time[::every], speed[::every] * noise)
    return record, quiet + size * np.outer(blades, direction), measured, passing


def figures(seeds: Sequence[int], *, known: bool) -> dict[str, float]:
    """known: whether the identification has the speed."""
    z_damping, z_frequency, windows = [], [], 0
    for seed in seeds:
        record, samples, speed, passing = turning(seed)
        given = speed if known else None
        free = list(identify(samples, record.sampling_rate, rotor_speed=given).modes)
        for f, shape, zeta in zip(
            record.frequencies[:2], record.shapes, record.damping_ratios, strict=False
        ):
            alike = [m for m in free if is_at(m, float(f)) and has_shape(m, shape)]
            if alike:
                best = min(alike, key=lambda mode: abs(mode.frequency - f))
                free.remove(best)
                z_damping.append((best.damping_ratio - zeta) / best.damping_ratio_std)
                z_frequency.append((best.frequency - f) / best.frequency_std)
        windows += any(
            abs(mode.frequency / (order * passing) - 1) < 0.015
            for mode in free
            for order in (1 / 3, 1, 2)
        )
    return {
        "found": len(z_damping) / (2 * len(seeds)),
        "cover_zeta": float(np.mean(np.abs(z_damping) < 1.645)),
        "cover_f": float(np.mean(np.abs(z_frequency) < 1.645)),
        "windows_with_harmonic": windows,
        "windows": len(seeds),
    }


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    options = seeded_options("harmonics", first_seed=71_001, records=100).parse_args(arguments)
    seeds = seeds_of(options)
    found = {"with speed": figures(seeds, known=True)}
    found["without speed"] = figures(seeds[: max(1, len(seeds) // 4)], known=False)
    report("harmonics", found, options, seeds=seeds)
