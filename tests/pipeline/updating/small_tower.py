"""A tower small enough to be evaluated in microseconds, with all that makes the real one hard:
coupled springs at the mudline, two nearly equal directions, closely spaced modes.

Five Euler-Bernoulli elements on the springs, a mass at the top whose rotary inertia differs
fore-aft and side-side. No gravity, no blades.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import complex_normalised, renormalised_factor
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.arrays import FloatArray

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])  # k11 [N/m], k22 [N·m/rad], k12 [N/rad]
LENGTH, ELEMENTS = 130.0, 5  # [m]
BENDING_STIFFNESS = 210e9 * np.pi / 8 * 8.0**3 * 0.055  # [N·m²], thin tube of 8 m and 55 mm
LINE_MASS = 7850 * np.pi * 8.0 * 0.055  # [kg/m]
TOP_MASS = 6.0e5  # [kg]
TOP_INERTIA = {"FA": 2.0e8, "SS": 1.0e8}  # rotary [kg·m²]
NODES = np.linspace(0.0, LENGTH, ELEMENTS + 1)

LAYOUT = biaxial_layout("small", turbine="small", unit="tower", elevations=NODES[1:].tolist()[1:])


@dataclass(frozen=True)
class SmallModes:
    frequencies: FloatArray
    shapes: FloatArray
    admissible: NDArray[np.bool_]


@dataclass(frozen=True)
class SmallTower:
    """A ForwardModel. Modes of one direction never cross, so following them is sorting them."""

    layout: SensorLayout = LAYOUT
    n_modes: int = 6  # a direction
    chosen: tuple[int, ...] = ()  # of all 2 n_modes; () for all
    stiffening: float = 1.0  # of the tube, to make a structure that the updater gets wrong
    heavier: float = 1.0  # mass and inertia at the top, likewise
    water_level: float = 0.0  # on land

    @property
    def nominal(self) -> FloatArray:
        return NOMINAL

    @property
    def labels(self) -> tuple[str, ...]:
        order = np.argsort(self._all(NOMINAL[None])[0][0])
        names = np.empty(2 * self.n_modes, dtype=object)
        names[order] = [str(number + 1) for number in range(2 * self.n_modes)]
        return tuple(names[list(self.chosen)]) if self.chosen else tuple(names)

    def subset(self, labels: Sequence[str]) -> "SmallTower":
        return replace(self, chosen=tuple(self.labels.index(label) for label in labels))

    def following(self, theta_reference: FloatArray) -> "SmallTower":
        return self

    def responses(self, name: str) -> tuple[FloatArray, FloatArray]:
        field = {"steel_modulus": "stiffening", "rna_mass": "heavier"}[name]
        step = 1e-3
        more, less = (
            replace(self, **{field: getattr(self, field) + sign * step}).modal(NOMINAL[None])
            for sign in (1, -1)
        )
        largest = np.argmax(np.abs(more.shapes[0]), axis=1)[:, None]
        unit = [m.shapes[0] / np.take_along_axis(m.shapes[0], largest, 1) for m in (more, less)]
        logs = np.log(more.frequencies[0] / less.frequencies[0])
        return logs / (2 * step), (unit[0] - unit[1]) / (2 * step)

    def scoured(self, theta: FloatArray, depths: FloatArray) -> FloatArray:
        return theta * np.exp(-np.outer(depths, [0.12, 0.02, 0.06]))  # as the real pile, roughly

    def with_water_risen(self, rise: float) -> "SmallTower":
        return self  # on land

    def in_water(self, rises: Sequence[float]) -> SmallModes:
        return self.modal(np.tile(NOMINAL, (len(rises), 1)))  # on land

    def modal(self, theta: FloatArray) -> SmallModes:
        admissible = theta[:, 0] * theta[:, 1] > theta[:, 2] ** 2
        frequencies, shapes = self._all(np.where(admissible[:, None], theta, NOMINAL))
        frequencies[~admissible], shapes[~admissible] = np.nan, np.nan
        if self.chosen:
            index = list(self.chosen)
            frequencies, shapes = frequencies[:, index], shapes[:, index]
        return SmallModes(frequencies, shapes, admissible)

    def _all(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        both = [self._direction(theta, direction) for direction in ("FA", "SS")]
        return (
            np.concatenate([frequencies for frequencies, _ in both], axis=1),
            np.concatenate([shapes for _, shapes in both], axis=1),
        )

    def _direction(self, theta: FloatArray, direction: str) -> tuple[FloatArray, FloatArray]:
        stiffness, inverse = _tower_matrices(self.stiffening, self.heavier, direction)
        whole = np.repeat(stiffness[None], len(theta), axis=0)
        whole[:, 0, 0] += theta[:, 0]
        whole[:, 1, 1] += theta[:, 1]
        whole[:, 0, 1] += theta[:, 2]
        whole[:, 1, 0] += theta[:, 2]
        values, vectors = np.linalg.eigh(inverse @ whole @ inverse.T)
        modes = inverse.T @ vectors
        frequencies = np.sqrt(values[:, : self.n_modes]) / (2 * np.pi)
        nodes = np.searchsorted(NODES, self.layout.elevations - 1e-6)
        along = self.layout.directions[:, 0 if direction == "FA" else 1]
        shapes = np.swapaxes(modes[:, 2 * nodes, : self.n_modes], 1, 2) * along
        return frequencies, shapes


@functools.cache
def _tower_matrices(
    stiffening: float, heavier: float, direction: str
) -> tuple[FloatArray, FloatArray]:
    """Stiffness without the springs, and the inverse of the mass's Cholesky factor."""
    stiffness, mass = tube_matrices(stiffening)
    mass[-2, -2] += heavier * TOP_MASS
    mass[-1, -1] += heavier * TOP_INERTIA[direction]
    return stiffness, np.linalg.inv(np.linalg.cholesky(mass))


def tube_matrices(stiffening: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Stiffness and consistent mass of the tube alone; dofs v, ψ at each node from the mudline."""
    length = LENGTH / ELEMENTS
    bending = BENDING_STIFFNESS * stiffening / length**3
    k = bending * np.array(
        [
            [12, 6 * length, -12, 6 * length],
            [6 * length, 4 * length**2, -6 * length, 2 * length**2],
            [-12, -6 * length, 12, -6 * length],
            [6 * length, 2 * length**2, -6 * length, 4 * length**2],
        ]
    )
    m = (LINE_MASS * length / 420) * np.array(
        [
            [156, 22 * length, 54, -13 * length],
            [22 * length, 4 * length**2, 13 * length, -3 * length**2],
            [54, 13 * length, 156, -22 * length],
            [-13 * length, -3 * length**2, -22 * length, 4 * length**2],
        ]
    )
    n_dofs = 2 * (ELEMENTS + 1)
    stiffness, mass = np.zeros((n_dofs, n_dofs)), np.zeros((n_dofs, n_dofs))
    for element in range(ELEMENTS):
        dofs = slice(2 * element, 2 * element + 4)
        stiffness[dofs, dofs] += k
        mass[dofs, dofs] += m
    return stiffness, mass


def drawn_estimate(
    ratios: FloatArray,
    generator: np.random.Generator,
    *,
    window: int = 0,
    tower: SmallTower | None = None,
    labels: Sequence[str] | None = None,
    frequency_std: float = 0.001,
    shape_std: float = 0.01,
    weight: float = 1.0,
    bias: FloatArray | None = None,
) -> ModalEstimate:
    """Modal estimates scattered about the tower's modes with covariances that say so.

    frequency_std   relative [-];  shape_std   of components other than the unit one [-]
    bias            (n_modes,) relative error of every frequency, the same in all windows
    """
    tower = tower or SmallTower()
    tower = tower.subset(labels) if labels is not None else tower
    modes = tower.modal((ratios * NOMINAL)[None])
    frequencies = modes.frequencies[0] * (1 + (0.0 if bias is None else bias))
    found = tuple(
        drawn_mode(frequency, shape, generator, frequency_std, shape_std)
        for frequency, shape in zip(frequencies, modes.shapes[0], strict=True)
    )
    start = window * 600_000_000_000
    return ModalEstimate(
        turbine="small",
        window=window,
        start_ns=start,
        end_ns=start + 600_000_000_000,
        layout_id=tower.layout.layout_id,
        channels=tower.layout.channel_names,
        modes=tuple(sorted(found, key=lambda mode: mode.frequency)),
        weight=weight,
    )


def drawn_mode(
    frequency: float,
    shape: FloatArray,
    generator: np.random.Generator,
    frequency_std: float,
    shape_std: float,
    name: str = "",
) -> Mode:
    """One mode with independent errors of known size, normalised to its largest component."""
    shape = complex_normalised(shape)
    unit = int(np.argmax(np.abs(shape)))
    deviations = np.concatenate([[frequency * frequency_std, 1e-3], np.full(len(shape), shape_std)])
    deviations[2 + unit] = 0.0
    errors = deviations * generator.standard_normal(len(deviations))
    noisy = shape + errors[2:]
    largest = int(np.argmax(np.abs(noisy)))
    factor = np.diag(deviations)
    factor[2:] = renormalised_factor(noisy, factor[2:], largest)
    return Mode(
        name=name,
        frequency=frequency + errors[0],
        frequency_std=float(deviations[0]),
        damping_ratio=0.01,
        damping_ratio_std=1e-3,
        shape=noisy / noisy[largest],
        covariance_factor=factor,
        n_block_columns=0,
    )


@dataclass(frozen=True)
class LinearTower:
    """Frequencies and shapes that are linear in the ratios: a forward model of no cost."""

    layout: SensorLayout = LAYOUT
    n_modes: int = 6
    chosen: tuple[int, ...] = ()
    water_level: float = 0.0  # [m]
    water: tuple[float, float] = (0.0, 0.0)  # slope and curvature of every ln f [1/m, 1/m²]
    risen: float = 0.0  # water above the description's [m]

    @property
    def nominal(self) -> FloatArray:
        return NOMINAL

    @property
    def labels(self) -> tuple[str, ...]:
        names = tuple(str(number + 1) for number in range(self.n_modes))
        return tuple(names[index] for index in self.chosen) if self.chosen else names

    def subset(self, labels: Sequence[str]) -> "LinearTower":
        return replace(self, chosen=tuple(self.labels.index(label) for label in labels))

    def following(self, theta_reference: FloatArray) -> "LinearTower":
        return self

    def with_water_risen(self, rise: float) -> "LinearTower":
        return replace(self, water_level=self.water_level + rise, risen=self.risen + rise)

    def in_water(self, rises: Sequence[float]) -> SmallModes:
        dry = replace(self, risen=0.0).modal(np.tile(NOMINAL, (len(rises), 1)))
        levels = self.risen + np.array(rises)[:, None]
        return replace(dry, frequencies=dry.frequencies * self._in_level(levels))

    def _in_level(self, levels: FloatArray) -> FloatArray:
        slope, curvature = self.water
        return np.exp(slope * levels + curvature * levels**2)

    def modal(self, theta: FloatArray) -> SmallModes:
        change = theta / NOMINAL - 1
        sensitivity, shapes, turning = linear_structure(self.n_modes, len(self.layout.channels))
        frequencies = 1.7 ** np.arange(1, self.n_modes + 1) * (1 + change @ sensitivity)
        frequencies *= self._in_level(np.array(self.risen))
        moved = shapes + np.tensordot(change, turning, axes=1)
        index = list(self.chosen or range(self.n_modes))
        return SmallModes(frequencies[:, index], moved[:, index], np.ones(len(theta), dtype=bool))


@functools.cache
def linear_structure(n_modes: int, n_channels: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sensitivities of ln f (3, n_modes), shapes at nominal, and their change a unit ratio."""
    fixed = np.random.default_rng(20261121)  # the structure, the same in every test
    return (
        0.05 + 0.2 * fixed.random((3, n_modes)),
        fixed.uniform(-1, 1, (n_modes, n_channels)),
        0.05 * fixed.uniform(-1, 1, (3, n_modes, n_channels)),
    )
