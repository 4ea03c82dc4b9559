"""Modes that hide each other, ring-downs and lost seconds: what an identification leaves out.

    python -m tests.benchmarks close_modes [--first-seed 50001] [--records 50] [--keep]

Every seed draws structures of a few modes under white modal forces, 600 s, 3 to 8 channels:

bending    a tower's fore-aft and side-side first bending at .16 to .3 Hz, 1 to 4 % apart, ζ 1 to
           2 %, axes turned at random, second bending above
pairs      two modes near 2 Hz .5, 1, 1.5 and 2 % apart, ζ near 1 %, MAC below .3, two others
triplets   three modes within 3 % near .16 to .29 Hz, orthogonal shapes
ring-down  a burst of 5 times the rms in the first modes, decaying as these do; none in `alarms`
lost       5 % of one-second blocks without samples; 1 s without one channel

found      one identified mode each, within max(3 std, .2 %), MAC .8 (.5 where the shape std
           exceeds .3)
left over  identified modes within 7 % that match none, each the best of a hidden mode that nothing
           else matches: `wrong_shapes` lie within max(3 std, .2 %) of it, `wrong_frequencies` have
           its shape (MAC .8) farther off, and `phantoms` are those that no hidden mode is left for
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import decimate, lfilter

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from sensors.arrays import FloatArray
from tests.benchmarks._seeded import report, seeded_options, seeds_of

DURATION = 600.0  # of a record [s]
OVERSAMPLING = 2
GAPS = (0.005, 0.01, 0.015, 0.02)  # of pairs, relative


@dataclass(frozen=True, slots=True, eq=False)
class Hidden:
    """A record with modes that hide each other."""

    frequencies: FloatArray
    """The hidden ones first, (n_modes,) [Hz]."""
    damping_ratios: FloatArray
    """(n_modes,) [-]"""
    shapes: FloatArray
    """(n_modes, n_channels) [-]"""
    n_hidden: int
    """Modes that hide each other."""
    samples: FloatArray
    """(n, n_channels)"""
    sampling_rate: float
    """[Hz]"""


def ambient(
    frequencies: FloatArray,
    damping_ratios: FloatArray,
    shapes: FloatArray,
    rate: float,
    levels: FloatArray,
    noise: float,
    generator: np.random.Generator,
) -> FloatArray:
    """Response to independent white forces, (n, n_channels); levels are the modes' rms."""
    fine = rate * OVERSAMPLING
    warm = round(min(3 / (2 * np.pi * (frequencies * damping_ratios).min()), 200.0) * fine)
    modal = []
    for f, zeta, level in zip(frequencies, damping_ratios, levels, strict=True):
        pole = (-zeta + 1j * np.sqrt(1 - zeta**2)) * 2 * np.pi * f
        force = generator.standard_normal(warm + round(DURATION * fine)).astype(complex)
        coordinate = lfilter([1.0], [1.0, -np.exp(pole / fine)], force)
        motion = (pole**2 / pole.imag * coordinate).imag[warm:]
        modal.append(level * motion / motion.std())
    clean = decimate(np.array(modal).T @ shapes, OVERSAMPLING, ftype="fir", axis=0)
    return np.asarray(clean + noise * clean.std(axis=0) * generator.standard_normal(clean.shape))


def bending_pair(seed: int) -> Hidden:
    generator = np.random.default_rng(seed)
    first = generator.uniform(0.16, 0.3)
    height = np.array([0.3, 0.55, 0.75, 1.0])
    low = height ** generator.uniform(1.6, 2.0)
    high = np.sin(np.pi * height * generator.uniform(0.95, 1.15)) - 0.6 * height**2
    axes = generator.uniform(0, np.pi, 2)
    angles = [
        axes[0],
        axes[0] + np.pi / 2 + generator.normal(0, 0.05),
        axes[1],
        axes[1] + np.pi / 2,
    ]
    uneven = low * (1 + 0.03 * generator.standard_normal(4))
    shapes = np.array(
        [
            np.column_stack([shape * np.cos(a), shape * np.sin(a)]).ravel()
            for shape, a in zip((low, uneven, high, high), angles, strict=True)
        ]
    )
    second = first * generator.uniform(5, 8)
    frequencies = np.array(
        [
            first,
            first * (1 + generator.uniform(0.01, 0.04)),
            second,
            second * generator.uniform(1.01, 1.1),
        ]
    )
    damping = np.concatenate([generator.uniform(0.01, 0.02, 2), generator.uniform(0.005, 0.02, 2)])
    levels = np.concatenate(
        [[1.0], np.exp(generator.uniform(np.log(0.2), np.log(5), 1)), generator.uniform(0.3, 3, 2)]
    )
    return _record(frequencies, damping, shapes, 2, 20.0, levels, (0.01, 0.3), generator)


def pair(seed: int, gap: float) -> Hidden:
    generator = np.random.default_rng(seed)
    n_channels = int(generator.integers(3, 9))
    f = 2.0 * np.exp(generator.uniform(-0.5, 0.5))
    shapes = generator.standard_normal((4, n_channels))
    while _mac(shapes[0], shapes[1]) >= 0.3:
        shapes[1] = generator.standard_normal(n_channels)
    frequencies = f * np.array(
        [1.0, 1 + gap, generator.uniform(0.3, 0.6), generator.uniform(1.6, 3)]
    )
    damping = np.append(0.01 * np.exp(generator.uniform(-0.4, 0.4, 2)), [0.01, 0.01])
    levels = np.append(np.exp(generator.uniform(-0.7, 0.7, 2)), [1.0, 1.0])
    return _record(frequencies, damping, shapes, 2, 20.0, levels, (0.01, 0.3), generator)


def triplet(seed: int) -> Hidden:
    generator = np.random.default_rng(seed)
    three = ((0.160, 0.160, 0.161), (0.158, 0.160, 0.162), (0.157, 0.160, 0.1615))[seed % 3]
    frequencies = np.append(np.array(three) * generator.uniform(1, 1.8), 1.2)
    turned = np.linalg.qr(generator.standard_normal((8, 8)))[0]
    shapes = np.vstack([turned[:3], generator.standard_normal((1, 8))])
    damping = np.append(generator.uniform(0.005, 0.015, 3), 0.01)
    levels = np.append(np.exp(generator.uniform(-0.7, 0.7, 3)), 1.0)
    return _record(frequencies, damping, shapes, 3, 10.0, levels, (0.05, 0.0501), generator)


def _record(
    frequencies: FloatArray,
    damping: FloatArray,
    shapes: FloatArray,
    n_hidden: int,
    rate: float,
    levels: FloatArray,
    noise: tuple[float, float],
    generator: np.random.Generator,
) -> Hidden:
    scaled = shapes / np.abs(shapes).max(axis=1, keepdims=True)
    share = float(np.exp(generator.uniform(np.log(noise[0]), np.log(noise[1]))))
    samples = ambient(frequencies, damping, scaled, rate, levels, share, generator)
    return Hidden(frequencies, damping, scaled, n_hidden, samples, rate)


@dataclass(frozen=True, slots=True)
class Matched:
    """How a record's hidden modes were found."""

    found: int
    wrong_shapes: int
    """Left over where a hidden mode is, of another shape."""
    wrong_frequencies: int
    """Left over with the shape of a hidden mode, farther from it than their std allow."""
    phantoms: int
    """Left over, of no hidden mode."""
    one_group: bool
    """All that was reported of the hidden ones shares one `pair_id`."""
    z: tuple[float, ...]
    """Errors of f over their std."""


def matched(record: Hidden) -> Matched:
    hidden = record.frequencies[: record.n_hidden]
    modes = identify(record.samples, record.sampling_rate).modes
    near = [m for m in modes if 0.93 * hidden.min() < m.frequency < 1.07 * hidden.max()]
    free, z = list(near), []
    unmatched: list[tuple[float, FloatArray]] = []
    for f, shape in zip(hidden.tolist(), record.shapes, strict=False):
        alike = [m for m in free if is_at(m, f) and has_shape(m, shape)]
        if alike:
            best = min(alike, key=lambda m: abs(m.frequency - f))
            free.remove(best)
            z.append((best.frequency - f) / best.frequency_std)
        else:
            unmatched.append((f, shape))
    ids = {mode.pair_id for mode in near}
    one_group = len(near) > 1 and len(ids) == 1 and "" not in ids
    return Matched(len(z), *left_over(free, unmatched), one_group, tuple(z))


def left_over(
    modes: Sequence[Mode], unmatched: Sequence[tuple[float, FloatArray]]
) -> tuple[int, int, int]:
    """How many modes that match none are of a wrong shape, of a wrong frequency, and phantoms.

    unmatched   frequency [Hz] and shape of each hidden mode that none matches; each counts once
    """
    counts, free, rest = [], list(modes), list(unmatched)
    for is_of in (lambda m, f, shape: is_at(m, f), lambda m, f, shape: has_shape(m, shape)):
        before = len(free)
        for hidden in list(rest):
            of_it = [m for m in free if is_of(m, *hidden)]
            if of_it:
                free.remove(min(of_it, key=lambda m: abs(m.frequency - hidden[0])))
                rest.remove(hidden)
        counts.append(before - len(free))
    return counts[0], counts[1], len(free)


def is_at(mode: Mode, frequency: float) -> bool:
    """Whether a frequency [Hz] lies within max(3 std, .2 %) of a mode's."""
    return abs(mode.frequency - frequency) <= max(3 * mode.frequency_std, 0.002 * frequency)


def has_shape(mode: Mode, shape: FloatArray) -> bool:
    """Whether a mode has a shape: MAC .8, or .5 where its own shape is vague."""
    mac = _mac(mode.shape, shape)
    return mac > 0.8 or (mac > 0.5 and float(mode.shape_std.max()) > 0.3)


def _mac(one: FloatArray, other: FloatArray) -> float:
    return float(modal_assurance_criterion(one[None], other[None])[0, 0])


def hidden_figures(draw: Callable[[int], Hidden], seeds: Sequence[int]) -> dict[str, float]:
    records = [draw(seed) for seed in seeds]
    each = [matched(record) for record in records]
    wanted = records[0].n_hidden
    z = np.array([value for one in each for value in one.z])
    return {
        "records": len(each),
        "all_found": float(np.mean([one.found == wanted for one in each])),
        "all_or_one_group": float(np.mean([one.found == wanted or one.one_group for one in each])),
        "wrong_shapes": sum(one.wrong_shapes for one in each),
        "wrong_frequencies": sum(one.wrong_frequencies for one in each),
        "phantoms": sum(one.phantoms for one in each),
        "within_2_std": float(np.mean(np.abs(z) < 2)),
        "within_1.645_std": float(np.mean(np.abs(z) < 1.645)),
        "rms_z": float(np.sqrt(np.mean(z**2))),
    }


def ring_down(seed: int, amplitude: float = 5.0) -> Hidden:
    """A bending pair of which a burst decays, from a random moment in the first two thirds."""
    record = bending_pair(seed)
    generator = np.random.default_rng([seed, 1])
    time = np.arange(len(record.samples)) / record.sampling_rate
    after = np.clip(time - generator.uniform(0, 400), 0, None)
    mode = int(generator.integers(2))
    omega = 2 * np.pi * record.frequencies[mode]
    decay = np.where(after > 0, np.exp(-record.damping_ratios[mode] * omega * after), 0.0)
    strongest = record.samples.std(axis=0).max()
    burst = amplitude * np.sqrt(2) * strongest * decay * np.cos(omega * after)
    samples = record.samples + np.outer(burst, record.shapes[mode])
    return Hidden(
        record.frequencies, record.damping_ratios, record.shapes, 2, samples, record.sampling_rate
    )


def warned(record: Hidden) -> bool:
    found = identify(record.samples, record.sampling_rate)
    return any(warning.code == "non-stationary" for warning in found.warnings)


def lost_figures(seeds: Sequence[int], kind: str) -> dict[str, float]:
    """Shifts of the frequencies, in std, of windows that lack samples."""
    shifts, lost, vanished = [], 0, 0
    for seed in seeds:
        record = pair(seed, 0.3)
        samples, rate = record.samples.copy(), round(record.sampling_rate)
        generator = np.random.default_rng([seed, 2])
        if kind == "blocks":
            for block in generator.choice(len(samples) // rate, len(samples) // rate // 20, False):
                samples[block * rate : (block + 1) * rate] = np.nan
        else:
            first = int(generator.integers(len(samples) - rate))
            samples[first : first + rate, 0] = np.nan
        whole = identify(record.samples, record.sampling_rate).modes
        found = identify(samples, record.sampling_rate)
        lost += found.rejection is not None
        for mode in whole:
            near = [m for m in found.modes if abs(m.frequency / mode.frequency - 1) < 0.02]
            vanished += not near
            if near:
                best = min(near, key=lambda m: abs(m.frequency - mode.frequency))
                shifts.append((best.frequency - mode.frequency) / mode.frequency_std)
    z = np.array(shifts)
    return {
        "windows": len(seeds),
        "windows_lost": lost,
        "modes": len(z),
        "modes_lost": vanished,
        "shift_rms_std": float(np.sqrt(np.mean(z**2))),
        "shift_largest_std": float(np.abs(z).max()),
    }


def figures(first_seed: int, count: int) -> dict[str, dict[str, float]]:
    seeds = range(first_seed, first_seed + count)
    result = {"bending": hidden_figures(bending_pair, seeds)}
    for gap in GAPS:
        result[f"pairs {gap:g}"] = hidden_figures(lambda seed, gap=gap: pair(seed, gap), seeds)
    result["triplets"] = hidden_figures(triplet, seeds)
    result["ring-down x5"] = {"warned": float(np.mean([warned(ring_down(s)) for s in seeds]))}
    result["alarms"] = {"warned": float(np.mean([warned(bending_pair(s)) for s in seeds]))}
    result["lost blocks"] = lost_figures(seeds[: max(1, count // 2)], "blocks")
    result["lost second"] = lost_figures(seeds[: max(1, count // 2)], "second")
    return result


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    options = seeded_options("close_modes", first_seed=50_001, records=50).parse_args(arguments)
    found = figures(options.first_seed, options.records)
    report("close_modes", found, options, seeds=seeds_of(options))
