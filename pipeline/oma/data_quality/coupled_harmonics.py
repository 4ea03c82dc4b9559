"""Harmonics of machines in a window: what is taken off, and what the window is warned of.

Where the speed of the rotor is known, that says it (`rotor_harmonics.py`). Where it is not:

However a rotor's speed wanders, its sixth harmonic turns by just twice the phase of its third. With
a(t) and b(t) the motion around f and around r f, turned to rest,

    c = |⟨aʳ b*⟩| / √(⟨|a|²ʳ⟩ ⟨|b|²⟩)

is near 1 for harmonics, and for modes under random loads as small as the mean of n random phases,
n lines of the spectrum: (1 − c²)^(n−1) is the probability of more by chance. The amplitude of a
harmonic is steady besides, which a mode's is not.

The phase of a(t) is then the machine's own, and its rate the speed that no instrument has measured.
Harmonics too weak for that warn all the same that a rotor turns (`turning_rotor.py`).
Source: the bicoherence, Kim and Powers (1979), IEEE Trans. Plasma Sci. 7; the probability of a
coherence, Carter, Knapp and Nuttall (1973), IEEE Trans. Audio Electroacoust. 21.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipeline.messages import QualityWarning
from pipeline.oma.data_quality.rotor_harmonics import (
    ORDERS,
    follows_rotor,
    turns,
    without_harmonics,
)
from pipeline.oma.data_quality.turning_rotor import (
    FASTEST,
    LEAST_CYCLES,
    MOST_PEAKS,
    SLOWEST,
    STEADY,
    TurningRotor,
    in_time,
    phase_coherence,
    turning_rotor,
)
from pipeline.oma.preprocessing import lines_of_channels
from sensors.arrays import BoolArray, ComplexArray, FloatArray

WANDERING = 0.03  # of a harmonic's frequency to either side that its speed wanders by [-]
RATIOS = (2, 3)  # of two harmonics' frequencies
NEIGHBOURING = 0.04  # peaks this near to a stronger one are its own, relative
RARE = 1e-4  # probability by chance: of 268 windows without harmonics (bending pairs 70001 to 70030
# and 70101 to 70180, structures, parked towers, noise) none was rarer, of 30 with them 27
PURE = 0.8  # least coherence of motion that is the machine's for the most part: of 12 windows with
# harmonics of .5 to 3 times the modes (seeds 70001 to 70012) the least was .87

TURNING_ROTOR = "turning-rotor"  # code of the warning
KNOWN_BY_SPEED = "a mode reported there may be one of them, which the rotor's speed would take off"
TAKEN_OFF = (
    "taken off along the phase that they keep; a mode within 3 % of them is not seen, for which "
    "the rotor's speed must be known"
)


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
        squares = np.abs(in_time(lower, 8 * len(lower))) ** 2
        if np.mean(squares**2) > STEADY * np.mean(squares) ** 2:
            continue
        for ratio in RATIOS:
            upper = _around(lines, ratio * peak)
            coherence = phase_coherence(lower, upper, ratio)
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
    motion = in_time(around, 8 * len(around))
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


@dataclass(frozen=True, slots=True, eq=False)
class WithoutMachines:
    """A window less the harmonics of a turning rotor."""

    samples: FloatArray
    """(n, n_channels)"""
    left: FloatArray | None = None
    """What that has left of each line's power, (n // 2 + 1,) [-]; None: all."""
    follows: Callable[[float], bool] = lambda _: False
    """Whether a frequency [Hz] is a harmonic's."""
    warnings: tuple[QualityWarning, ...] = ()


def without_machines(
    steady: FloatArray, sampling_rate: float, rotor_speed: FloatArray | None
) -> WithoutMachines:
    """The window less what follows a rotor of known speed; or else what keeps one phase with it.

    Parameters
    ----------
    steady : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    rotor_speed : ndarray, shape (n,), or None
        At each sample [rpm]; None: unknown.
    """
    duration = len(steady) / sampling_rate
    if rotor_speed is not None and turns(rotor_speed):
        rest = without_harmonics(steady, sampling_rate, rotor_speed)
        coupled = coupled_harmonics(rest.samples, sampling_rate)
        return WithoutMachines(
            rest.samples,
            rest.left,
            lambda f: follows_rotor(f, duration, rotor_speed),
            () if coupled is None else (_of_a_machine(coupled, KNOWN_BY_SPEED),),
        )
    coupled = coupled_harmonics(steady, sampling_rate)
    turning = rotor_warnings(steady, sampling_rate, coupled)
    if coupled is None:
        return WithoutMachines(steady, warnings=turning)
    if not coupled.is_pure:
        warnings = (_of_a_machine(coupled, KNOWN_BY_SPEED), *turning)
        return WithoutMachines(steady, warnings=warnings)
    speed = rotor_speed_of(coupled, steady, sampling_rate)
    rest = without_harmonics(steady, sampling_rate, speed)
    return WithoutMachines(
        rest.samples,
        np.where(coupled.holds(np.arange(len(rest.left)) / duration), 0.0, rest.left),
        lambda f: bool(coupled.holds(np.array(f))) or follows_rotor(f, duration, speed),
        (_of_a_machine(coupled, TAKEN_OFF), *turning),
    )


def rotor_warnings(
    steady: FloatArray, sampling_rate: float, coupled: CoupledHarmonics | None = None
) -> tuple[QualityWarning, ...]:
    """A warning where a rotor turns in the window. coupled: the strongest two harmonics."""
    rotor = None if coupled is None else rotor_behind(coupled)
    rotor = rotor or turning_rotor(steady, sampling_rate)
    return () if rotor is None else (QualityWarning(TURNING_ROTOR, _in_words(rotor)),)


def rotor_behind(coupled: CoupledHarmonics) -> TurningRotor | None:
    """The rotor that two strong harmonics are of; None where no rotor is as slow or as fast."""
    speed = 60 * coupled.frequency / coupled.order
    if not SLOWEST <= speed <= FASTEST:
        return None
    return TurningRotor(speed, (coupled.order, coupled.order * coupled.ratio))


def _in_words(rotor: TurningRotor) -> str:
    lower, upper = (order * rotor.speed / 60 for order in rotor.orders)
    return (
        f"what shakes at {lower:.3g} and at {upper:.3g} Hz are harmonics of one speed: a rotor "
        f"turns, at {rotor.speed:.2g} rpm if they are {rotor.orders[0]} and {rotor.orders[1]} "
        "times a turn"
    )


def _of_a_machine(coupled: CoupledHarmonics, consequence: str) -> QualityWarning:
    lower, upper = coupled.frequency, coupled.ratio * coupled.frequency
    return QualityWarning(
        "harmonic",
        f"what shakes at {lower:.3g} and at {upper:.3g} Hz keeps one phase (coherence "
        f"{coupled.coherence:.2f}): harmonics of a machine, as of a turning rotor; {consequence}",
    )
