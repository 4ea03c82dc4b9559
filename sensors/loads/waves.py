"""A sea and what it does to a monopile: JONSWAP, linear waves, Morison's equation.

With the surface at rest the force is linear in the waves but for its drag. Integrated to the
instantaneous surface it gains harmonics that reach far beyond the sea's own band, and these are
what shakes the higher modes.

Diffraction is left out: C_M is the same at every frequency. A pile of 10 m in 30 m of water has
2.06 at .125 Hz and .65 at .3 Hz (MacCamy and Fuchs 1954), so that waves of a few seconds push up
to three times as hard here as at sea.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from numpy.polynomial import legendre

from sensors.arrays import ComplexArray, FloatArray
from sensors.loads.load import (
    LoadError,
    RandomStream,
    generator,
    require_not_negative,
    require_positive,
)
from sensors.loads.spectra import horizontal_motion
from sensors.loads.synthesis import OVERLAP, SegmentedNoise, harmonics, in_chunks
from sensors.sea_spectrum import jonswap
from sensors.structure.structural_model import StructuralModel

N_HEIGHTS = 12  # places over the water's depth where the force is evaluated
N_PATTERNS = 8  # polynomials over the wetted height that the force is written in
CREST = 1.5  # highest crest that finds a monopile to push, over Hs [-]
_X_AND_Y = 2


@dataclass(frozen=True, slots=True)
class Sea:
    """A sea and how its force on the monopile is reckoned."""

    significant_wave_height: float = 3.5
    """Hs [m]."""

    peak_period: float = 8.0
    """Tp [s]."""

    peak_enhancement: ClassVar[float] = 3.3
    """γ [-]."""

    highest_frequency: ClassVar[float] = 0.6
    """Cut of the spectrum; Hs is that of the band below [Hz]."""

    direction: float = 0.0
    """Towards which waves run, from downwind to the side (x to y) [deg]."""

    spreading: float | None = None
    """s of cos²ˢ(Δ/2); None: long-crested, one direction [-]."""

    surface: Literal["mean", "instantaneous"] = "instantaneous"
    """Surface up to which the force acts: the mean or the instantaneous one."""

    inertia_coefficient: float = 2.0
    """C_M [-]."""

    drag_coefficient: float = 1.0
    """C_D [-], a rough cylinder."""

    def __post_init__(self) -> None:
        require_sea_state("sea", self.significant_wave_height, self.peak_period)
        require_not_negative("sea inertia_coefficient", self.inertia_coefficient, "")
        require_not_negative("sea drag_coefficient", self.drag_coefficient, "")
        if self.spreading is not None and not self.spreading > 0:
            raise LoadError(f"sea spreading is {self.spreading:g}; s must be positive")


def require_sea_state(what: str, height: float | None, period: float | None) -> None:
    """Raise LoadError for a sea that cannot be; what is None is not stated.

    Parameters
    ----------
    what : str
        Whose sea it is, for the message.
    height, period : float or None
        Significant wave height [m] and peak period [s].
    """
    if height is not None:
        require_not_negative(f"{what} significant_wave_height", height, "m")
    if period is None:
        return
    require_positive(f"{what} peak_period", period, "s")
    if not 1.0 / period < Sea.highest_frequency:
        raise LoadError(
            f"{what} peak_period is {period:g} s; the spectrum ends at "
            f"{Sea.highest_frequency:g} Hz, so it must be longer than "
            f"{1.0 / Sea.highest_frequency:.3g} s"
        )


@dataclass(frozen=True, slots=True)
class SeaState:
    """What changes of a sea over hours."""

    significant_wave_height: float
    """Significant wave height [m]."""

    peak_period: float
    """Peak period [s]."""

    level: float
    """Level of the water [m]."""

    direction: float
    """As in `Sea`, seen from the nacelle [deg]."""


def elevation_spectrum(sea: Sea, state: SeaState, frequencies: FloatArray) -> FloatArray:
    """JONSWAP spectrum of the surface, (n_frequencies,) [m²/Hz]; ∫ S df = Hs²/16 below the cut."""

    def shape(f: FloatArray) -> FloatArray:
        density = jonswap(
            f, peak_frequency=1 / state.peak_period, peak_enhancement=sea.peak_enhancement
        )
        return np.where(f <= sea.highest_frequency, density, 0.0)

    grid = np.linspace(0.0, sea.highest_frequency, 4001)
    variance = state.significant_wave_height**2 / 16
    return variance / np.trapezoid(shape(grid), grid) * shape(np.asarray(frequencies))


def directional_covariance(spreading: float | None, direction: float) -> FloatArray:
    """(3, 3) covariance of (η, η cos θ, η sin θ) over the directions θ of a sea, var η = 1.

    Parameters
    ----------
    spreading : float or None
        s of D(θ) ∝ cos²ˢ((θ − θ₀)/2); None: one direction.
    direction : float
        θ₀ [deg].

    Returns
    -------
    ndarray, shape (3, 3)

    Notes
    -----
        <cos Δ> = s/(s+1),  <cos 2Δ> = s(s−1)/((s+1)(s+2))
    """
    s = np.inf if spreading is None else spreading
    first = 1.0 if np.isinf(s) else s / (s + 1)
    second = 1.0 if np.isinf(s) else s * (s - 1) / ((s + 1) * (s + 2))
    own = np.array(
        [[1.0, first, 0.0], [first, (1 + second) / 2, 0.0], [0.0, 0.0, (1 - second) / 2]]
    )
    c, si = np.cos(np.radians(direction)), np.sin(np.radians(direction))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, c, -si], [0.0, si, c]])
    return turn @ own @ turn.T


@dataclass(frozen=True, slots=True, eq=False)
class WaveLoad:
    """Morison's force on a monopile, as amplitudes of polynomials over the wetted height.

        dF/dz = ρ C_M π D²/4 u' + ½ ρ C_D D |u| u,   −d < z < η (or 0)

    u and u' are those of linear waves; up to the instantaneous surface they are Wheeler's, which
    stretch the profile with the water column: at a share s of the column's height the water moves
    as it would at that share of the still depth. The relative motion of the monopile enters
    through the added mass of the structure; in the drag it is left out.

    Its 2 × N_PATTERNS series are the generalised forces ∫ P_p(x(z)) dF in x, then in y. Legendre
    polynomials P_p carry them to the structure, so that a force at a moving surface reaches a mode
    smoothly, without the kinks that passing from node to node would make.
    """

    sea: Sea
    state_at: Callable[[float], SeaState]
    """State of the sea by time since the first sample [s]."""

    distribution: FloatArray
    """Distribution, (n_dofs, 2 N_PATTERNS) [N]."""

    sampling_rate: float
    """Sampling rate [Hz]."""

    start: float
    """Time of the first step [s]."""

    mudline: float
    """Mudline [m]."""

    top: float
    """Top of the polynomials' span [m]."""

    water_density: float
    """ρ [kg/m³]."""

    diameters: FloatArray
    """Diameters at the places of evaluation, (N_HEIGHTS,) [m]."""

    @property
    def n_series(self) -> int:
        """Number of series."""
        return self.distribution.shape[1]

    def series(self, seed: int, chunk: int) -> Iterator[FloatArray]:
        """Generalised forces without end, (chunk, n_series) [N]."""
        return in_chunks(self._segments(seed), chunk)

    def surface(self, seed: int) -> Iterator[FloatArray]:
        """Yield the surface's elevation above the still water at the axis, in segments (n,) [m]."""
        for segment in self._kinematics(seed):
            yield segment[0]

    def response_spectrum(self, frequencies: FloatArray, gains: ComplexArray) -> FloatArray:
        """Return the spectrum of the response to the linear part of the force; see `Load`.

        The linear part is the inertia up to the still water, of the sea at time 0.
        """
        state = self.state_at(0.0)
        positive = np.maximum(frequencies, 1e-3)  # S(0) = 0
        amplitude = self._linear_force(positive, state)
        x, y = (
            np.einsum("fop,pf->fo", part, amplitude) for part in np.split(gains, _X_AND_Y, axis=2)
        )
        covariance = directional_covariance(self.sea.spreading, state.direction)[1:, 1:]
        power = covariance[0, 0] * np.abs(x) ** 2 + covariance[1, 1] * np.abs(y) ** 2
        power += 2 * covariance[0, 1] * (x * y.conj()).real
        return power * elevation_spectrum(self.sea, state, positive)[:, None]

    def _linear_force(self, frequencies: FloatArray, state: SeaState) -> ComplexArray:
        """Generalised inertia forces per unit elevation, (N_PATTERNS, n_frequencies) [N/m]."""
        heights, weights = _column()
        depth = state.level - self.mudline
        motion = horizontal_motion(frequencies, heights, depth=depth)
        force = (self._inertia * weights * depth)[:, None] * motion
        patterns = legendre.legvander(self._place(heights * depth), N_PATTERNS - 1)
        return (patterns.T @ force) * (2j * np.pi * frequencies)

    @property
    def _inertia(self) -> FloatArray:
        """ρ C_M π D²/4, (N_HEIGHTS,) [kg/m]."""
        return self.water_density * self.sea.inertia_coefficient * np.pi * self.diameters**2 / 4

    @property
    def _drag(self) -> FloatArray:
        """½ ρ C_D D, (N_HEIGHTS,) [kg/m²]."""
        return 0.5 * self.water_density * self.sea.drag_coefficient * self.diameters

    def _place(self, height: FloatArray) -> FloatArray:
        """x in [−1, 1] of a height above the mudline."""
        span = self.top - self.mudline
        return 2.0 * np.clip(height, 0.0, span) / span - 1.0

    def _kinematics(self, seed: int) -> Iterator[FloatArray]:
        """η, then u and u' in x at N_HEIGHTS places each, then in y where the sea has any.

        Segments (1 + 2 or 4 N_HEIGHTS, n) [m, m/s, m/s²].
        """
        frequencies = harmonics(self.sea.highest_frequency)
        return iter(
            SegmentedNoise(
                self._colouring(frequencies),
                n_sources=3,
                n_harmonics=len(frequencies),
                sampling_rate=self.sampling_rate,
                start=self.start,
                rng=generator(seed, RandomStream.SEA),
            )
        )

    def _colouring(self, frequencies: FloatArray) -> Callable[[float, ComplexArray], ComplexArray]:
        heights, _ = _column()
        omega = 2 * np.pi * frequencies

        def coloured(time: float, white: ComplexArray) -> ComplexArray:
            state = self.state_at(time)
            factor = _root(directional_covariance(self.sea.spreading, state.direction))
            waves = (factor @ white) * np.sqrt(elevation_spectrum(self.sea, state, frequencies))
            motion = horizontal_motion(frequencies, heights, depth=state.level - self.mudline)
            series = [waves[:1]]
            for along in waves[1:]:
                velocity = motion * along
                series += [velocity, 1j * omega * velocity]
            return np.concatenate(series)

        return coloured

    def _segments(self, seed: int) -> Iterator[FloatArray]:
        time = self.start
        for segment in self._kinematics(seed):
            begin, end = self.state_at(time).level, self.state_at(time + OVERLAP).level
            depth = np.linspace(begin, end, segment.shape[1], endpoint=False) - self.mudline
            yield self._forces(segment[0], segment[1:].reshape(_X_AND_Y, 2, N_HEIGHTS, -1), depth)
            time += OVERLAP

    def _forces(self, surface: FloatArray, motion: FloatArray, depth: FloatArray) -> FloatArray:
        """Generalised forces (n, 2 N_PATTERNS) [N].

        Parameters
        ----------
        surface : ndarray, shape (n,)
            η [m]; depth of the still water, (n,) [m].
        motion : ndarray
            Motion, (x and y, u and u', N_HEIGHTS, n).
        """
        heights, weights = _column()
        column = depth + surface if self.sea.surface == "instantaneous" else depth
        column = np.clip(column, 0.0, self.top - self.mudline)
        place = self._place(np.multiply.outer(heights, column))
        moving = np.flatnonzero([part.any() for part in motion])  # nothing across a long crest
        drag = self._drag[:, None] * np.sqrt(np.sum(motion[moving, 0] ** 2, axis=0))
        forces = np.empty((len(moving), N_HEIGHTS, len(surface)))
        for force, (velocity, acceleration) in zip(forces, motion[moving], strict=True):
            np.multiply(self._inertia[:, None], acceleration, out=force)
            force += drag * velocity
            force *= weights[:, None] * column
        sums = np.zeros((_X_AND_Y, N_PATTERNS, len(surface)))
        sums[moving] = _legendre_sums(place, forces)
        return sums.reshape(-1, len(surface)).T


def wave_load(
    model: StructuralModel,
    sea: Sea,
    state_at: Callable[[float], SeaState],
    *,
    highest_level: float,
    largest_height: float,
    sampling_rate: float,
    start: float = 0.0,
) -> WaveLoad:
    """Return the sea's force on a turbine's monopile.

    Parameters
    ----------
    state_at : Callable[[float], SeaState]
        The sea's state by time [s].
    highest_level : float
        That the still water reaches in the simulation [m].
    largest_height : float
        The largest significant wave height [m].
    sampling_rate : float
        Sampling rate of the series [Hz]; start time of their first step [s].

    Raises
    ------
    LoadError
        For a turbine without water.
    """
    description = model.description
    if description.water is None or not highest_level > description.mudline:
        raise LoadError(f"{description.name} stands in no water; leave [simulation.sea] out")
    top = min(highest_level + CREST * max(largest_height, 1.0), description.tower_top)
    bottom = description.mudline
    x, weights = legendre.leggauss(64)
    elevations = bottom + 0.5 * (top - bottom) * (x + 1)
    norms = (2 * np.arange(N_PATTERNS) + 1) / 2  # of ∫ P_p² dx
    patterns = legendre.legvander(x, N_PATTERNS - 1) * weights[:, None] * norms
    columns = []
    for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        rows = np.array([model.tower_displacement(float(z), axis) for z in elevations])
        columns.append(rows.T @ patterns)
    edges = np.array([tube.top for tube in description.tubes])
    heights, _ = _column()
    still = description.water.level
    tubes = np.searchsorted(edges, bottom + heights * (still - bottom))
    return WaveLoad(
        sea=sea,
        state_at=state_at,
        distribution=np.concatenate(columns, axis=1),
        sampling_rate=sampling_rate,
        start=start,
        mudline=bottom,
        top=top,
        water_density=description.water.density,
        diameters=np.array([description.tubes[i].diameter for i in tubes]),
    )


def _column() -> tuple[FloatArray, FloatArray]:
    """Return places in a water column of height 1 and their weights.

    They are denser towards the surface, where short waves are.
    """
    points, weights = legendre.leggauss(N_HEIGHTS)
    s = 0.5 * (points + 1)
    return 1 - (1 - s) ** 2, (1 - s) * weights


def _root(covariance: FloatArray) -> FloatArray:
    """L with L Lᵀ = C, for a C that may be singular (a long-crested sea has rank 1)."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _legendre_sums(x: FloatArray, forces: FloatArray) -> FloatArray:
    """Σ_j P_p(x_j) F_j for p below N_PATTERNS.

    Parameters
    ----------
    x : ndarray, shape (n_heights, n)
        Forces (n_directions, n_heights, n).

    Returns
    -------
    ndarray, shape (n_directions, N_PATTERNS, n)
    """
    sums = np.empty((len(forces), N_PATTERNS, x.shape[1]))
    before, now = np.ones_like(x), x
    sums[:, 0], sums[:, 1] = forces.sum(axis=1), np.einsum("jt,djt->dt", x, forces)
    for p in range(1, N_PATTERNS - 1):
        before, now = now, ((2 * p + 1) * x * now - p * before) / (p + 1)
        sums[:, p + 1] = np.einsum("jt,djt->dt", now, forces)
    return sums
