"""Names of modes over a day in which three of five cross: wrong ones, and how many a mode gets.

    python -m tests.benchmarks tracking [--first-seed 145201] [--records 40] [--keep]

Every seed draws 144 windows of ten minutes of five modes. Three of them cross within 3 % of each
other: one falls, one stays, one rises, all with a tide. Estimates scatter by 1.5 times the
attainable std; shapes by 3 to 8 % of their largest component. A window lacks every seventh mode,
three gaps of half an hour to two hours have no window at all, and every sixth window has a mode
that is none. Two modes within a half bandwidth ζ f mix their shapes, and half of the windows have
one mode between them.

wrong   estimates under a name that belongs to another mode: a name belongs to the mode that most of
        its estimates are of
names   that a mode's estimates have, without those of a merged one
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Any

import numpy as np

from pipeline.messages import Mode
from pipeline.oma.tracking import ModeTracker
from sensors.arrays import FloatArray
from tests.benchmarks._seeded import report, seeded_options, seeds_of

WINDOWS = 144
DURATION = 600.0  # T of a window [s]
DAMPING = 0.01
OVER_BOUND = 1.5  # std of a frequency over the attainable one
MISSED = 0.15  # share of the windows that lack a mode
SPURIOUS = 0.15  # modes a window that are none
MERGED = 0.5  # share of the windows in which two modes within a half bandwidth are one
CROSSING = (1, 2, 3)  # of the five modes
NOBODY, GONE = -1, -2  # identity of what is no mode, and of what was merged into another one


@dataclass(frozen=True, slots=True)
class Seen:
    """An estimate, and the mode that it is of."""

    identity: int
    mode: Mode


def day(seed: int) -> list[list[Seen]]:
    """Windows of a day, lowest frequency first; empty where there is none."""
    generator = np.random.default_rng([seed, 24])
    crossing = float(np.exp(generator.uniform(np.log(0.25), np.log(3.0))))
    centres = crossing * np.array([0.6, 1.0, 1.0, 1.0, 1.9])
    shapes = generator.standard_normal((5, int(generator.integers(4, 9))))
    shapes /= np.abs(shapes).max(axis=1, keepdims=True)
    scatter = generator.uniform(0.03, 0.08)
    spans = generator.uniform(0.01, 0.015, 2)
    times = np.linspace(-1.0, 1.0, WINDOWS)
    tide = 0.003 * np.sin(2 * np.pi * 24 / 12.42 * times / 2 + generator.uniform(0, 2 * np.pi))
    paths = tide[:, None] * generator.uniform(0.3, 1.0, 5)
    paths[:, 1] -= spans[0] * times
    paths[:, 3] += spans[1] * (times - generator.uniform(-0.3, 0.3))
    lost = np.zeros(WINDOWS, dtype=bool)
    for start in generator.integers(0, WINDOWS, 3):
        lost[start : start + int(generator.integers(3, 13))] = True
    return [
        [] if gone else _window(centres * (1 + path), shapes, scatter, generator)
        for gone, path in zip(lost, paths, strict=True)
    ]


def _window(
    frequencies: FloatArray, shapes: FloatArray, scatter: float, generator: np.random.Generator
) -> list[Seen]:
    """What one window shows of its modes, of mixtures of them, and of what is no mode."""
    frequencies, mixed = frequencies.copy(), shapes.copy()
    identities = np.arange(len(frequencies))
    apart = np.abs(frequencies[:, None] - frequencies) / (DAMPING * frequencies)
    for one, other in permutations(CROSSING, 2):
        share = 0.3 * np.exp(-(apart[one, other] ** 2)) * generator.standard_normal()
        mixed[one] += share * shapes[other]
    for one, other in combinations(CROSSING, 2):
        both = identities[one] == one and identities[other] == other
        if both and apart[one, other] < 1 and generator.random() < MERGED:
            weight = generator.uniform(0, 1)
            for row in (frequencies, mixed):
                row[one] = (1 - weight) * row[one] + weight * row[other]
            identities[[one, other]] = NOBODY, GONE
    found = [
        Seen(int(identity), _estimate(f, shape, scatter, generator))
        for identity, f, shape in zip(identities, frequencies, mixed, strict=True)
        if identity != GONE and generator.random() > MISSED
    ]
    for _ in range(generator.poisson(SPURIOUS)):
        f = frequencies[CROSSING[1]] * generator.uniform(0.9, 1.1)
        shape = generator.standard_normal(shapes.shape[1])
        found.append(Seen(NOBODY, _estimate(f, shape, scatter, generator)))
    return sorted(found, key=lambda each: each.mode.frequency)


def _estimate(
    frequency: float, shape: FloatArray, scatter: float, generator: np.random.Generator
) -> Mode:
    std = OVER_BOUND * np.sqrt(DAMPING / (2 * np.pi * frequency * DURATION)) * frequency
    shape = shape / np.abs(shape).max() + scatter * generator.standard_normal(len(shape))
    stated = std * np.exp(0.15 * generator.standard_normal())
    factor = np.full((2 + len(shape), 1), scatter)
    factor[0], factor[1] = stated, 0.2 * DAMPING
    return Mode(
        name="",
        frequency=float(frequency + std * generator.standard_normal()),
        frequency_std=float(stated),
        damping_ratio=DAMPING,
        damping_ratio_std=0.2 * DAMPING,
        shape=shape / shape[np.argmax(np.abs(shape))],
        covariance_factor=factor,
        n_block_columns=1,
    )


def named(windows: Sequence[Sequence[Seen]]) -> list[tuple[int, str]]:
    """Identity and name of every estimate of a day."""
    tracker = ModeTracker()
    found: list[tuple[int, str]] = []
    for window in windows:
        if not window:
            tracker.missed()
            continue
        modes = tracker.named([each.mode for each in window])
        found += [(seen.identity, mode.name) for seen, mode in zip(window, modes, strict=True)]
    return found


def figures(days: Sequence[Sequence[tuple[int, str]]]) -> dict[str, Any]:
    """Of all days."""
    wrong = total = names = modes = 0
    for estimates in days:
        true = [(identity, name) for identity, name in estimates if identity >= 0]
        by_name: dict[str, Counter[int]] = {}
        for identity, name in true:
            by_name.setdefault(name, Counter())[identity] += 1
        owner = {name: counts.most_common(1)[0][0] for name, counts in by_name.items()}
        wrong += sum(owner[name] != identity for identity, name in true)
        total += len(true)
        names += len(set(true))
        modes += len({identity for identity, _ in true})
    return {
        "days": len(days),
        "estimates": total,
        "wrong": wrong / total,
        "names_a_mode": names / modes,
    }


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    options = seeded_options("tracking", first_seed=145_201, records=40).parse_args(arguments)
    days = [named(day(seed)) for seed in seeds_of(options)]
    report("tracking", figures(days), options, seeds=seeds_of(options))
