"""Uniform beam elements, of which towers and blades are made.

Bending in one plane has four degrees of freedom an element, (v_1, ψ_1, v_2, ψ_2): displacement v
[m] and slope ψ = dv/dz [rad] at the element's start and end, z along the beam. Axial displacement
and twist have two, start and end. Formulae without another source: Przemieniecki, "Theory of
Matrix Structural Analysis" (1968), chapters 5, 11 and 15.

Without shear (Φ = 0) a section stays square to the axis, ψ = dv/dz (Euler-Bernoulli). With it
(Timoshenko) ψ is the section's own rotation, and the shapes between the ends are those that are
exact for forces at the ends; Φ = 12 EI / (κ G A L²) is what shear gives of an element's
displacement, over what bending does.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sensors.arrays import FloatArray

# β L of the clamped-clamped uniform beam: roots of cos(βL) cosh(βL) = 1 [-]
CLAMPED_CLAMPED_ROOTS = (4.730040744862704, 7.853204624095838, 10.995607838001671)
_GAUSS_POINTS = 24  # exact for the cubics, and to 1e-14 for the clamped-clamped shapes kept here


def hermite(position: ArrayLike, length: float, shear: float = 0.0) -> FloatArray:
    """Displacement at a place inside the element, for unit end displacements and rotations.

    Parameters
    ----------
    position : ArrayLike, shape (...,)
        ξ = z / L in [0, 1].
    shear : float, optional
        Φ [-].

    Returns
    -------
    ndarray, shape (..., 4)
        So that v(ξ) = hermite(ξ, L) @ (v_1, ψ_1, v_2, ψ_2).
    """
    xi = np.asarray(position, dtype=np.float64)
    bent = [
        1 - 3 * xi**2 + 2 * xi**3,
        length * (xi - 2 * xi**2 + xi**3),
        3 * xi**2 - 2 * xi**3,
        length * (xi**3 - xi**2),
    ]
    bow = length / 2 * (xi - xi**2)
    return _with_shear(bent, [1 - xi, bow, xi, -bow], shear)


def hermite_slope(position: ArrayLike, length: float, shear: float = 0.0) -> FloatArray:
    """Slope dv/dz inside the element; arguments and shape as for `hermite`."""
    xi = np.asarray(position, dtype=np.float64)
    straight, bow = np.ones_like(xi) / length, (1 - 2 * xi) / 2
    return _with_shear(_bent_slope(xi, length), [-straight, bow, straight, -bow], shear)


def section_rotation(position: ArrayLike, length: float, shear: float = 0.0) -> FloatArray:
    """Rotation ψ of the section inside the element, dv/dz where there is no shear; arguments and
    shape as for `hermite`."""
    xi = np.asarray(position, dtype=np.float64)
    none = np.zeros_like(xi)
    return _with_shear(_bent_slope(xi, length), [none, 1 - xi, none, xi], shear)


def _bent_slope(xi: FloatArray, length: float) -> list[FloatArray]:
    return [
        6 * (xi**2 - xi) / length,
        1 - 4 * xi + 3 * xi**2,
        6 * (xi - xi**2) / length,
        3 * xi**2 - 2 * xi,
    ]


def _with_shear(
    bent: Sequence[FloatArray], sheared: Sequence[FloatArray], shear: float
) -> FloatArray:
    """Shapes (..., 4) of an element that bends and shears: (bent + Φ sheared) / (1 + Φ)."""
    shapes = np.stack(bent, axis=-1)
    return shapes if shear == 0 else (shapes + shear * np.stack(sheared, axis=-1)) / (1 + shear)


def bending_stiffness(bending_rigidity: float, length: float, shear: float = 0.0) -> FloatArray:
    """(4, 4) stiffness of (v_1, ψ_1, v_2, ψ_2); bending_rigidity EI [N·m²], length L [m], shear
    Φ [-]."""
    L = length
    near, far = (4 + shear) * L**2, (2 - shear) * L**2
    return (bending_rigidity / (L**3 * (1 + shear))) * np.array(
        [
            [12, 6 * L, -12, 6 * L],
            [6 * L, near, -6 * L, far],
            [-12, -6 * L, 12, -6 * L],
            [6 * L, far, -6 * L, near],
        ]
    )


def bending_mass(
    mass_per_length: float,
    length: float,
    *,
    start: float = 0.0,
    end: float = 1.0,
    shear: float = 0.0,
) -> FloatArray:
    """(4, 4) consistent mass of (v_1, ψ_1, v_2, ψ_2).

    Parameters
    ----------
    mass_per_length : float
        m [kg/m], carried between ξ = start and ξ = end only (a water level inside the element
        wets a part of it).
    shear : float, optional
        Φ [-].

    Returns
    -------
    ndarray, shape (4, 4)
        Mass matrix.

    Notes
    -----
    M = ∫ m NᵀN dz, N the shapes of `hermite`; without rotary inertia (`rotary_mass`).
    """
    N, weighted = _weighted_cubics(start, end, length, shear)
    return mass_per_length * length * weighted @ N


@lru_cache(maxsize=1024)  # a structure is assembled hundreds of times with nearly the same elements
def _weighted_cubics(
    start: float, end: float, length: float, shear: float
) -> tuple[FloatArray, FloatArray]:
    """Displacement shapes N at the Gauss points, (n, 4), and Nᵀ with their weights, (4, n)."""
    xi, weights = _gauss_points(start, end)
    N = hermite(xi, length, shear)
    return N, N.T * weights


def rotary_mass(inertia_per_length: float, length: float, shear: float) -> FloatArray:
    """(4, 4) inertia of the sections' rotation, ∫ ρI ψᵀψ dz, for ρI [kg·m] and Φ [-]."""
    xi, weights = _gauss_points(0.0, 1.0)
    rotation = section_rotation(xi, length, shear)
    return inertia_per_length * length * (rotation.T * weights) @ rotation


def geometric_stiffness(
    tension_start: float, tension_end: float, length: float, shear: float = 0.0
) -> FloatArray:
    """(4, 4) stiffness that an axial force adds; it varies linearly along the element.

    Parameters
    ----------
    tension_start, tension_end : float
        T [N] at the two ends, tension positive.
    shear : float, optional
        Φ [-].

    Returns
    -------
    ndarray, shape (4, 4)
        Geometric stiffness K_G = ∫ T(z) N'ᵀN' dz.
    """
    xi, weights = _gauss_points(0.0, 1.0)
    tension = tension_start + (tension_end - tension_start) * xi
    slope = hermite_slope(xi, length, shear)
    return length * (slope.T * (weights * tension)) @ slope


def rod_stiffness(rigidity: float, length: float) -> FloatArray:
    """(2, 2) axial stiffness with rigidity EA [N], or torsional with GJ [N·m²]."""
    return rigidity / length * np.array([[1.0, -1.0], [-1.0, 1.0]])


def rod_mass(inertia_per_length: float, length: float) -> FloatArray:
    """(2, 2) consistent mass [kg] for m [kg/m], or polar inertia [kg·m²] for ρJ [kg·m]."""
    return inertia_per_length * length / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])


@dataclass(frozen=True, slots=True, eq=False)
class ReducedBendingElement:
    """A uniform beam's bending in one plane, Craig-Bampton reduced.

    Degrees of freedom (v_1, ψ_1, v_2, ψ_2, η_1, … η_n): the ends, then the amplitudes of the
    lowest clamped-clamped modes, each mode scaled to mean square 1.
    """

    stiffness: FloatArray
    """Stiffness, (4 + n, 4 + n)."""

    mass: FloatArray
    """Mass, (4 + n, 4 + n)."""


def craig_bampton_element(
    bending_rigidity: float, mass_per_length: float, length: float, *, modes: int
) -> ReducedBendingElement:
    """Return the exact uniform beam between two nodes, with its lowest clamped-clamped modes.

    Parameters
    ----------
    bending_rigidity : float
        EI [N·m²].
    mass_per_length : float
        [kg/m].
    length : float
        [m].
    modes : int
        How many clamped-clamped modes.

    Notes
    -----
    The static shapes of a uniform beam under end displacements are the Hermite cubics, so the
    interface block is the ordinary element; the modes are known in closed form.

    References
    ----------
    Craig and Bampton, AIAA Journal 6 (1968) 1313; [foundation-updating] §3.1.
    """
    xi, weights = _gauss_points(0.0, 1.0)
    shapes = np.concatenate(
        [hermite(xi, length)] + [_clamped_clamped(xi, mode)[:, None] for mode in range(modes)],
        axis=1,
    )
    mass = mass_per_length * length * (shapes.T * weights) @ shapes
    roots = np.array(CLAMPED_CLAMPED_ROOTS[:modes])
    stiffness = np.zeros((4 + modes, 4 + modes))
    stiffness[:4, :4] = bending_stiffness(bending_rigidity, length)
    stiffness[4:, 4:] = np.diag(bending_rigidity * roots**4 / length**3)
    return ReducedBendingElement(stiffness=stiffness, mass=mass)


def _clamped_clamped(xi: FloatArray, mode: int) -> FloatArray:
    """Clamped-clamped mode shape of a uniform beam, mean square 1."""
    root = CLAMPED_CLAMPED_ROOTS[mode]
    sigma = (np.cosh(root) - np.cos(root)) / (np.sinh(root) - np.sin(root))
    # cosh − σ sinh without the cancellation of two large numbers
    falling = 0.5 * ((1 - sigma) * np.exp(root * xi) + (1 + sigma) * np.exp(-root * xi))
    return falling - np.cos(root * xi) + sigma * np.sin(root * xi)


def _gauss_points(start: float, end: float) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre points in [start, end] and their weights, which sum to end − start."""
    points, weights = _legendre()
    half = (end - start) / 2
    return start + half * (points + 1), half * weights


@cache
def _legendre() -> tuple[FloatArray, FloatArray]:
    points, weights = np.polynomial.legendre.leggauss(_GAUSS_POINTS)
    return points, weights
