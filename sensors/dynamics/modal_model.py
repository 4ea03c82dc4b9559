"""Natural frequencies and mode shapes, as accelerometers read them, for many foundations at once.

The structure separates into groups (see `full_model_modes`). In a basis of a group's
mass-normalised modes at a reference θ the springs' change ΔS is all that changes with θ, and it
acts on the mudline's two coordinates y of each plane:

    K(θ) = Λ + Yᵀ ΔS Y,   Y = mudline rows of the basis

Modes to beyond the highest frequency that is followed, completed by the static and the first
dynamic response to mudline loads (residual attachment vectors), represent every θ of the prior
box; `mudline_condensation` solves what remains.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from math import ceil

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, IndexArray
from sensors.dynamics.full_model_modes import (
    FullModes,
    ReferenceModes,
    decoupled_groups,
    full_modes,
    solved_modes,
    visible_modes,
)
from sensors.dynamics.mudline_condensation import (
    MudlineCondensation,
    SpringEigenproblem,
    spring_modes_solver,
)
from sensors.dynamics.water_level import modes_in_water
from sensors.structure.assembly import assemble
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import positive_definite, spring_matrix
from sensors.structure.sensor_readings import ChannelReadings
from sensors.structure.structural_model import PLANE_COLUMNS, StructuralModel

__all__ = ["FullModes", "ModalModel", "ModalParameters", "followed_by_overlap", "full_modes"]


FOLLOWED_RISE = 0.5  # of the water, in which shapes and order of neighbours change little [m]
_CHUNK = 64  # foundations solved together: what fits in a processor's cache
_BASIS_MARGIN = 1.5  # a basis holds the modes to this multiple of the highest followed one [-]


@dataclass(frozen=True, slots=True, eq=False)
class ModalParameters:
    """Modes of the model for n foundations; NaN where the foundation is not admissible."""

    labels: tuple[str, ...]
    """Labels, (n_modes,)."""

    frequencies: FloatArray
    """f, undamped (n, n_modes) [Hz]."""

    shapes: FloatArray
    """φ as read, (n, n_modes, n_channels), largest component exactly 1 [-]."""

    admissible: NDArray[np.bool_]
    """Admissible, (n,): springs positive definite, structure stable."""

    damping_ratios: FloatArray | None = None
    """ζ, (n, n_modes) [-], where asked for."""


@dataclass(frozen=True, slots=True, eq=False)
class _ReducedGroup:
    """One decoupled group in a small basis, and what is wanted from its modes."""

    solver: MudlineCondensation | SpringEigenproblem
    outputs: IndexArray
    """Outputs, (n_followed,): places of the followed modes among the labels."""

    channels: IndexArray
    """Channels, (n_read,): channels of the layout that see the group."""

    observation: ChannelReadings
    """Observation of these channels, in the solver's coordinates."""

    overlap: FloatArray
    """φ_refᵀ M, (n_followed, n_coordinates)."""

    def modes(self, springs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squares ω² (n, n_followed) and shapes (n, n_followed, n_read) of the followed modes.

        Parameters
        ----------
        springs : ndarray, shape (n, 2, 2)
            S.
        """
        found = self.solver.modes(springs)
        places = followed_by_overlap((found.coordinates @ self.overlap.T).swapaxes(1, 2) ** 2)
        squares = np.take_along_axis(found.squares, places, axis=1)
        coordinates = np.take_along_axis(found.coordinates, places[:, :, None], axis=1)
        return squares, self.observation.shapes(coordinates, squares)


def followed_by_overlap(overlap: FloatArray) -> IndexArray:
    """Return which mode continues each reference mode.

    Parameters
    ----------
    overlap : ndarray, shape (n, n_reference, n_modes)
        Squared mass-weighted products (φ_refᵀ M φ)² in [0, 1].

    Returns
    -------
    ndarray, shape (n, n_reference)
        No mode twice, the sum of the overlaps as large as can be.

    Notes
    -----
    Where every reference mode has a best successor of its own, that is the optimum; an assignment
    is solved only for the others.
    """
    best = np.argmax(overlap, axis=2)
    ordered = np.sort(best, axis=1)
    for row in np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1)):
        best[row] = linear_sum_assignment(overlap[row], maximize=True)[1]
    return best


def _reduced_group(
    model: StructuralModel,
    basis: FloatArray,
    observation: ChannelReadings,
    reference: ReferenceModes,
) -> _ReducedGroup | None:
    """The group's reduced model, at the θ of the reference; None where it has no mode to follow."""
    mass, stiffness = basis.T @ model.mass @ basis, basis.T @ model.stiffness @ basis
    flexibilities, vectors = eigh(mass, stiffness)  # for 1/ω², as of the full model
    squares, vectors = 1 / flexibilities[::-1], (vectors / np.sqrt(flexibilities))[:, ::-1]
    overlap = np.abs(reference.vectors.T @ model.mass @ basis @ vectors)
    outputs = np.flatnonzero(overlap.max(axis=1) > 0.5)  # 1, or 0 for modes of other groups
    if not len(outputs):
        return None
    highest = int(overlap[outputs].argmax(axis=1).max())
    kept = squares <= _BASIS_MARGIN**2 * squares[highest]
    loads = basis[model.spring_dofs.ravel()]  # (4, n_group)
    residual = _residual_vectors(vectors[:, ~kept], squares[~kept], loads)
    complete = basis @ np.concatenate([vectors[:, kept], residual], axis=1)
    complete, reduced = _diagonalised(model, complete)
    springs = spring_matrix(model.theta, model.description.foundation.sign)
    mudline = complete[model.spring_dofs]
    solver = spring_modes_solver(reduced, mudline, springs, n_modes=highest + 1)
    complete = complete @ solver.basis
    channels = np.flatnonzero(np.abs(observation.displacement @ complete).max(axis=1) > 0)
    return _ReducedGroup(
        solver=solver,
        outputs=outputs,
        channels=channels,
        observation=observation.in_basis(complete).of_channels(channels),
        overlap=reference.vectors[:, outputs].T @ model.mass @ complete,
    )


def _diagonalised(model: StructuralModel, basis: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same span by mass-normalised vectors that diagonalise the stiffness, and their ω²."""
    squares, rotation = eigh(basis.T @ model.stiffness @ basis, basis.T @ model.mass @ basis)
    return basis @ rotation, squares


def _residual_vectors(vectors: FloatArray, squares: FloatArray, loads: FloatArray) -> FloatArray:
    """Return what the left-out modes contribute to the response to mudline loads, two orders in ω².

    Parameters
    ----------
    vectors, squares : ndarray
        The left-out modes, mass-normalised.
    loads : ndarray, shape (n_loads, n_group)

    Notes
    -----
        (K − ω² M)⁻¹ b over the left-out modes ≈ Σ φ φᵀ b / ω_j² + ω² Σ φ φᵀ b / ω_j⁴ + …
    """
    acting = loads[np.abs(loads).max(axis=1) > 0]
    participation = (acting @ vectors).T  # (n_left_out, n_acting)
    if not participation.size:
        return vectors[:, :0]
    orders = [participation / squares[:, None] ** order for order in (1, 2)]
    coordinates = np.concatenate(orders, axis=1)
    coordinates /= np.linalg.norm(coordinates, axis=0)
    independent, strength, _ = np.linalg.svd(coordinates, full_matrices=False)
    return vectors @ independent[:, strength > 1e-8 * strength[0]]


class ModalModel:
    """Modes that the sensors can see, for many foundation stiffnesses at once.

    nominal              θ = (k11, k22, k12) of the description, (3,) [N/m, N·m/rad, N/rad]
    labels               (n_modes,): the description's reference modes under their own names, then
                         the other visible ones up to highest_frequency, numbered on by frequency
    directions           (n_modes,) "FA" or "SS": the plane in which the tower moves most
    blade_energy_share   (n_modes,) share of the blades in the kinetic energy at the reference [-]

    A mode keeps its label by its mass-weighted overlap with the mode of that label at the
    reference θ, which is the nominal one until `following` moves it.
    """

    def __init__(
        self,
        description: TurbineDescription,
        layout: SensorLayout,
        *,
        highest_frequency: float = 12.5,
    ) -> None:
        """Build the model; the modes of the description are labelled as its sensors see them.

        Parameters
        ----------
        description : TurbineDescription
            The structure with its own foundation.
        layout : SensorLayout
            Where the sensors are.
        highest_frequency : float, optional
            Of the modes that are labelled [Hz].

        Raises
        ------
        TurbineError
            If the description's own foundation does not hold the structure, or a sensor is not
            on the tower.
        """
        self.description = description
        self.layout = layout
        self.highest_frequency = highest_frequency
        self.nominal = description.nominal
        model = assemble(description)
        reference = visible_modes(model, layout, highest_frequency=highest_frequency)
        self._observation = ChannelReadings.of(model, layout)
        self._gravity = mudline_gravity_stiffness(model)
        self._follow(reference, model)

    def _follow(self, reference: ReferenceModes, model: StructuralModel) -> None:
        """Label the modes as a reference does; the model stands on its springs."""
        self.labels = reference.labels
        self.directions = reference.directions
        self.blade_energy_share = reference.blade_energy_share
        self._reference = reference
        self._model = model
        groups = (
            _reduced_group(model, basis, self._observation, reference)
            for basis in decoupled_groups(model)
        )
        self._groups = tuple(group for group in groups if group is not None)

    def _followed(self, reference: ReferenceModes, model: StructuralModel) -> "ModalModel":
        """The same structure and sensors with other reference modes; nothing is assembled again."""
        other = copy(self)
        other._follow(reference, model)
        return other

    @property
    def theta_reference(self) -> FloatArray:
        """θ at which the labels are defined, (3,) [N/m, N·m/rad, N/rad]."""
        return self._reference.theta

    @property
    def water_level(self) -> float:
        """Of the description, above mean [m]; 0 on land."""
        return 0.0 if self.description.water is None else self.description.water.level

    def admissible(self, theta: ArrayLike) -> NDArray[np.bool_]:
        """Return whether springs are positive definite and hold the structure against gravity.

        Parameters
        ----------
        theta : ArrayLike, shape (n, 3)
            θ [N/m, N·m/rad, N/rad].

        Returns
        -------
        ndarray, shape (n,)
        """
        theta = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        held = positive_definite(theta)
        total = np.tile(self._gravity, (int(held.sum()), 1, 1))
        springs = spring_matrix(theta[held], self.description.foundation.sign)
        for plane in PLANE_COLUMNS.values():
            total[:, plane, plane] += springs
        held[held] = np.linalg.eigvalsh(total)[:, 0] > 0
        return held

    def modal(self, theta: ArrayLike, *, damping: ArrayLike | None = None) -> ModalParameters:
        """Return the labelled modes for many foundations.

        Parameters
        ----------
        theta : ArrayLike, shape (n, 3) or (3,)
            θ = (k11, k22, k12) [N/m, N·m/rad, N/rad].
        damping : ArrayLike, optional, shape (n_modes,)
            ζ to attach, one or [-].

        Notes
        -----
        Rows that are not admissible hold NaN.
        """
        theta = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        n, n_modes, n_channels = len(theta), len(self.labels), len(self.layout.channels)
        admissible = self.admissible(theta)
        sign = self.description.foundation.sign
        springs = spring_matrix(theta[admissible], sign)
        squares = np.empty((len(springs), n_modes))
        shapes = np.zeros((len(springs), n_modes, n_channels))
        for start in range(0, len(springs), _CHUNK):
            rows = slice(start, start + _CHUNK)
            for group in self._groups:
                found, readings = group.modes(springs[rows])
                squares[rows, group.outputs] = found
                shapes[rows, group.outputs[:, None], group.channels] = readings
        parameters = ModalParameters(
            labels=self.labels,
            frequencies=np.full((n, n_modes), np.nan),
            shapes=np.full((n, n_modes, n_channels), np.nan),
            admissible=admissible,
            damping_ratios=None if damping is None else np.full((n, n_modes), damping),
        )
        parameters.frequencies[admissible] = np.sqrt(squares) / (2 * np.pi)
        parameters.shapes[admissible] = shapes
        return parameters

    def in_water(self, rises: Sequence[float]) -> ModalParameters:
        """Return the modes at the reference θ with the water risen above the description's level.

        Row by row [m]; on land the modes stay. See `water_level`.
        """
        still = self.modal(self.theta_reference)
        rows = [
            modes_in_water(
                self._model, self._observation, self._reference, still.frequencies[0], rise
            )
            for rise in rises
        ]
        return ModalParameters(
            labels=self.labels,
            frequencies=np.array([frequencies for frequencies, _ in rows]),
            shapes=np.array([shapes for _, shapes in rows]),
            admissible=np.full(len(rows), bool(still.admissible[0])),
        )

    def following(self, theta_reference: ArrayLike) -> "ModalModel":
        """Return the same modes, followed by overlap from another θ, (3,), than the present one.

        Raises
        ------
        TurbineError
            If that θ is not admissible.
        """
        return self._continued(self._model.on_springs(theta_reference))

    def with_water_risen(self, rise: float) -> "ModalModel":
        """Return the same modes and sensors with the water above the description's level.

        Parameters
        ----------
        rise : float
            Of the water [m]; on land nothing changes.

        Returns
        -------
        ModalModel
            Of the description with that level, modes followed by overlap in steps of FOLLOWED_RISE.
        """
        water, model = self.description.water, self
        if water is None:
            return self
        for level in water.level + np.linspace(0, rise, ceil(abs(rise) / FOLLOWED_RISE) + 1)[1:]:
            description = self.description.with_water_level(float(level))
            there = assemble(description).on_springs(self.theta_reference)
            model = model._continued(there)
            model.description = description
        return model

    def _continued(self, model: StructuralModel) -> "ModalModel":
        """The modes that continue these, by overlap, in the same structure a little changed."""
        modes = solved_modes(
            model,
            self._observation,
            highest_frequency=_BASIS_MARGIN * self.highest_frequency,
        )
        overlap = (self._reference.vectors.T @ model.mass @ modes.vectors) ** 2
        successors = followed_by_overlap(overlap[None])[0]
        reference = ReferenceModes(
            theta=model.theta,
            labels=self.labels,
            directions=self.directions,
            blade_energy_share=modes.blade_energy_share[successors],
            vectors=modes.vectors[:, successors],
        )
        return self._followed(reference, model)

    def subset(self, labels: Sequence[str]) -> "ModalModel":
        """Return a cheaper model with some of the modes only, in the given order.

        KeyError for a label that there is not.
        """
        for label in labels:
            if label not in self.labels:
                raise KeyError(f"no mode {label!r}; there are {', '.join(self.labels)}")
        indices = [self.labels.index(label) for label in labels]
        return self._followed(self._reference.take(indices), self._model)


def mudline_gravity_stiffness(model: StructuralModel) -> FloatArray:
    """Static stiffness of everything above the springs, seen from the mudline.

    Returns
    -------
    ndarray, shape (4, 4)
        On (u_x, ψ_x, u_y, ψ_y) [N/m, N, N·m/rad].

    Notes
    -----
    Without gravity it is zero (the structure would just move along); with it, the weight tips. The
    whole stands where this plus the springs is positive definite.
    """
    mudline = model.spring_dofs.ravel()
    above = np.setdiff1d(np.arange(model.n_dofs), mudline)
    free = model.free_stiffness
    coupling = free[np.ix_(above, mudline)]
    inner = np.linalg.solve(free[np.ix_(above, above)], coupling)
    return free[np.ix_(mudline, mudline)] - coupling.T @ inner
