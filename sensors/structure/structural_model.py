"""StructuralModel: matrices of the whole turbine, and rows that read its motion at any point.

Every tower node has (u_x, ψ_x, u_y, ψ_y, u_z, θ_z): displacement [m] and slope [rad] in the
fore-aft and the side-side plane, heave [m] and twist [rad]. Heave and twist are fixed at the
mudline. Every blade node has displacement and slope flapwise and edgewise, absolute but along the
blade's own axes; axially and in twist a blade follows its root.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sensors.arrays import FloatArray, IndexArray
from sensors.structure import beam
from sensors.structure.description import Direction, TurbineDescription
from sensors.structure.foundation import TurbineError, spring_matrix
from sensors.structure.rotor_nacelle import blade_axes, rigid_displacement

Interpolation = Callable[[float, float, float], FloatArray]  # (ξ, element's length, Φ) → (4,)

PLANE_COLUMNS: dict[Direction, slice] = {
    "FA": slice(0, 2),
    "SS": slice(2, 4),
}  # (u, ψ) of a tower node
HEAVE, TWIST = 4, 5
FIXED = -1  # index of a degree of freedom that is held


@dataclass(frozen=True, slots=True, eq=False)
class StructuralModel:
    """Mass and stiffness of the whole turbine, and where its degrees of freedom are.

    Matrices are (n_dofs, n_dofs); SI: kg, kg·m, kg·m², N/m, N, N·m.
    """

    description: TurbineDescription
    theta: FloatArray
    """θ = (k11, k22, k12) in `stiffness`, (3,) [N/m, N·m/rad, N/rad]."""

    mass: FloatArray
    free_stiffness: FloatArray
    """Elastic + gravity, without the springs."""

    blade_mass: FloatArray
    """The blades' part of `mass`."""

    elevations: FloatArray
    """Elevations of the tower's nodes, from the mudline up, (n_nodes,) [m]."""

    tower_dofs: IndexArray
    """Tower dofs, (n_nodes, 6) in the order (u_x, ψ_x, u_y, ψ_y, u_z, θ_z); −1: fixed."""

    blade_dofs: IndexArray
    """Blade dofs, (n_blades, n_blade_nodes − 1, 4): flap v, v', edge v, v'; no root."""

    blade_inner_dofs: IndexArray
    """Blade inner dofs, (n_blades, n): clamped-clamped amplitudes, flap first, then edge."""

    @property
    def n_dofs(self) -> int:
        """Number of degrees of freedom."""
        return len(self.mass)

    @property
    def spring_dofs(self) -> IndexArray:
        """(2, 2): (u, ψ) of the mudline, fore-aft then side-side."""
        return self.tower_dofs[0, :4].reshape(2, 2)

    @property
    def blade_coordinates(self) -> IndexArray:
        """(n_blades, n): every coordinate of each blade, in the same order for all."""
        n_blades = len(self.blade_dofs)
        return np.concatenate(
            [self.blade_dofs.reshape(n_blades, -1), self.blade_inner_dofs], axis=1
        )

    @property
    def stiffness(self) -> FloatArray:
        """Elastic + gravity + springs of θ."""
        springs = spring_matrix(self.theta, self.description.foundation.sign)
        stiffness = self.free_stiffness.copy()
        for dofs in self.spring_dofs:
            stiffness[np.ix_(dofs, dofs)] += springs
        return stiffness

    def on_springs(self, theta: ArrayLike) -> "StructuralModel":
        """Return the same structure on other springs θ, (3,) [N/m, N·m/rad, N/rad]."""
        return replace(self, theta=np.asarray(theta, dtype=np.float64))

    def tower_displacement(self, elevation: float, direction: Sequence[float]) -> FloatArray:
        """(n_dofs,) row h: displacement of the tower's axis along a direction, u = h q [m].

        Parameters
        ----------
        elevation : float
            Elevation above mean water level [m]; cubic between the nodes.
        direction : Sequence[float]
            Cosines (x, y, z) [-].

        Returns
        -------
        ndarray, shape (n_dofs,)
            Row h. It also places a force F [N] there: the load vector is h F.
        """
        x, y, z = direction
        row = x * self._tower_row(elevation, "FA", beam.hermite)
        row += y * self._tower_row(elevation, "SS", beam.hermite)
        return row + z * self._heave_row(elevation)

    def tower_slope(self, elevation: float, direction: Sequence[float]) -> FloatArray:
        """(n_dofs,) row: rotation of the tower's section there, where it only bends the slope
        ψ = d_x du_x/dz + d_y du_y/dz of its axis [rad]."""
        x, y, _ = direction
        row = x * self._tower_row(elevation, "FA", beam.section_rotation)
        return row + y * self._tower_row(elevation, "SS", beam.section_rotation)

    def blade_displacement(self, blade: int, node: int, direction: Sequence[float]) -> FloatArray:
        """(n_dofs,) row: displacement of a blade's node along (x, y, z) in tower axes [m].

        Parameters
        ----------
        node : int
            1 (outer end of the innermost element) to the tip's number.

        Returns
        -------
        ndarray, shape (n_dofs,)
            The row; it also places a force there.
        """
        blades = self.description.blades
        assert blades is not None
        axes = blade_axes(self.description.rotor_nacelle, blades, blade)
        d = np.asarray(direction, dtype=np.float64)
        row = np.zeros(self.n_dofs)
        flap, _, edge, _ = self.blade_dofs[blade, node - 1]
        row[flap], row[edge] = axes.flap @ d, axes.edge @ d
        row[self.tower_dofs[-1]] += (axes.span @ d) * (axes.span @ rigid_displacement(axes.root))
        return row

    def _tower_row(
        self, elevation: float, plane: Direction, interpolation: Interpolation
    ) -> FloatArray:
        element, xi, length = self._element_at(elevation)
        dofs = self.tower_dofs[element : element + 2, PLANE_COLUMNS[plane]].ravel()
        row = np.zeros(self.n_dofs)
        row[dofs] = interpolation(xi, length, self.description.tubes[element].shear_parameter)
        return row

    def _heave_row(self, elevation: float) -> FloatArray:
        element, xi, _ = self._element_at(elevation)
        row = np.zeros(self.n_dofs)
        for dof, share in zip(
            self.tower_dofs[element : element + 2, HEAVE], (1 - xi, xi), strict=True
        ):
            if dof != FIXED:
                row[dof] = share
        return row

    def _element_at(self, elevation: float) -> tuple[int, float, float]:
        """Tube that holds the elevation, the place ξ in it, its length [m]."""
        bottom, top = self.elevations[0], self.elevations[-1]
        if not bottom - 1e-9 <= elevation <= top + 1e-9:
            raise TurbineError(
                f"elevation {elevation:g} m is outside the tower of {self.description.name}, "
                f"{bottom:g} to {top:g} m; correct it under [sensors] elevations or in the layout"
            )
        last = len(self.elevations) - 2
        element = int(np.clip(np.searchsorted(self.elevations, elevation) - 1, 0, last))
        length = float(self.elevations[element + 1] - self.elevations[element])
        return element, float((elevation - self.elevations[element]) / length), length
