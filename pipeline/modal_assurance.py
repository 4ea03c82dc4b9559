"""Comparing and normalising mode shapes: what both identification and updating need."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray

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
