"""Complex modes of a structure whose dampers couple its undamped ones."""

from dataclasses import dataclass

import numpy as np

from sensors.arrays import ComplexArray, FloatArray
from sensors.dynamics.simulated_modes import ObservedModes, StructureModes
from sensors.structure.foundation import TurbineError
from sensors.structure.structural_model import StructuralModel


@dataclass(frozen=True, slots=True, eq=False)
class DampedSystem:
    """Complex modes of a structure with any viscous damping, and what they are read by.

    With the undamped modes' coordinates q (mass 1, stiffness ω², damping C) each pole λ above the
    real axis has a shape φ, scaled so that φᵀ (2λ I + C) φ = 1, and

        z' = λ z + φᵀ p(t),   q = 2 Re Σ φ z,   q'' = p + 2 Re Σ λ² φ z
    """

    poles: ComplexArray
    """λ, (n_modes,) [rad/s]."""

    vectors: ComplexArray
    """φ in the columns, (n_modes, n_modes)."""

    damping: FloatArray
    """C, (n_modes, n_modes) [1/s]."""

    modes: ObservedModes
    shapes: FloatArray
    """Undamped modes, (n_dofs, n_modes)."""

    mass: FloatArray
    """M, (n_dofs, n_dofs)."""

    @property
    def frequencies(self) -> FloatArray:
        """|λ| / 2π, (n_modes,) [Hz]."""
        return np.abs(self.poles) / (2.0 * np.pi)

    @property
    def damping_ratios(self) -> FloatArray:
        """−Re λ / |λ|, (n_modes,) [-]."""
        return -self.poles.real / np.abs(self.poles)

    @property
    def readings(self) -> ComplexArray:
        """What accelerometers read of each mode in free motion, (n_modes, n_channels).

        λ² φ − g ψ, through an AC-coupled channel's s / (s + 2π f_corner) at s = λ
        """
        modes, poles = self.modes, self.poles
        read = (modes.displacement @ self.vectors) * poles**2
        read -= modes.gravity * (modes.rotation @ self.vectors)
        coupled: ComplexArray = read.T / (
            1.0 + 2.0 * np.pi * modes.corner_frequencies / poles[:, None]
        )
        return coupled


def damped_system(
    model: StructuralModel,
    modes: StructureModes,
    observed: ObservedModes,
    dampers: FloatArray | None = None,
) -> DampedSystem:
    """Return the modes with their modal damping and with dampers between the degrees of freedom.

    Parameters
    ----------
    dampers : ndarray, optional, shape (n_dofs, n_dofs)
        Added to the modal damping [N·s/m]; None: none, shapes stay real.

    Raises
    ------
    TurbineError
        If a mode is overdamped.
    """
    omega = 2.0 * np.pi * modes.frequencies
    damping = np.diag(2.0 * modes.damping_ratios * omega)
    if dampers is None:
        poles = omega * (-modes.damping_ratios + 1j * np.sqrt(1.0 - modes.damping_ratios**2))
        vectors = np.eye(len(omega), dtype=np.complex128)
    else:
        damping = damping + modes.shapes.T @ dampers @ modes.shapes
        poles, vectors = _complex_modes(omega, damping)
    scale = np.einsum("im,ij,jm->m", vectors, damping, vectors, optimize=True)
    scale += 2.0 * poles * np.einsum("im,im->m", vectors, vectors)
    return DampedSystem(
        poles, vectors / np.sqrt(scale), damping, observed, modes.shapes, model.mass
    )


def _complex_modes(omega: FloatArray, damping: FloatArray) -> tuple[ComplexArray, ComplexArray]:
    """Poles above the real axis, lowest first, and their shapes in the undamped coordinates."""
    n = len(omega)
    state = np.block([[np.zeros((n, n)), np.eye(n)], [-np.diag(omega**2), -damping]])
    poles, vectors = np.linalg.eig(state)
    upper = np.flatnonzero(poles.imag > 0)
    if len(upper) < n:
        raise TurbineError(
            f"{n - len(upper)} modes are overdamped: dampers are too strong for an oscillation"
        )
    upper = upper[np.argsort(np.abs(poles[upper]))]
    return poles[upper], vectors[:n, upper]
