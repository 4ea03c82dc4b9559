"""Comparing and normalising mode shapes, complex ones and real: what identification and updating
share."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import ComplexArray, FloatArray

Shapes = NDArray[Any]  # float64 or complex128


def modal_assurance_criterion(shapes_1: Shapes, shapes_2: Shapes) -> FloatArray:
    """MAC of every shape of one set with every shape of another.

    Parameters
    ----------
    shapes_1 : ndarray, shape (..., n_1, n_channels)
        Real or complex [-].
    shapes_2 : ndarray, shape (..., n_2, n_channels)

    Returns
    -------
    ndarray, shape (..., n_1, n_2)
        In [0, 1]; 0 where a shape is zero.

    Notes
    -----
        MAC(φ1, φ2) = |φ1 φ2*|² / (φ1 φ1* · φ2 φ2*)

    References
    ----------
    [foundation-updating] Eq. 5. Scale and phase of either shape do not matter.
    """
    products = np.abs(shapes_1 @ np.conj(np.swapaxes(shapes_2, -1, -2))) ** 2
    norms_1 = (np.abs(shapes_1) ** 2).sum(axis=-1)[..., :, None]
    norms_2 = (np.abs(shapes_2) ** 2).sum(axis=-1)[..., None, :]
    norms = norms_1 * norms_2
    return np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)


def mac(shape: Shapes, other: Shapes) -> float:
    """MAC of two shapes, (n_channels,) each: see `modal_assurance_criterion`."""
    return float(modal_assurance_criterion(shape[None], other[None])[0, 0])


def complex_normalised(shape: Shapes) -> FloatArray:
    """Real shape whose largest component is exactly 1.

    Parameters
    ----------
    shape : ndarray, shape (..., n_channels)
        Complex or real [-].

    Returns
    -------
    ndarray, shape (..., n_channels)

    Notes
    -----
        φ̄ = Re(φ / φ_i),  i = argmax |φ|

    References
    ----------
    [foundation-updating] Eq. 11 (Fillod). For a damped mode, proportionally or not, it approximates
    the undamped one.
    """
    largest = np.argmax(np.abs(shape), axis=-1)[..., None]
    return np.real(shape / np.take_along_axis(shape, largest, axis=-1))


def normalised_to(shape: FloatArray, component: int) -> FloatArray:
    """Return the real shape scaled so that the given component is 1. shape: (..., n_channels)."""
    return shape / shape[..., component, None]


def renormalised_factor(shape: FloatArray, factor: FloatArray, component: int) -> FloatArray:
    """Covariance factor of a shape after another component was made the unit one.

    Parameters
    ----------
    shape : ndarray, shape (n_channels,)
        φ, normalised to any component [-].
    factor : ndarray, shape (n_channels, n_columns)
        Rows of Mode.covariance_factor that belong to φ.
    component : int
        j, the new unit component.

    Returns
    -------
    ndarray, shape (n_channels, n_columns)
        Factor of φ' = φ / φ_j, first order:

    Notes
    -----
        dφ' = (dφ − φ' dφ_j) / φ_j,   so row j becomes exactly zero
    """
    new_shape = normalised_to(shape, component)
    return (factor - np.outer(new_shape, factor[component])) / shape[component]


def modal_phase_collinearity(shapes: ComplexArray) -> FloatArray:
    """MPC: 1 when all channels move in phase or in opposition, 0 when phases are scattered.

    Parameters
    ----------
    shapes : ndarray of complex, shape (..., n_channels)
        [-].

    Returns
    -------
    ndarray, shape (...,)
        MPC [-].

    Notes
    -----
        MPC = ((S_rr − S_ii)² + 4 S_ri²) / (S_rr + S_ii)²,  S_rr = Reφ·Reφ and so on

    The shape is not centred: a mode whose channels all move alike is as collinear as any other.

    References
    ----------
    Pappa, Elliott, Schenk (1993), Consistent-mode indicator for the eigensystem realization
    algorithm, J. Guid. Control Dyn. 16.
    """
    rr = np.sum(shapes.real**2, axis=-1)
    ii = np.sum(shapes.imag**2, axis=-1)
    ri = np.sum(shapes.real * shapes.imag, axis=-1)
    total = (rr + ii) ** 2
    return np.divide((rr - ii) ** 2 + 4 * ri**2, total, out=np.zeros_like(rr), where=total > 0)


def normalised_with_deviations(
    shape: ComplexArray, deviations: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """Complex normalisation (Eq. 11) of a shape and of its first-order deviations.

    Parameters
    ----------
    shape : ndarray of complex, shape (n_channels,)
        φ, any scale.
    deviations : ndarray of complex, shape (n_channels, n_columns)
        Δφ, in the scale of φ.

    Returns
    -------
    normalised : ndarray, shape (n_channels,)
        φ̄ = Re(φ/φ_i) [-].
    change : ndarray, shape (n_channels, n_columns)
        Δφ̄ [-]; row i is exactly zero.

    Notes
    -----
        Δφ̄ = Re((Δφ − (φ/φ_i) Δφ_i) / φ_i),  i = argmax |φ|

    Normalised first, then the real part: only so do scale and phase of the eigenvector, which
    mean nothing, stay out of the covariance.
    """
    unit = int(np.argmax(np.abs(shape)))
    scaled: Any = shape / shape[unit]
    change = (deviations - np.outer(scaled, deviations[unit])) / shape[unit]
    normalised = complex_normalised(shape)
    normalised[unit], change[unit] = 1.0, 0.0  # exactly, not to rounding
    return normalised, np.asarray(change.real)
