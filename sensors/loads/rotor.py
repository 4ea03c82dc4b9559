"""What a turning rotor adds to the tower: thrust with its turbulence, damping, harmonics.

A rotor that turns pushes the tower at multiples of its speed: at 1P by unequal blades, at 3P and
6P by each blade's passage through shear and the tower's shadow. These are no modes of the
structure, though they look like very sharp ones.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sensors.arrays import ComplexArray, FloatArray
from sensors.loads.load import RandomStream, generator, require_not_negative
from sensors.loads.operating_states import SteadyState
from sensors.loads.spectra import kaimal
from sensors.loads.synthesis import SegmentedNoise, harmonics, in_chunks
from sensors.loads.wind import ALONG_LENGTH, Wind
from sensors.settings import NO_KEY
from sensors.structure.rotor_nacelle import apex, rigid_displacement
from sensors.structure.structural_model import StructuralModel

ROTOR_RADIUS = 120.0  # of the IEA 15 MW [m]
HIGHEST_TURBULENCE = 2.0  # of the thrust's turbulence; the rotor averages what is faster [Hz]
CURVE_STEP = 1.0  # [s] between points of the slow curves


@dataclass(frozen=True, slots=True)
class Rotor:
    """The forces of a turning rotor, over its mean thrust."""

    first_harmonic: float = 0.002
    """Amplitude at 1P over the mean thrust [-]."""

    third_harmonic: float = 0.010
    """Amplitude at 3P over the mean thrust [-]."""

    sixth_harmonic: float = field(default=0.003, metadata=NO_KEY)
    """Amplitude at 6P over the mean thrust [-]."""

    side_share: ClassVar[float] = 0.3
    """Side-side over fore-aft amplitude of the harmonics [-]."""

    damping_share: ClassVar[float] = 0.5
    """dT/dV of the controlled rotor over 2T/V, that of a fixed one [-]."""

    idling_imbalance: float = field(default=2e3, metadata=NO_KEY)
    """Amplitude at 1P of an idling rotor [N]."""

    def __post_init__(self) -> None:
        for name in self.__slots__:
            require_not_negative(f"rotor {name}", getattr(self, name), "")


def thrust_slope(rotor: Rotor, steady: SteadyState, wind_speed: float) -> float:
    """dT/dV: what wind adds to the thrust and the tower's motion takes from it [N·s/m]."""
    return rotor.damping_share * 2.0 * steady.thrust / wind_speed


def rotor_damping(model: StructuralModel, slope: float) -> FloatArray:
    """Damping that the thrust gives the rotor's apex along the wind, (n_dofs, n_dofs) [N·s/m]."""
    row = _apex_rows(model)[0]
    return slope * np.outer(row, row)


def averaging(frequencies: FloatArray, wind_speed: float) -> FloatArray:
    """|χ|², how much of a gust's power the whole rotor feels, (n_frequencies,) [-].

    Parameters
    ----------
    frequencies : ndarray, shape (n_frequencies,)
        f [Hz].
    wind_speed : float
        V [m/s].

    Notes
    -----
        |χ|² = 1 / (1 + (2 f √A / V)^(4/3))²

    A is the rotor's area.

    References
    ----------
    Vickery, "On the flow behind a coarse grid and its use as a model of atmospheric turbulence",
    NPL Aero Report 1143 (1965).
    """
    side = np.sqrt(np.pi) * ROTOR_RADIUS
    return (1.0 + (2.0 * frequencies * side / wind_speed) ** (4.0 / 3.0)) ** -2.0


@dataclass(frozen=True, slots=True, eq=False)
class RotorLoad:
    """Force of a turning rotor on its apex: two series, fore-aft and side-side [N].

    F_x = T(t) + dT/dV u(t) + Σ_n a_n T cos(n Ω t),   F_y the harmonics a quarter turn later
    """

    rotor: Rotor
    wind: Wind
    steady_at: Callable[[float], SteadyState]
    """Rotor, pitch, power and thrust by time since the first sample [s]."""

    speed_at: Callable[[float], float]
    """Mean wind at the hub [m/s]."""

    distribution: FloatArray
    """Distribution, (n_dofs, 2)."""

    sampling_rate: float
    """Sampling rate [Hz]."""

    start: float
    """Time of the first step [s]."""

    @property
    def n_series(self) -> int:
        """Number of series."""
        return 2

    def series(self, seed: int, chunk: int) -> Iterator[FloatArray]:
        """Forces without end, (chunk, 2) [N]."""
        return in_chunks(self._segments(seed), chunk)

    def response_spectrum(self, frequencies: FloatArray, gains: ComplexArray) -> FloatArray:
        """Return the spectrum of a structure's response to the thrust's turbulence; see `Load`.

        It is that of time 0; the harmonics are lines and have none.
        """
        speed = self.speed_at(0.0)
        slope = thrust_slope(self.rotor, self.steady_at(0.0), speed)
        power = (slope * np.abs(gains[:, :, 0])) ** 2
        inside = np.asarray(frequencies) <= HIGHEST_TURBULENCE
        return power * (self._gusts(np.asarray(frequencies), speed) * inside)[:, None]

    def _gusts(self, frequencies: FloatArray, speed: float) -> FloatArray:
        """Spectrum of the wind averaged over the rotor [(m/s)²/Hz]."""
        deviation = self.wind.turbulence_intensity * speed
        density = kaimal(frequencies, wind_speed=speed, deviation=deviation, length=ALONG_LENGTH)
        return density * averaging(frequencies, speed)

    def _segments(self, seed: int) -> Iterator[FloatArray]:
        frequencies = harmonics(HIGHEST_TURBULENCE)

        def coloured(time: float, white: ComplexArray) -> ComplexArray:
            return white * np.sqrt(self._gusts(frequencies, self.speed_at(time)))

        noise = SegmentedNoise(
            coloured,
            n_sources=1,
            n_harmonics=len(frequencies),
            sampling_rate=self.sampling_rate,
            start=self.start,
            rng=generator(seed, RandomStream.ROTOR),
        )
        time, turns = self.start, 0.0
        for (gust,) in noise:
            times = time + np.arange(len(gust)) / self.sampling_rate
            thrust, slope, speed, amplitude = self._curves(times)
            angle = turns + np.concatenate([[0.0], np.cumsum(speed)]) / self.sampling_rate
            turns = float(angle[-1] % 1.0)
            along, across = self._harmonics(2 * np.pi * angle[:-1], thrust, amplitude)
            yield np.stack([thrust + slope * gust + along, self.rotor.side_share * across], axis=1)
            time += len(gust) / self.sampling_rate

    def _curves(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return thrust, its slope, rotor speed and idling imbalance at the times.

        In [N], [N·s/m], [1/s] and [N].
        """
        knots = np.arange(times[0], times[-1] + 2 * CURVE_STEP, CURVE_STEP)
        rows = []
        for knot in knots.tolist():
            steady, speed = self.steady_at(knot), self.speed_at(knot)
            turning = self.rotor.idling_imbalance if steady.rotor_speed > 0 else 0.0
            slope = thrust_slope(self.rotor, steady, speed)
            rows.append((steady.thrust, slope, steady.rotor_speed / 60.0, turning))
        thrust, slope, speed, turning = (np.interp(times, knots, c) for c in np.array(rows).T)
        return thrust, slope, speed, turning

    def _harmonics(
        self, angle: FloatArray, thrust: FloatArray, imbalance: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Sums of the harmonics along and, a quarter turn later, across the wind [N]."""
        rotor = self.rotor
        orders = {
            1: rotor.first_harmonic * thrust + imbalance,
            3: rotor.third_harmonic * thrust,
            6: rotor.sixth_harmonic * thrust,
        }
        along, across = np.zeros_like(angle), np.zeros_like(angle)
        for order, amplitude in orders.items():
            along += amplitude * np.cos(order * angle)
            across += amplitude * np.sin(order * angle)
        return along, across


def rotor_load(
    model: StructuralModel,
    rotor: Rotor,
    wind: Wind,
    *,
    steady_at: Callable[[float], SteadyState],
    speed_at: Callable[[float], float],
    sampling_rate: float,
    start: float = 0.0,
) -> RotorLoad:
    """Return the force of a turning rotor on the structure.

    Arguments as the fields of `RotorLoad`.
    """
    rows = _apex_rows(model)
    return RotorLoad(rotor, wind, steady_at, speed_at, rows.T, sampling_rate, start)


def _apex_rows(model: StructuralModel) -> FloatArray:
    """(2, n_dofs): displacement of the rotor's apex in x and y."""
    rows = np.zeros((2, model.n_dofs))
    motion = rigid_displacement(apex(model.description.rotor_nacelle))
    rows[:, model.tower_dofs[-1]] = motion[:2]
    return rows
