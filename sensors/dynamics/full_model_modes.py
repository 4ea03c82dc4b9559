"""Modes of the whole model, one foundation at a time: what the fast ones are held against.

Written in multi-blade coordinates (sums and differences over the rotor) the parked rotor separates
into groups of degrees of freedom that never exchange energy; for the IEA 15 MW these are fore-aft
and side-side. The groups are found from the matrices, not assumed, so that any pitch or azimuth is
solved, only more slowly where nothing separates. `visible_modes` are those that the sensors can
see, with the names that they have.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.structure.assembly import assemble
from sensors.structure.description import Direction, ReferenceMode, TurbineDescription
from sensors.structure.foundation import TurbineError
from sensors.structure.sensor_readings import ChannelReadings
from sensors.structure.structural_model import PLANE_COLUMNS, StructuralModel

VISIBLE_SHARE = 0.01  # of the largest sensor motion of any mode, all at unit modal mass [-]
_COUPLED = 1e-11  # relative size of a matrix entry below which two coordinates do not couple [-]
REFERENCE_WINDOW = 0.05  # a published mode is looked for within this relative distance [-]


@dataclass(frozen=True, slots=True, eq=False)
class FullModes:
    """Modes of the whole model for one foundation, mass-normalised, lowest first."""

    frequencies: FloatArray
    """Frequencies, (n_modes,) [Hz]."""

    vectors: FloatArray
    """Vectors, (n_dofs, n_modes), vectorsᵀ M vectors = 1."""

    shapes: FloatArray
    """Shapes as read by the layout's channels, (n_modes, n_channels), largest 1 [-]."""

    directions: tuple[Direction, ...]
    """Plane in which the tower moves most."""

    blade_energy_share: FloatArray
    """Blade energy share of the kinetic energy, (n_modes,) [-]."""

    sensor_motion: FloatArray
    """Largest displacement at a sensor at unit modal mass [1/√kg]."""


def full_modes(
    description: TurbineDescription,
    layout: SensorLayout,
    theta: ArrayLike | None = None,
    *,
    highest_frequency: float = 12.5,
    tube_refinement: int = 1,
) -> FullModes:
    """Return every mode of the whole model up to a frequency, for one foundation.

    Parameters
    ----------
    theta : ArrayLike, optional, shape (3,)
        θ [N/m, N·m/rad, N/rad]; None: the description's.
    highest_frequency : float, optional
        Highest frequency [Hz].

    Raises
    ------
    TurbineError
        If the springs are not positive definite or the structure would fall.
    """
    model = assemble(description, stiffness=theta, tube_refinement=tube_refinement)
    observation = ChannelReadings.of(model, layout)
    return solved_modes(model, observation, highest_frequency=highest_frequency)


def solved_modes(
    model: StructuralModel, observation: ChannelReadings, *, highest_frequency: float
) -> FullModes:
    """`full_modes` of a structure that is already assembled."""
    parts = [_modes_of_group(model, basis, highest_frequency) for basis in decoupled_groups(model)]
    squares = np.concatenate([squares for squares, _ in parts])
    vectors = np.concatenate([vectors for _, vectors in parts], axis=1)
    order = np.argsort(squares)
    squares, vectors = squares[order], vectors[:, order]
    return FullModes(
        frequencies=np.sqrt(squares) / (2 * np.pi),
        vectors=vectors,
        shapes=observation.shapes(vectors.T, squares),
        directions=_directions(model, vectors),
        blade_energy_share=np.einsum("im,ij,jm->m", vectors, model.blade_mass, vectors),
        sensor_motion=np.abs(observation.displacement @ vectors).max(axis=0),
    )


def _modes_of_group(
    model: StructuralModel, basis: FloatArray, highest_frequency: float
) -> tuple[FloatArray, FloatArray]:
    """ω² [rad²/s²] and mass-normalised vectors of one decoupled group, up to a frequency [Hz].

    Solved for 1/ω²: the lowest modes then keep their digits beside axial ones 10⁵ times as high.
    """
    lowest_flexibility = (2 * np.pi * highest_frequency) ** -2
    try:
        flexibilities, vectors = eigh(
            basis.T @ model.mass @ basis,
            basis.T @ model.stiffness @ basis,
            subset_by_value=(lowest_flexibility, np.inf),
        )
    except LinAlgError:  # the stiffness is not positive definite
        k11, k22, k12 = model.theta
        raise TurbineError(
            f"{model.description.name} falls over on k11 = {k11:g} N/m, k22 = {k22:g} N·m/rad, "
            f"k12 = {k12:g} N/rad: the springs do not hold it against gravity"
        ) from None
    squares = 1 / flexibilities[::-1]
    return squares, basis @ vectors[:, ::-1] * np.sqrt(squares)


def decoupled_groups(model: StructuralModel) -> tuple[FloatArray, ...]:
    """Orthonormal bases, (n_dofs, n_group) each, of coordinates that never exchange energy."""
    rotor = multi_blade_coordinates(model)
    coupled = np.zeros((model.n_dofs, model.n_dofs), dtype=bool)
    for matrix in (model.mass, model.stiffness):
        rotated = rotor.T @ matrix @ rotor
        scale = np.sqrt(np.abs(np.diag(rotated)))
        coupled |= np.abs(rotated) > _COUPLED * np.outer(scale, scale)
    count, group = connected_components(csr_array(coupled), directed=False)
    return tuple(rotor[:, group == number] for number in range(count))


def multi_blade_coordinates(model: StructuralModel) -> FloatArray:
    """Orthogonal transformation of the blades' coordinates to rotor harmonics, (n_dofs, n_dofs).

    For each coordinate that all blades have: the mean, then cos(k α_b) and sin(k α_b) over the
    azimuths α_b, k = 1, 2, …, and for an even number the alternating sum, all of length 1.
    Source: Coleman and Feingold, NACA report 1351 (1958).
    """
    blades = model.description.blades
    transformation = np.eye(model.n_dofs)
    if blades is None:
        return transformation
    number = blades.number
    azimuths = np.radians(blades.azimuth) + 2 * np.pi * np.arange(number) / number
    harmonics: list[FloatArray] = [np.ones(number)]
    for k in range(1, (number - 1) // 2 + 1):
        harmonics += [np.cos(k * azimuths), np.sin(k * azimuths)]
    if number % 2 == 0:
        harmonics.append(np.where(np.arange(number) % 2 == 0, 1.0, -1.0))
    unit = np.array([row / np.linalg.norm(row) for row in harmonics])  # (harmonic, blade)
    for same in model.blade_coordinates.T:  # one coordinate, all blades
        transformation[np.ix_(same, same)] = unit.T
    return transformation


def _directions(model: StructuralModel, vectors: FloatArray) -> tuple[Direction, ...]:
    """The plane in which the tower's nodes move most, for each mode."""
    motion: dict[Direction, FloatArray] = {
        plane: (vectors[model.tower_dofs[:, columns.start]] ** 2).sum(axis=0)
        for plane, columns in PLANE_COLUMNS.items()
    }
    return tuple(
        "FA" if fa >= ss else "SS" for fa, ss in zip(motion["FA"], motion["SS"], strict=True)
    )


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceModes:
    """The labelled modes at one θ that a ModalModel follows to other foundations."""

    theta: FloatArray
    """Theta, (3,) [N/m, N·m/rad, N/rad]."""

    labels: tuple[str, ...]
    directions: tuple[Direction, ...]
    blade_energy_share: FloatArray
    """Blade energy share, (n_modes,) [-]."""

    vectors: FloatArray
    """Mass-normalised modes, (n_dofs, n_modes)."""

    def take(self, indices: Sequence[int]) -> "ReferenceModes":
        """Some of the modes, in the given order."""
        return ReferenceModes(
            theta=self.theta,
            labels=tuple(self.labels[i] for i in indices),
            directions=tuple(self.directions[i] for i in indices),
            blade_energy_share=self.blade_energy_share[list(indices)],
            vectors=self.vectors[:, list(indices)],
        )


def visible_modes(
    model: StructuralModel, layout: SensorLayout, *, highest_frequency: float
) -> ReferenceModes:
    """Return the modes that the sensors can see, labelled.

    Parameters
    ----------
    model : StructuralModel
        Of the turbine whose description names reference modes.
    layout : SensorLayout
        Where the sensors are.
    highest_frequency : float
        Of a visible mode [Hz].

    Notes
    -----
    Visible is a mode up to the highest frequency whose largest displacement at a sensor, at
    unit modal mass, reaches VISIBLE_SHARE of the largest of all modes. First the description's
    reference modes under their own names, then the others, numbered on by frequency.
    """
    observation = ChannelReadings.of(model, layout)
    modes = solved_modes(model, observation, highest_frequency=highest_frequency)
    largest = modes.sensor_motion.max(initial=0.0)
    visible = np.flatnonzero(modes.sensor_motion >= VISIBLE_SHARE * largest).tolist()
    published = _published_modes(model.description.reference_modes, modes)
    listed = {name: mode for name, mode in published.items() if mode in visible}
    others = [mode for mode in visible if mode not in listed.values()]
    labels = [*listed, *_further_labels(set(published), len(others))]
    indices = [*listed.values(), *others]
    return ReferenceModes(
        theta=model.theta,
        labels=tuple(labels),
        directions=tuple(modes.directions[i] for i in indices),
        blade_energy_share=modes.blade_energy_share[indices],
        vectors=modes.vectors[:, indices],
    )


def _published_modes(listed: Iterable[ReferenceMode], modes: FullModes) -> dict[str, int]:
    """Name → index of the mode that a publication lists.

    It moves in the listed direction, lies near the listed frequency, and of those that do, the
    tower takes the largest part in it. (By frequency alone, blade modes with hardly any tower in
    them would be taken for modes 8 and 10 of the IEA 15 MW.)
    """
    found: dict[str, int] = {}
    for mode in listed:
        candidates = _near(mode, modes, taken=found.values())
        found[mode.name] = min(candidates, key=lambda i: modes.blade_energy_share[i])
    return found


def _near(mode: ReferenceMode, modes: FullModes, *, taken: Iterable[int]) -> list[int]:
    """Modes of the right direction within REFERENCE_WINDOW, doubled until there is one."""
    possible = [
        i
        for i, direction in enumerate(modes.directions)
        if direction == mode.direction and i not in taken
    ]
    if not possible:
        raise TurbineError(
            f"reference mode {mode.name!r} ({mode.direction}, {mode.frequency:g} Hz): the model "
            f"has no further {mode.direction} mode below the highest frequency asked; leave "
            "reference_modes out where no publication lists them"
        )
    distance = {i: abs(modes.frequencies[i] / mode.frequency - 1) for i in possible}
    window = REFERENCE_WINDOW
    while min(distance.values()) > window:
        window *= 2
    return [i for i in possible if distance[i] <= window]


def _further_labels(used: set[str], count: int) -> list[str]:
    """Return numbers that continue the listed names: '12', '13', …."""
    numbers = (str(number) for number in range(len(used) + 1, len(used) + count + 2 + len(used)))
    return [number for number in numbers if number not in used][:count]
