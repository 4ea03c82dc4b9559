"""Harmonics of one machine in a window whose rotor speed is not known.

However a rotor's speed wanders, its sixth harmonic turns by just twice the phase of its third. With
a(t) and b(t) the motion around f and around r f, turned to rest,

    c = |⟨aʳ b*⟩| / √(⟨|a|²ʳ⟩ ⟨|b|²⟩)

is near 1 for harmonics, and for modes under random loads as small as the mean of n random phases,
n lines of the spectrum: (1 − c²)^(n−1) is the probability of more by chance. The amplitude of a
harmonic is steady besides, which a mode's is not.

The phase of a(t) is then the machine's own, and its rate the speed that no instrument has measured.
Source: the bicoherence, Kim and Powers (1979), IEEE Trans. Plasma Sci. 7; the probability of a
coherence, Carter, Knapp and Nuttall (1973), IEEE Trans. Audio Electroacoust. 21.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft

from pipeline.oma.data_quality.rotor_harmonics import ORDERS
from pipeline.oma.preprocessing import lines_of_channels
from sensors.arrays import BoolArray, ComplexArray, FloatArray

WANDERING = 0.03  # of a harmonic's frequency to either side that its speed wanders by [-]
RATIOS = (2, 3)  # of two harmonics' frequencies
LEAST_CYCLES = 20  # f T
MOST_PEAKS = 8  # the strongest are looked at
NEIGHBOURING = 0.04  # peaks this near to a stronger one are its own, relative
RARE = 1e-4  # probability by chance: of 268 windows without harmonics (bending pairs 70001 to 70030
# and 70101 to 70180, structures, parked towers, noise) none was rarer, of 30 with them 27
PURE = 0.8  # least coherence of motion that is the machine's for the most part: of 12 windows with
# harmonics of .5 to 3 times the modes (seeds 70001 to 70012) the least was .87
STEADY = 2.4  # ⟨|a|⁴⟩/⟨|a|²⟩² under the Hann taper: 1.9 of one amplitude, 3.9 under random loads


@dataclass(frozen=True, slots=True)
class CoupledHarmonics:
    """Two frequencies whose motion keeps one phase."""

    frequency: float
    """Of the lower one [Hz]."""
    ratio: int
    """Of the upper one to it [-]."""
    coherence: float
    """c [-]"""

    @property
    def order(self) -> int:
        """Times a turn of the lower one, of a rotor of three blades: what goes with its double is
        the blades' passing, with its triple the turn itself."""
        return 3 if self.ratio == 2 else 1

    @property
    def is_pure(self) -> bool:
        """Whether what shakes there is the machine's for the most part, so that its phase is."""
        return self.coherence >= PURE

    def holds(self, frequencies: FloatArray) -> BoolArray:
        """Whether harmonics of the rotor may hold all that shakes at these frequencies [Hz].

        Within the reach that the phase is read in, motion in phase with the harmonic is taken for
        it, whatever shook the structure there.
        """
        orders = np.array(ORDERS) * self.frequency / self.order
        distance = np.abs(np.asarray(frequencies)[..., None] / orders - 1)
        return np.asarray((distance <= WANDERING).any(axis=-1))


def coupled_harmonics(samples: FloatArray, sampling_rate: float) -> CoupledHarmonics | None:
    """The two harmonics that keep one phase most surely; None where none do.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    duration = len(samples) / sampling_rate
    scales = np.std(samples, axis=0)
    scales = np.where(scales > 0, scales, 1.0)
    lines = lines_of_channels(samples, scales, np.hanning(len(samples)))
    found: list[tuple[float, CoupledHarmonics]] = []
    for peak in _peaks(lines):
        lower = _around(lines, peak)
        squares = np.abs(_in_time(lower, 8 * len(lower))) ** 2
        if np.mean(squares**2) > STEADY * np.mean(squares) ** 2:
            continue
        for ratio in RATIOS:
            upper = _around(lines, ratio * peak)
            coherence = _phase_coherence(lower, upper, ratio)
            chance = (1 - min(coherence, 1.0) ** 2) ** (len(lower) - 1)
            found.append((chance, CoupledHarmonics(peak / duration, ratio, coherence)))
    chance, surest = min(found, key=lambda each: each[0], default=(1.0, None))
    return surest if chance <= RARE else None


def rotor_speed_of(
    coupled: CoupledHarmonics, samples: FloatArray, sampling_rate: float
) -> FloatArray:
    """Speed of the rotor behind two harmonics by the phase of the lower one, (n,) [rpm].

    What it wanders by within less than the time of the reach, 1 / (`WANDERING` f), is not followed.

    Parameters
    ----------
    coupled : CoupledHarmonics
        Of these samples.
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    n, duration = len(samples), len(samples) / sampling_rate
    scales = np.std(samples, axis=0)
    lines = lines_of_channels(samples, np.where(scales > 0, scales, 1.0))
    number = round(coupled.frequency * duration)
    around = _around(lines, number)
    motion = _in_time(around, 8 * len(around))
    step = duration / len(motion)
    wander = np.gradient(np.unwrap(np.angle(motion)), step) / (2 * np.pi)
    times = np.arange(n) / sampling_rate
    frequency = number / duration + np.interp(times, step * np.arange(len(motion)), wander)
    return np.asarray(60 * frequency / coupled.order)


def _peaks(lines: ComplexArray) -> list[int]:
    """Numbers of the strongest lines that have all of their harmonics in the spectrum."""
    power = (np.abs(lines) ** 2).sum(axis=1)
    smooth = power[:-2] + power[1:-1] + power[2:]
    last = int(len(power) / (max(RATIOS) * (1 + 2 * WANDERING)))
    inner = smooth[LEAST_CYCLES - 1 : last]
    tops = 1 + np.flatnonzero((inner[1:-1] >= inner[:-2]) & (inner[1:-1] > inner[2:]))
    chosen: list[int] = []
    for place in tops[np.argsort(-inner[tops], kind="stable")].tolist():
        number = place + LEAST_CYCLES
        if all(abs(number / other - 1) > NEIGHBOURING for other in chosen):
            chosen.append(number)
        if len(chosen) == MOST_PEAKS:
            break
    return chosen


def _around(lines: ComplexArray, number: int) -> ComplexArray:
    """Motion of the strongest direction within the reach of a line, (n_lines,), the line amid."""
    reach = round(WANDERING * number)
    part = lines[number - reach : number + reach + 1]
    _, vectors = np.linalg.eigh(part.conj().T @ part)
    return np.asarray(part @ vectors[:, -1])


def _phase_coherence(lower: ComplexArray, upper: ComplexArray, ratio: int) -> float:
    """c of two stretches of lines about a frequency and its multiple."""
    n = fft.next_fast_len(2 * (ratio * len(lower) + len(upper)))
    turned, other = _in_time(lower, n) ** ratio, _in_time(upper, n)
    powers = np.mean(np.abs(turned) ** 2) * np.mean(np.abs(other) ** 2)
    if not powers > 0:
        return 0.0
    return float(np.abs(np.mean(turned * other.conj())) / np.sqrt(powers))


def _in_time(stretch: ComplexArray, n: int) -> ComplexArray:
    """Motion about the middle line, turned to rest, at n instants."""
    middle = (len(stretch) - 1) // 2
    padded = np.zeros(n, dtype=complex)
    padded[(np.arange(len(stretch)) - middle) % n] = stretch
    return np.asarray(fft.ifft(padded))
