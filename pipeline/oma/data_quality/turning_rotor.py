"""A rotor that turns while a window lasts, by its harmonics, however weak.

What a rotor pushes a tower with goes along another direction of the channels than what shakes there
at random. With y_k the channels' lines of the spectrum, P their mean y yᴴ within the reach of a
line and S that beside it, the eigenvector w of the largest λ of P w = λ S w is the direction in
which a harmonic stands out most: one of a hundredth of the motion is 30 dB above the rest.
Two orders of one rotor show in it in one of two ways.

- Its speed wanders: then the phases go together (`phase_coherence`), and the
  amplitude of the lower one is steady.
- Its speed is constant: the lower one is a line narrower than any mode's, and there is more at just
  the frequency of another order than chance puts there. y_kᴴ S⁻¹ y_k of a line that is like those
  beside it follows an F distribution (Hotelling); a line's neighbours are compared with those of a
  resonance of `LEAST_DAMPING` or more by their likelihood (Whittle).

This says that a rotor turns and at about which speed. What it moves is too little for its phase to
be read beside the structure's modes, and nothing is taken off.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg, ndimage, special

from pipeline.oma.data_quality.rotor_harmonics import ORDERS
from pipeline.oma.preprocessing import lines_of_channels
from sensors.arrays import BoolArray, ComplexArray, FloatArray, IntArray

SLOWEST, FASTEST = 3.0, 30.0  # speeds of a rotor at work [rpm]: below, one that idles
REACHES = (0.03, 0.08)  # of a harmonic to either side that its speed wanders by, relative
STEADY = 2.4  # ⟨|a|⁴⟩/⟨|a|²⟩² under the Hann taper: 1.9 of one amplitude, 3.9 under random loads
LEAST_CYCLES = 20  # f T
MOST_PEAKS = 8  # that stand out most are looked at
LEAST_REACH = 2  # lines
LEAST_BESIDE = 12  # lines on either side
MOST_DIRECTIONS = 8  # of the channels: so many are known from the lines beside a harmonic
COUPLED = -12.0  # log probability of the coherence by chance: of 16 parked windows (seed 290001)
# the least was -6.7, of harmonics of a hundredth of the motion, wandering by up to 4 %, at most -42

LINE_GAP = 4  # lines on either side that a constant harmonic leaks into under the Hann taper
LINE_REACH = 20  # lines on either side that are compared with it
LINES_BESIDE = np.array([k for k in range(-LINE_REACH, LINE_REACH + 1) if abs(k) >= LINE_GAP])
LEAST_CONTRAST = 100.0  # yᴴ S⁻¹ y of a line
LEAST_DAMPING = 0.003  # of a tower's mode [-]
NARROW = 4.0  # log likelihood ratio of a line to a mode, at least
LIKELIEST = (3, 1, 6)  # orders of the line that stands out most
LEAST_OTHER = -12.0  # log probability of as much at another order by chance, at most, as of a
# coherence: of 80 parked windows with a machine's tone (seeds 72000 to 72079) it was -4 in 28 and
# -12 in 2, of 16 with harmonics of a tenth of the motion (seeds 70301 to 70316) in 15
# of 40 others with a tone (seeds 73000 to 73039, on which nothing was chosen) it is still in 5
LINE_AND_OTHER = 14.0  # that less the log probability of the other order, at least: 16.7 to 34.8 in
# the eight windows of a turning rotor of the scenario `operating` (seed 290001), 0 in the 16 others


@dataclass(frozen=True, slots=True)
class TurningRotor:
    """Two orders of one speed."""

    speed: float
    """[rpm]"""
    orders: tuple[int, int]
    """Times a turn, the lower one first."""
    evidence: float = 0.0
    """Log of its odds against chance [-]."""


def turning_rotor(samples: FloatArray, sampling_rate: float) -> TurningRotor | None:
    """Two orders of one rotor beyond chance, in the window or a half of it; None: there are none.

    A rotor that stops or starts turns for a part of the window only: its harmonics are not steady
    in the whole, and its lines no narrower than those of a mode.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    halves = np.array_split(samples, 2)
    for stretch in (samples, *(half - half.mean(axis=0) for half in halves)):
        if (rotor := _of_stretch(stretch, sampling_rate)) is not None:
            return rotor
    return None


def _of_stretch(samples: FloatArray, sampling_rate: float) -> TurningRotor | None:
    duration = len(samples) / sampling_rate
    lines = _directions(samples, duration)
    sums = _cumulated(lines)
    coupled = max(_coupled(lines, sums, duration), key=lambda each: each.evidence, default=None)
    return coupled or next(_of_constant_speed(lines, sums, duration), None)


def _directions(samples: FloatArray, duration: float) -> ComplexArray:
    """Lines up to those that a rotor may have, along the strongest directions of the channels."""
    scales = np.std(samples, axis=0)
    lines = lines_of_channels(samples, np.where(scales > 0, scales, 1.0), np.hanning(len(samples)))
    highest = max(ORDERS) * FASTEST / 60 * (1 + 6 * max(REACHES)) * duration
    lines = lines[: int(highest) + LINE_REACH]
    if lines.shape[1] <= MOST_DIRECTIONS:
        return lines
    _, vectors = np.linalg.eigh(lines.conj().T @ lines)
    return np.asarray(lines @ vectors[:, -MOST_DIRECTIONS:])


def _coupled(lines: ComplexArray, sums: ComplexArray, duration: float) -> Iterator[TurningRotor]:
    """Orders of a wandering speed."""
    for reach in REACHES:
        for peak in _outstanding(lines, sums, duration, reach):
            lower = _around(lines, sums, peak, reach)
            squares = np.abs(in_time(lower, 8 * len(lower))) ** 2
            if np.mean(squares**2) > STEADY * np.mean(squares) ** 2:
                continue
            mean = peak + _centre(lower)
            for orders in ((3, 6), (1, 3)):
                speed, ratio = 60 * mean / duration / orders[0], orders[1] // orders[0]
                if not SLOWEST <= speed <= FASTEST:
                    continue
                if not _reaches(lines, np.array(ratio * peak), reach):
                    continue
                upper = _around(lines, sums, ratio * peak, reach)
                c = min(phase_coherence(lower, upper, ratio), 1 - 1e-9)
                chance = float((len(lower) - 1) * np.log1p(-(c**2)))
                if chance < COUPLED:
                    yield TurningRotor(speed, orders, -chance)


def _outstanding(
    lines: ComplexArray, sums: ComplexArray, duration: float, reach: float
) -> list[int]:
    """Numbers of the lines about which most stands out against what is beside them."""
    first = max(LEAST_CYCLES, int(SLOWEST / 60 * duration))
    numbers = np.arange(first, int(3 * FASTEST / 60 * duration))
    numbers = numbers[_reaches(lines, numbers, reach)]
    inside, beside = _covariances(sums, numbers, reach)
    contrast = np.einsum("kaa->k", np.linalg.solve(beside, inside)).real
    chosen: list[int] = []
    for number in numbers[np.argsort(-contrast, kind="stable")].tolist():
        if all(abs(number / other - 1) > reach for other in chosen):
            chosen.append(number)
        if len(chosen) == MOST_PEAKS:
            break
    return chosen


def _cumulated(lines: ComplexArray) -> ComplexArray:
    """Sums of y yᴴ of the lines before each, (n_lines + 1, n, n)."""
    products = lines[:, :, None] * lines[:, None, :].conj()
    none = np.zeros_like(products[:1])
    return np.asarray(np.concatenate([none, np.cumsum(products, axis=0)]))


def _within(numbers: IntArray, reach: float) -> tuple[IntArray, IntArray]:
    """Lines on either side of each that are within its reach, and that are beside that."""
    within = np.maximum(LEAST_REACH, np.rint(reach * numbers).astype(np.int64))
    return within, np.maximum(LEAST_BESIDE, 2 * within)


def _reaches(lines: ComplexArray, numbers: IntArray, reach: float) -> BoolArray:
    """Whether the spectrum has what is beside the reach of each line."""
    margin = np.add(*_within(numbers, reach))
    return np.asarray((numbers > margin) & (numbers + margin < len(lines)))


def _covariances(
    sums: ComplexArray, numbers: IntArray, reach: float
) -> tuple[ComplexArray, ComplexArray]:
    """P and S about each line, (n_numbers, n, n)."""
    within, aside = _within(numbers, reach)
    low, high = numbers - within, numbers + within + 1
    inside = sums[high] - sums[low]
    beside = sums[high + aside] - sums[low - aside] - inside
    return inside / (high - low)[:, None, None], _regular(beside / (2 * aside)[:, None, None])


def _regular(covariances: ComplexArray) -> ComplexArray:
    """Covariances that can be inverted where channels are the same, (…, n, n)."""
    n = covariances.shape[-1]
    mean = np.einsum("...aa->...", covariances).real / n
    return np.asarray(covariances + 1e-9 * mean[..., None, None] * np.eye(n))


def _around(lines: ComplexArray, sums: ComplexArray, number: int, reach: float) -> ComplexArray:
    """Motion in the direction that stands out most, within the reach of a line, (n_lines,)."""
    numbers = np.array([number])
    inside, beside = _covariances(sums, numbers, reach)
    _, vectors = linalg.eigh(inside[0], beside[0])
    within = int(_within(numbers, reach)[0][0])
    return np.asarray(lines[number - within : number + within + 1] @ vectors[:, -1].conj())


def _centre(stretch: ComplexArray) -> float:
    """Centre of gravity of the power of lines, from the middle one."""
    power = np.abs(stretch) ** 2
    return float(power @ (np.arange(len(stretch)) - len(stretch) // 2) / power.sum())


def _of_constant_speed(
    lines: ComplexArray, sums: ComplexArray, duration: float
) -> Iterator[TurningRotor]:
    """Orders of a speed that wanders by less than a line; the line that stands out most first."""
    contrast, log_chance = _contrasts(lines, sums)
    tops = ndimage.maximum_filter1d(contrast, 2 * LINE_GAP - 1)
    peaks = np.flatnonzero((contrast >= LEAST_CONTRAST) & (contrast == tops))
    for peak in peaks[np.argsort(-contrast[peaks], kind="stable")].tolist():
        narrow: float | None = None
        for own in LIKELIEST:
            chance, other = _other_order(log_chance, peak, own, duration)
            if chance > LEAST_OTHER:
                continue
            narrow = _narrowness(lines, sums, peak) if narrow is None else narrow
            if narrow >= NARROW and narrow - chance >= LINE_AND_OTHER:
                orders = (min(own, other), max(own, other))
                yield TurningRotor(60 * peak / duration / own, orders, narrow - chance)
                break


def _contrasts(lines: ComplexArray, sums: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """yᴴ S⁻¹ y of each line and the log probability of more, (n_lines,); 0 at either end."""
    n_lines, n = lines.shape
    contrast, log_chance = np.zeros(n_lines), np.zeros(n_lines)
    inner = np.arange(LINE_REACH, n_lines - LINE_REACH)
    weights = np.linalg.solve(_beside_lines(sums, inner), lines[inner, :, None])[:, :, 0]
    contrast[inner] = np.einsum("ka,ka->k", lines[inner].conj(), weights).real
    free = len(LINES_BESIDE) - n + 1
    chance = special.fdtrc(2 * n, 2 * free, contrast * free / (n * len(LINES_BESIDE)))
    log_chance[inner] = np.log(np.maximum(chance[inner], np.finfo(float).tiny))
    return contrast, log_chance


def _beside_lines(sums: ComplexArray, numbers: IntArray) -> ComplexArray:
    """S of the lines `LINES_BESIDE` each, (n_numbers, n, n)."""
    whole = sums[numbers + LINE_REACH + 1] - sums[numbers - LINE_REACH]
    return _regular(
        (whole - sums[numbers + LINE_GAP] + sums[numbers - LINE_GAP + 1]) / len(LINES_BESIDE)
    )


def _other_order(
    log_chance: FloatArray, number: int, own: int, duration: float
) -> tuple[float, int]:
    """Log probability by chance of what is at another order of a line's speed, and that order.

    A line's frequency is known to half of 1/T; of the lines that this reaches the largest counts,
    and their number.
    """
    found = [(0.0, own)]
    if SLOWEST <= 60 * number / duration / own <= FASTEST:
        for other in (order for order in ORDERS if order != own):
            low = math.floor((number - 0.5) * other / own - 0.5)
            high = math.ceil((number + 0.5) * other / own + 0.5)
            near = log_chance[max(low, 0) : high + 1]
            if len(near):
                found.append((float(near.min()) + math.log(len(near)), other))
    return min(found)


def _narrowness(lines: ComplexArray, sums: ComplexArray, number: int) -> float:
    """Log likelihood ratio of a line on a level background to a mode's resonance on one."""
    weights = np.linalg.solve(_beside_lines(sums, np.array([number]))[0], lines[number])
    own = float(np.abs(lines[number] @ weights.conj()) ** 2)
    beside = np.abs(lines[number + LINES_BESIDE] @ weights.conj()) ** 2
    line = np.log(own) + 1 + len(LINES_BESIDE) * (np.log(beside.mean()) + 1)
    level, peak, damping, offset = np.meshgrid(
        beside.mean() * np.linspace(0.2, 1.0, 9),
        own * np.geomspace(0.01, 1.0, 13),
        LEAST_DAMPING * np.geomspace(1.0, 16.0, 5),
        np.linspace(-0.5, 0.5, 3),
        indexing="ij",
    )
    away = (np.append(LINES_BESIDE, 0) - offset[..., None]) / (damping[..., None] * number)
    expected = level[..., None] + peak[..., None] / (1 + away**2)
    mode = (np.log(expected) + np.append(beside, own) / expected).sum(axis=-1)
    return float(mode.min() - line)


def phase_coherence(lower: ComplexArray, upper: ComplexArray, ratio: int) -> float:
    """c of two stretches of lines about a frequency and its multiple."""
    n = fft.next_fast_len(2 * (ratio * len(lower) + len(upper)))
    turned, other = in_time(lower, n) ** ratio, in_time(upper, n)
    powers = np.mean(np.abs(turned) ** 2) * np.mean(np.abs(other) ** 2)
    if not powers > 0:
        return 0.0
    return float(np.abs(np.mean(turned * other.conj())) / np.sqrt(powers))


def in_time(stretch: ComplexArray, n: int) -> ComplexArray:
    """Motion about the middle line, turned to rest, at n instants."""
    middle = (len(stretch) - 1) // 2
    padded = np.zeros(n, dtype=complex)
    padded[(np.arange(len(stretch)) - middle) % n] = stretch
    return np.asarray(fft.ifft(padded))
