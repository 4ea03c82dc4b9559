"""Turbulent wind on a parked turbine: Kaimal's spectrum, drag, and the damping that it brings.

The air pushes tower, nacelle and the feathered blades along the wind, and across it where
turbulence comes from the side; the blades, edge-on to the wind, then have lift. Both forces grow
with the structure's own velocity against the air: this is the damping, which couples the modes
and makes their shapes complex.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from sensors.arrays import ComplexArray, FloatArray
from sensors.loads.load import (
    LoadError,
    RandomStream,
    generator,
    require_not_negative,
    require_positive,
)
from sensors.loads.spectra import iec_coherence, kaimal
from sensors.loads.synthesis import SegmentedNoise, harmonics, in_chunks
from sensors.settings import NO_KEY
from sensors.structure.rotor_nacelle import apex, blade_axes, rigid_displacement
from sensors.structure.structural_model import StructuralModel

# Chord of the IEA 15 MW blade at even shares of its length, root to tip [m].
# Source: IEAWindTask37/IEA-15-240-RWT (Apache-2.0), OpenFAST/IEA-15-240-RWT_AeroDyn15_blade.dat.
IEA15_CHORDS = (5.20, 5.45, 5.76, 5.32, 4.65, 4.10, 3.62, 3.16, 2.69, 2.17, 0.50)
TURBULENCE_SCALE = 42.0  # Λ₁ of IEC 61400-1 at heights of 60 m and more [m]
ALONG_LENGTH, ACROSS_LENGTH = 8.1 * TURBULENCE_SCALE, 2.7 * TURBULENCE_SCALE  # integral scales [m]
ACROSS_SHARE = 0.8  # σ₂ / σ₁ of IEC 61400-1 [-]
LEAST_COHERENCE = 1e-4  # below this between all points they are drawn independently [-]
_ALONG, _ACROSS = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True)
class Wind:
    """A wind and the drag of what it blows at."""

    speed: float = 2.0
    """Mean wind at the hub [m/s]."""

    turbulence_intensity: float = 0.10
    """σ₁ / mean speed at the hub [-]."""

    shear_exponent: float = 0.14
    """Shear exponent of the power law; IEC 61400-3's over the sea [-]."""

    air_density: ClassVar[float] = 1.225
    """Air density [kg/m³]."""

    tower_drag: ClassVar[float] = 0.7
    """C_D of a rough cylinder beyond its drag crisis [-]."""

    nacelle_drag: ClassVar[float] = 1.2
    """C_D [-]."""

    nacelle_area: float = field(default=100.0, metadata=NO_KEY)
    """Seen along the wind, and the same across [m²]."""

    blade_drag: ClassVar[float] = 0.02
    """C_D of the feathered profile, on its chord [-]."""

    blade_lift_slope: ClassVar[float] = 2 * np.pi
    """dC_L/dα of the feathered profile [1/rad]."""

    blade_chords: tuple[float, ...] = IEA15_CHORDS
    """Blade chords at even shares of the length, root first [m]."""

    tower_points: int = field(default=6, metadata=NO_KEY)
    """Places of the wind field on the tower."""

    blade_points: int = field(default=6, metadata=NO_KEY)
    """On each blade, at most."""

    highest_frequency: float = field(default=12.5, metadata=NO_KEY)
    """Highest frequency of the turbulence [Hz]."""

    def __post_init__(self) -> None:
        require_positive("wind speed", self.speed, "m/s")
        require_not_negative("wind turbulence_intensity", self.turbulence_intensity, "")
        require_positive("wind highest_frequency", self.highest_frequency, "Hz")
        require_not_negative("wind nacelle_area", self.nacelle_area, "m²")
        if min(self.tower_points, self.blade_points) < 1 or len(self.blade_chords) < 2:
            raise LoadError(
                f"wind has {self.tower_points} tower_points, {self.blade_points} blade_points and "
                f"{len(self.blade_chords)} blade_chords; at least 1, 1 and 2 are needed"
            )


@dataclass(frozen=True, slots=True, eq=False)
class WindPoints:
    """Places of the wind field and how the structure moves and is pushed there."""

    positions: FloatArray
    """Across the wind: (y, z), (n_points, 2) [m]."""

    along: FloatArray
    """Rows of displacement in x, (n_points, n_dofs)."""

    across: FloatArray
    """Rows of displacement in y, or flapwise, (n_points, n_dofs)."""

    across_share: FloatArray
    """Across share of the side wind that blows along that row, (n_points,) [-]."""

    along_area: FloatArray
    """C_D A, (n_points,) [m²]."""

    across_area: FloatArray
    """Across area, (C_D + dC_L/dα) A, (n_points,) [m²]."""


def wind_points(model: StructuralModel, wind: Wind) -> WindPoints:
    """Points on the tower above the still water, one at the nacelle, and some on each blade."""
    parts = [_tower_points(model, wind), _nacelle_point(model, wind), *_blade_points(model, wind)]
    columns = zip(*parts, strict=True)
    return WindPoints(*(np.concatenate(column) for column in columns))


def _tower_points(model: StructuralModel, wind: Wind) -> tuple[FloatArray, ...]:
    description = model.description
    water = description.water
    bottom = description.mudline if water is None else water.level
    height = (description.tower_top - bottom) / wind.tower_points
    elevations = bottom + height * (np.arange(wind.tower_points) + 0.5)
    edges = np.array([tube.top for tube in description.tubes])
    tubes = [description.tubes[int(i)] for i in np.searchsorted(edges, elevations)]
    area = wind.tower_drag * height * np.array([tube.diameter for tube in tubes])
    rows = [
        np.array([model.tower_displacement(float(z), axis) for z in elevations])
        for axis in (_ALONG, _ACROSS)
    ]
    positions = np.stack([np.zeros_like(elevations), elevations], axis=1)
    # a cylinder's force is along the whole wind: its side component has half the slope of drag
    return positions, *rows, np.ones_like(area), area, area


def _nacelle_point(model: StructuralModel, wind: Wind) -> tuple[FloatArray, ...]:
    shaft = model.description.rotor_nacelle.tower_to_shaft
    motion = rigid_displacement((0.0, 0.0, shaft))
    rows = np.zeros((2, model.n_dofs))
    rows[:, model.tower_dofs[-1]] = motion[:2]
    area = np.array([wind.nacelle_drag * wind.nacelle_area])
    position = np.array([[0.0, model.description.tower_top + shaft]])
    return position, rows[:1], rows[1:], np.ones(1), area, area


def _blade_points(model: StructuralModel, wind: Wind) -> Iterator[tuple[FloatArray, ...]]:
    blades, nacelle = model.description.blades, model.description.rotor_nacelle
    if blades is None:
        return
    outer = np.array([part.outer for part in blades.elements])
    n_points = min(wind.blade_points, len(outer))
    wanted = outer[-1] * (np.arange(n_points) + 0.7) / n_points
    nodes = np.unique([int(np.argmin(np.abs(outer - r))) for r in wanted])
    radii = outer[nodes]
    bounds = np.concatenate([[0.0], 0.5 * (radii[1:] + radii[:-1]), [outer[-1]]])
    chords = np.interp(
        radii / outer[-1], np.linspace(0.0, 1.0, len(wind.blade_chords)), wind.blade_chords
    )
    surface = chords * np.diff(bounds)
    for number in range(blades.number):
        axes = blade_axes(nacelle, blades, number)
        places = axes.root + np.multiply.outer(radii, axes.span)
        flap = axes.flap.tolist()
        along = [model.blade_displacement(number, int(node) + 1, _ALONG) for node in nodes]
        across = [model.blade_displacement(number, int(node) + 1, flap) for node in nodes]
        yield (
            places[:, 1:] + [0.0, model.description.tower_top],
            np.array(along),
            np.array(across),
            np.full(len(nodes), axes.flap[1]),
            wind.blade_drag * surface,
            (wind.blade_drag + wind.blade_lift_slope) * surface,
        )


def mean_speeds(points: WindPoints, wind: Wind, hub_height: float, speed: float) -> FloatArray:
    """Mean wind at the points, (n_points,) [m/s]: V (z / z_hub)^α."""
    heights = np.maximum(points.positions[:, 1], 1.0)
    return speed * (heights / hub_height) ** wind.shear_exponent


def hub_height(model: StructuralModel) -> float:
    """Height of the rotor's apex above mean water level [m]."""
    return float(model.description.tower_top + apex(model.description.rotor_nacelle)[2])


def aerodynamic_damping(model: StructuralModel, wind: Wind, speed: float) -> FloatArray:
    """Viscous damping that the mean wind gives a parked structure, (n_dofs, n_dofs) [N·s/m].

    Parameters
    ----------
    model : StructuralModel
        The parked structure.
    wind : Wind
        Its shear, air density and drag.
    speed : float
        V, mean at hub height [m/s].

    Notes
    -----
    From the force's slope with the relative speed: ρ C_D A V along the wind, and across it
    ½ ρ (C_D + dC_L/dα) A V.
    """
    points = wind_points(model, wind)
    speeds = mean_speeds(points, wind, hub_height(model), speed)
    along = wind.air_density * points.along_area * speeds
    across = 0.5 * wind.air_density * points.across_area * speeds
    damping: FloatArray = (points.along.T * along) @ points.along
    damping += (points.across.T * across) @ points.across
    return damping


@dataclass(frozen=True, slots=True, eq=False)
class WindLoad:
    """Force of the turbulent wind on a parked structure at rest; its motion is in the damping.

        F_x = ½ ρ C_D A (V + u)|V + u|,   F_y = ½ ρ (C_D + dC_L/dα) A (V + u) v

    u is coherent over the points by IEC 61400-1; v is drawn for each point by itself, as TurbSim's
    default does for the components across the wind.
    """

    wind: Wind
    speed_at: Callable[[float], float]
    """Mean at the hub by time since the first sample [m/s]."""

    points: WindPoints
    hub_height: float
    """Hub height [m]."""

    sampling_rate: float
    """Sampling rate [Hz]."""

    start: float
    """Time of the first step [s]."""

    @property
    def distribution(self) -> FloatArray:
        """(n_dofs, 2 n_points): forces along, then across the wind."""
        return np.concatenate([self.points.along, self.points.across]).T

    @property
    def n_series(self) -> int:
        """Number of series."""
        return 2 * len(self.points.positions)

    def series(self, seed: int, chunk: int) -> Iterator[FloatArray]:
        """Forces at the points without end, (chunk, 2 n_points) [N]."""
        return in_chunks(self._segments(seed), chunk)

    def turbulence(self, seed: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """u along and v across the mean wind, segments (n_points, n) each [m/s]."""
        frequencies = harmonics(self.wind.highest_frequency)
        sources = (
            (self._along, RandomStream.WIND_ALONG),
            (self._across, RandomStream.WIND_ACROSS),
        )
        return zip(
            *(
                SegmentedNoise(
                    component(frequencies),
                    n_sources=len(self.points.positions),
                    n_harmonics=len(frequencies),
                    sampling_rate=self.sampling_rate,
                    start=self.start,
                    rng=generator(seed, stream),
                )
                for component, stream in sources
            ),
            strict=True,
        )

    def response_spectrum(self, frequencies: FloatArray, gains: ComplexArray) -> FloatArray:
        """Return the spectrum of the response to the linear part of the force; see `Load`.

        The linear part is that in u and v, of the wind at time 0.
        """
        speed = self.speed_at(0.0)
        along, across = np.split(gains, 2, axis=2)
        slopes = self._slopes(speed)
        along, across = along * slopes[0], across * slopes[1]
        coherence = self.coherence(frequencies, speed)
        power = np.einsum("fop,fpq,foq->fo", along, coherence, along.conj()).real
        spectrum = self.along_spectrum(frequencies, speed)[:, None] * power
        power = (np.abs(across) ** 2).sum(axis=2)
        spectrum += self.across_spectrum(frequencies, speed)[:, None] * power
        return np.where(frequencies[:, None] <= self.wind.highest_frequency, spectrum, 0.0)

    def along_spectrum(self, frequencies: FloatArray, speed: float) -> FloatArray:
        """Spectrum of u at any point, (n_frequencies,) [(m/s)²/Hz]."""
        deviation = self.wind.turbulence_intensity * speed
        return kaimal(frequencies, wind_speed=speed, deviation=deviation, length=ALONG_LENGTH)

    def across_spectrum(self, frequencies: FloatArray, speed: float) -> FloatArray:
        """Spectrum of v at any point, (n_frequencies,) [(m/s)²/Hz]."""
        deviation = ACROSS_SHARE * self.wind.turbulence_intensity * speed
        return kaimal(frequencies, wind_speed=speed, deviation=deviation, length=ACROSS_LENGTH)

    def coherence(self, frequencies: FloatArray, speed: float) -> FloatArray:
        """Between the points, (n_frequencies, n_points, n_points) [-]."""
        apart = self.points.positions[:, None] - self.points.positions[None]
        distances = np.linalg.norm(apart, axis=2)
        return iec_coherence(frequencies, distances, wind_speed=speed, length=ALONG_LENGTH)

    def _slopes(self, speed: float) -> tuple[FloatArray, FloatArray]:
        """dF_x/du and dF_y/dv at the points [N·s/m]."""
        means = mean_speeds(self.points, self.wind, self.hub_height, speed)
        half = 0.5 * self.wind.air_density * means
        across = half * self.points.across_area * self.points.across_share
        return 2.0 * half * self.points.along_area, across

    def _along(self, frequencies: FloatArray) -> Callable[[float, ComplexArray], ComplexArray]:
        factors: dict[float, FloatArray] = {}  # of the present speed

        def coloured(time: float, white: ComplexArray) -> ComplexArray:
            speed = self.speed_at(time)
            if speed not in factors:
                factors.clear()
                factors[speed] = self._coherence_factor(frequencies, speed)
            factor = factors[speed]
            result = white.copy()
            n = len(factor)
            result[:, :n] = np.einsum("fpq,qf->pf", factor, white[:, :n])
            return result * np.sqrt(self.along_spectrum(frequencies, speed))

        return coloured

    def _coherence_factor(self, frequencies: FloatArray, speed: float) -> FloatArray:
        """Return Cholesky factors of the coherence, (n, n_points, n_points).

        They go up to the frequency at which the points are no longer coherent.
        """
        apart = self.points.positions[:, None] - self.points.positions[None]
        nearest = np.min(np.linalg.norm(apart, axis=2) + 1e9 * np.eye(len(apart)), initial=1e9)
        last = -np.log(LEAST_COHERENCE) / 12.0 * speed / nearest  # [Hz]
        coherent = frequencies[frequencies <= last]
        if not coherent.size:
            return np.empty((0, *apart.shape[:2]))
        return np.asarray(np.linalg.cholesky(self.coherence(coherent, speed)), dtype=np.float64)

    def _across(self, frequencies: FloatArray) -> Callable[[float, ComplexArray], ComplexArray]:
        def coloured(time: float, white: ComplexArray) -> ComplexArray:
            return white * np.sqrt(self.across_spectrum(frequencies, self.speed_at(time)))

        return coloured

    def _segments(self, seed: int) -> Iterator[FloatArray]:
        time = self.start
        for along, across in self.turbulence(seed):
            duration = along.shape[1] / self.sampling_rate
            ends = [
                mean_speeds(self.points, self.wind, self.hub_height, self.speed_at(at))
                for at in (time, time + duration)
            ]
            share = np.arange(along.shape[1]) / along.shape[1]
            along += ends[0][:, None] + np.multiply.outer(ends[1] - ends[0], share)
            yield self._forces(along, across)
            time += duration

    def _forces(self, along: FloatArray, across: FloatArray) -> FloatArray:
        """(n, 2 n_points) [N] from the wind's components at the points, (n_points, n) [m/s]."""
        half = 0.5 * self.wind.air_density
        pushed = (half * self.points.along_area)[:, None] * along * np.abs(along)
        sideways = half * self.points.across_area * self.points.across_share
        return np.concatenate([pushed, sideways[:, None] * along * across]).T


def wind_load(
    model: StructuralModel,
    wind: Wind,
    speed_at: Callable[[float], float],
    *,
    sampling_rate: float,
    start: float = 0.0,
) -> WindLoad:
    """Return the wind's force on a parked turbine.

    Parameters
    ----------
    speed_at : Callable[[float], float]
        Mean speed at the hub by time since the first sample [m/s]; more than 0.
    """
    return WindLoad(
        wind=wind,
        speed_at=speed_at,
        points=wind_points(model, wind),
        hub_height=hub_height(model),
        sampling_rate=sampling_rate,
        start=start,
    )
