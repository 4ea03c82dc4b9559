"""Natural frequencies and mode shapes, as accelerometers read them, for many foundations at once.

`full_modes` solves the whole model for one θ; `ModalModel` solves a reduced one for many.

**Decoupling.** Written in multi-blade coordinates (sums and differences over the rotor) the parked
rotor separates into groups of degrees of freedom that never exchange energy; for the IEA 15 MW
these are fore-aft and side-side. The groups are found from the matrices, not assumed, so that any
pitch or azimuth is solved, only more slowly where nothing separates.

**Reduction.** In a basis of mass-normalised modes at a reference θ the springs' change ΔS is all
that changes, and it acts on two mudline coordinates y of each plane:

    K(θ) = Λ + Yᵀ ΔS Y,   Y = mudline rows of the basis

Modes to beyond the highest frequency asked, completed by the static and the first dynamic
response to mudline loads (residual attachment vectors), represent every θ of the prior box.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import eigh
from scipy.optimize import linear_sum_assignment
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from sensors.layout import SensorLayout
from sensors.turbine.assembly import PLANE, StructuralModel, assemble
from sensors.turbine.description import Direction, ReferenceMode, TurbineDescription
from sensors.turbine.foundation import TurbineError, positive_definite, spring_matrix

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

VISIBLE_SHARE = 0.01  # of the largest sensor motion of any mode, all at unit modal mass [-]
REFERENCE_WINDOW = 0.05  # a published mode is looked for within this relative distance [-]
_COUPLED = 1e-11  # relative size of a matrix entry below which two coordinates do not couple [-]
_BASIS_MARGIN = 1.5  # the basis holds the modes to this multiple of the highest frequency [-]


@dataclass(frozen=True, slots=True, eq=False)
class ModalParameters:
    """Modes of the model for n foundations; NaN where the foundation is not admissible."""

    labels: tuple[str, ...]  # (n_modes,)
    frequencies: FloatArray  # f, undamped (n, n_modes) [Hz]
    shapes: FloatArray  # φ as read, (n, n_modes, n_channels), largest component exactly 1 [-]
    admissible: NDArray[np.bool_]  # (n,): springs positive definite, structure stable
    damping_ratios: FloatArray | None = None  # ζ, (n, n_modes) [-], where asked for


@dataclass(frozen=True, slots=True, eq=False)
class FullModes:
    """Modes of the whole model for one foundation, mass-normalised, lowest first."""

    frequencies: FloatArray  # (n_modes,) [Hz]
    vectors: FloatArray  # (n_dofs, n_modes), vectorsᵀ M vectors = 1
    shapes: FloatArray  # as read by the layout's channels, (n_modes, n_channels), largest 1 [-]
    directions: tuple[Direction, ...]  # plane in which the tower moves most
    blade_energy_share: FloatArray  # of the kinetic energy, (n_modes,) [-]
    sensor_motion: FloatArray  # largest displacement at a sensor at unit modal mass [1/√kg]


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the channels of a layout read from the model's coordinates.

    An axis reads u'' − g ψ. In a mode of circular frequency ω that is −ω² (φ + g ψ / ω²), times
    the gain H(f) of the channel's coupling.
    """

    displacement: FloatArray  # (n_channels, n_coordinates): u along each axis
    gravity_slope: FloatArray  # g ψ, (n_channels, n_coordinates) [m/s² per unit coordinate]
    corner_frequencies: FloatArray  # of AC-coupled channels, 0 for DC, (n_channels,) [Hz]

    @classmethod
    def of(cls, model: StructuralModel, layout: SensorLayout) -> "Observation":
        displacement, slope = [], []
        for channel in layout.channels:
            displacement.append(model.tower_displacement(channel.elevation, channel.direction))
            slope.append(model.tower_slope(channel.elevation, channel.direction))
        corners = [
            channel.corner_frequency if channel.coupling == "ac" else 0.0
            for channel in layout.channels
        ]
        gravity = model.description.gravity
        return cls(np.array(displacement), gravity * np.array(slope), np.array(corners))

    def in_basis(self, basis: FloatArray) -> "Observation":
        """The same for coordinates of a basis, (n_coordinates, n_basis)."""
        return Observation(
            self.displacement @ basis, self.gravity_slope @ basis, self.corner_frequencies
        )

    def shapes(
        self, displacement: FloatArray, gravity_slope: FloatArray, squares: FloatArray
    ) -> FloatArray:
        """Shapes as read, largest component 1.

        displacement, gravity_slope   (..., n_channels) of each mode
        squares                       ω², (...) [rad²/s²]
        """
        readings = displacement + gravity_slope / squares[..., None]
        if np.any(self.corner_frequencies > 0):
            frequencies = np.sqrt(squares)[..., None] / (2 * np.pi)
            readings = readings / (1 - 1j * self.corner_frequencies / frequencies)
        return _normalised(readings)


def _normalised(readings: NDArray[np.float64] | NDArray[np.complex128]) -> FloatArray:
    """Real shapes whose largest component is 1 ([foundation-updating] Eq. 11)."""
    largest = np.argmax(np.abs(readings), axis=-1)[..., None]
    return np.real(readings / np.take_along_axis(readings, largest, axis=-1))


def full_modes(
    description: TurbineDescription,
    layout: SensorLayout,
    theta: ArrayLike | None = None,
    *,
    highest_frequency: float = 12.5,
    tube_refinement: int = 1,
) -> FullModes:
    """Every mode of the whole model up to a frequency, for one foundation.

    theta               θ, (3,) [N/m, N·m/rad, N/rad]; None: the description's
    highest_frequency   [Hz]

    Raises TurbineError where the springs are not positive definite or the structure would fall.
    """
    model = assemble(description, stiffness=theta, tube_refinement=tube_refinement)
    return _full_modes(model, Observation.of(model, layout), highest_frequency)


def _full_modes(
    model: StructuralModel, observation: Observation, highest_frequency: float
) -> FullModes:
    parts = [_modes_of_group(model, basis, highest_frequency) for basis in decoupled_groups(model)]
    squares = np.concatenate([squares for squares, _ in parts])
    vectors = np.concatenate([vectors for _, vectors in parts], axis=1)
    order = np.argsort(squares)
    squares, vectors = squares[order], vectors[:, order]
    displacement = (observation.displacement @ vectors).T
    return FullModes(
        frequencies=np.sqrt(squares) / (2 * np.pi),
        vectors=vectors,
        shapes=observation.shapes(displacement, (observation.gravity_slope @ vectors).T, squares),
        directions=_directions(model, vectors),
        blade_energy_share=np.einsum("im,ij,jm->m", vectors, model.blade_mass, vectors),
        sensor_motion=np.abs(displacement).max(axis=1),
    )


def _modes_of_group(
    model: StructuralModel, basis: FloatArray, highest_frequency: float
) -> tuple[FloatArray, FloatArray]:
    """ω² [rad²/s²] and mass-normalised vectors of one decoupled group, up to a frequency [Hz]."""
    highest = (2 * np.pi * highest_frequency) ** 2
    squares, vectors = eigh(
        basis.T @ model.stiffness @ basis,
        basis.T @ model.mass @ basis,
        subset_by_value=(-np.inf, highest),
    )
    if len(squares) and squares[0] <= 0:
        k11, k22, k12 = model.theta
        raise TurbineError(
            f"{model.description.name} falls over on k11 = {k11:g} N/m, k22 = {k22:g} N·m/rad, "
            f"k12 = {k12:g} N/rad: the springs do not hold it against gravity"
        )
    return squares, basis @ vectors


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
    harmonics = [np.ones(number)]
    for k in range(1, (number - 1) // 2 + 1):
        harmonics += [np.cos(k * azimuths), np.sin(k * azimuths)]
    if number % 2 == 0:
        harmonics.append((-1.0) ** np.arange(number))
    unit = np.array([row / np.linalg.norm(row) for row in harmonics])  # (harmonic, blade)
    for same in model.blade_coordinates.T:  # one coordinate, all blades
        transformation[np.ix_(same, same)] = unit.T
    return transformation


def _directions(model: StructuralModel, vectors: FloatArray) -> tuple[Direction, ...]:
    """The plane in which the tower's nodes move most, for each mode."""
    motion: dict[Direction, FloatArray] = {
        plane: (vectors[model.tower_dofs[:, columns.start]] ** 2).sum(axis=0)
        for plane, columns in PLANE.items()
    }
    return tuple(
        "FA" if fa >= ss else "SS" for fa, ss in zip(motion["FA"], motion["SS"], strict=True)
    )


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceModes:
    """The labelled modes at one θ that a ModalModel follows to other foundations."""

    theta: FloatArray  # (3,) [N/m, N·m/rad, N/rad]
    labels: tuple[str, ...]
    directions: tuple[Direction, ...]
    blade_energy_share: FloatArray  # (n_modes,) [-]
    vectors: FloatArray  # mass-normalised, (n_dofs, n_modes)

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
    """The modes that the sensors can see, labelled.

    Visible is a mode up to the highest frequency [Hz] whose largest displacement at a sensor,
    at unit modal mass, reaches VISIBLE_SHARE of the largest of all modes. First the description's
    reference modes under their own names, then the others, numbered on by frequency.
    """
    modes = _full_modes(model, Observation.of(model, layout), highest_frequency)
    largest = modes.sensor_motion.max(initial=0.0)
    visible = np.flatnonzero(modes.sensor_motion >= VISIBLE_SHARE * largest).tolist()
    listed = _published_modes(model.description.reference_modes, modes)
    others = [mode for mode in visible if mode not in listed.values()]
    labels = [*listed, *_further_labels(set(listed), len(others))]
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
            f"has no further {mode.direction} mode below the highest frequency asked"
        )
    distance = {i: abs(modes.frequencies[i] / mode.frequency - 1) for i in possible}
    window = REFERENCE_WINDOW
    while min(distance.values()) > window:
        window *= 2
    return [i for i in possible if distance[i] <= window]


def _further_labels(used: set[str], count: int) -> list[str]:
    """Numbers that go on after the listed names: '12', '13', …"""
    numbers = (str(number) for number in range(len(used) + 1, len(used) + count + 2 + len(used)))
    return [number for number in numbers if number not in used][:count]


@dataclass(frozen=True, slots=True, eq=False)
class _ReducedGroup:
    """One decoupled group in a basis that is mass-normalised and diagonal at the reference θ."""

    squares: FloatArray  # Λ, (n_basis,) [rad²/s²]
    spring_rows: FloatArray  # Y, (n_planes, 2, n_basis): (u, ψ) of the mudline
    observation: Observation  # in this basis
    followed: IntArray  # (n_followed,): basis vectors that are the reference modes to follow
    outputs: IntArray  # (n_followed,): their places among the labels

    def modes(self, change: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Squares ω² (n, n_followed) and shapes (n, n_followed, n_channels) of the followed modes.

        change   ΔS, (n, 2, 2): spring matrices less those of the reference
        """
        Y = self.spring_rows
        stiffness = np.einsum("pia,nij,pjb->nab", Y, change, Y, optimize=True)
        diagonal = np.arange(len(self.squares))
        stiffness[:, diagonal, diagonal] += self.squares
        squares, vectors = np.linalg.eigh(stiffness)
        places = followed_by_overlap(vectors[:, self.followed, :] ** 2)
        squares = np.take_along_axis(squares, places, axis=1)
        vectors = np.take_along_axis(vectors, places[:, None, :], axis=2).swapaxes(1, 2)
        displacement = vectors @ self.observation.displacement.T
        gravity_slope = vectors @ self.observation.gravity_slope.T
        return squares, self.observation.shapes(displacement, gravity_slope, squares)


def followed_by_overlap(overlap: FloatArray) -> IntArray:
    """Which mode continues each reference mode.

    overlap   squared mass-weighted products (φ_refᵀ M φ)² in [0, 1], (n, n_reference, n_modes)
    returns   (n, n_reference): no mode twice, the sum of the overlaps as large as can be

    Where every reference mode has a best successor of its own, that is the optimum; an
    assignment is solved only for the others.
    """
    best = np.argmax(overlap, axis=2)
    ordered = np.sort(best, axis=1)
    for row in np.flatnonzero((ordered[:, 1:] == ordered[:, :-1]).any(axis=1)):
        best[row] = linear_sum_assignment(overlap[row], maximize=True)[1]
    return best


def _reduced_group(
    model: StructuralModel,
    basis: FloatArray,
    observation: Observation,
    reference: ReferenceModes,
    highest_frequency: float,
) -> _ReducedGroup | None:
    """The group's reduced model; None where it holds no mode to follow."""
    mass, stiffness = basis.T @ model.mass @ basis, basis.T @ model.stiffness @ basis
    squares, vectors = eigh(stiffness, mass)
    kept = squares <= (2 * np.pi * _BASIS_MARGIN * highest_frequency) ** 2
    products = np.abs(reference.vectors.T @ model.mass @ basis @ vectors[:, kept])
    outputs = np.flatnonzero(products.max(axis=1, initial=0.0) > 0.5)
    if not len(outputs):
        return None
    springs = basis[model.spring_dofs]  # (2 planes, 2, n_group)
    loads = springs.reshape(4, -1)
    loads = loads[np.abs(loads).max(axis=1) > 0]
    residual = _residual_vectors(vectors[:, ~kept], squares[~kept], loads)
    ritz = np.concatenate([vectors[:, kept], residual], axis=1)
    reduced, rotation = eigh(ritz.T @ stiffness @ ritz, ritz.T @ mass @ ritz)
    complete = basis @ ritz @ rotation
    return _ReducedGroup(
        squares=reduced,
        spring_rows=complete[model.spring_dofs],
        observation=observation.in_basis(complete),
        followed=np.argmax(np.abs(reference.vectors[:, outputs].T @ model.mass @ complete), axis=1),
        outputs=outputs,
    )


def _residual_vectors(vectors: FloatArray, squares: FloatArray, loads: FloatArray) -> FloatArray:
    """What the left-out modes contribute to the response to mudline loads, two orders in ω².

    vectors, squares   the left-out modes, mass-normalised
    loads              (n_loads, n_group)

        (K − ω² M)⁻¹ b over the left-out modes ≈ Σ φ φᵀ b / ω_j² + ω² Σ φ φᵀ b / ω_j⁴ + …
    """
    participation = (loads @ vectors).T  # (n_left_out, n_loads)
    orders = [participation / squares[:, None] ** order for order in (1, 2)]
    coordinates = np.concatenate(orders, axis=1)
    coordinates /= np.linalg.norm(coordinates, axis=0)
    independent, strength, _ = np.linalg.svd(coordinates, full_matrices=False)
    return vectors @ independent[:, strength > 1e-8 * strength.max(initial=0.0)]


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
        reference: ReferenceModes | None = None,
    ) -> None:
        """highest_frequency [Hz]; reference: modes to follow other than the nominal ones.

        Raises TurbineError where the description's own foundation does not hold the structure,
        or a sensor is not on the tower.
        """
        model = assemble(description)
        if reference is None:
            reference = visible_modes(model, layout, highest_frequency=highest_frequency)
        self.description = description
        self.layout = layout
        self.highest_frequency = highest_frequency
        self.nominal = description.nominal
        self.labels = reference.labels
        self.directions = reference.directions
        self.blade_energy_share = reference.blade_energy_share
        self._reference = reference
        self._gravity = mudline_gravity_stiffness(model)
        at_reference = assemble(description, stiffness=reference.theta)
        observation = Observation.of(model, layout)
        groups = (
            _reduced_group(at_reference, basis, observation, reference, highest_frequency)
            for basis in decoupled_groups(at_reference)
        )
        self._groups = tuple(group for group in groups if group is not None)

    @property
    def theta_reference(self) -> FloatArray:
        """θ at which the labels are defined, (3,) [N/m, N·m/rad, N/rad]."""
        return self._reference.theta

    def admissible(self, theta: ArrayLike) -> NDArray[np.bool_]:
        """Whether springs are positive definite and hold the structure against gravity.

        theta     θ, (n, 3) [N/m, N·m/rad, N/rad]
        returns   (n,)
        """
        theta = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        held = positive_definite(theta)
        total = np.tile(self._gravity, (int(held.sum()), 1, 1))
        springs = spring_matrix(theta[held], self.description.foundation.sign)
        for plane in PLANE.values():
            total[:, plane, plane] += springs
        held[held] = np.linalg.eigvalsh(total)[:, 0] > 0
        return held

    def modal(self, theta: ArrayLike, *, damping: ArrayLike | None = None) -> ModalParameters:
        """The labelled modes for many foundations.

        theta     θ = (k11, k22, k12), (n, 3) or (3,) [N/m, N·m/rad, N/rad]
        damping   ζ to attach, one or (n_modes,) [-]

        Rows that are not admissible hold NaN.
        """
        theta = np.atleast_2d(np.asarray(theta, dtype=np.float64))
        n, n_modes, n_channels = len(theta), len(self.labels), len(self.layout.channels)
        admissible = self.admissible(theta)
        sign = self.description.foundation.sign
        change = spring_matrix(theta[admissible], sign) - spring_matrix(self.theta_reference, sign)
        squares = np.empty((len(change), n_modes))
        shapes = np.empty((len(change), n_modes, n_channels))
        for group in self._groups:
            squares[:, group.outputs], shapes[:, group.outputs] = group.modes(change)
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

    def following(self, theta_reference: ArrayLike) -> "ModalModel":
        """The same modes, followed by overlap from another θ, (3,), instead of the present one.

        Raises TurbineError where that θ is not admissible.
        """
        model = assemble(self.description, stiffness=theta_reference)
        modes = _full_modes(
            model, Observation.of(model, self.layout), _BASIS_MARGIN * self.highest_frequency
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
        return ModalModel(
            self.description,
            self.layout,
            highest_frequency=self.highest_frequency,
            reference=reference,
        )

    def subset(self, labels: Sequence[str]) -> "ModalModel":
        """A cheaper model with some of the modes only, in the given order; KeyError for a label
        that there is not."""
        for label in labels:
            if label not in self.labels:
                raise KeyError(f"no mode {label!r}; there are {', '.join(self.labels)}")
        return ModalModel(
            self.description,
            self.layout,
            highest_frequency=self.highest_frequency,
            reference=self._reference.take([self.labels.index(label) for label in labels]),
        )


def mudline_gravity_stiffness(model: StructuralModel) -> FloatArray:
    """Static stiffness of everything above the springs, seen from the mudline.

    returns   (4, 4) on (u_x, ψ_x, u_y, ψ_y) [N/m, N, N·m/rad]

    Without gravity it is zero (the structure would just move along); with it, the weight tips.
    The whole stands where this plus the springs is positive definite.
    """
    mudline = model.spring_dofs.ravel()
    above = np.setdiff1d(np.arange(model.n_dofs), mudline)
    free = model.stiffness_at(np.zeros(3))
    coupling = free[np.ix_(above, mudline)]
    inner = np.linalg.solve(free[np.ix_(above, above)], coupling)
    return free[np.ix_(mudline, mudline)] - coupling.T @ inner
