"""Comparing and normalising mode shapes: what both identification and updating need."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray

Shapes = NDArray[Any]  # float64 or complex128


def modal_assurance_criterion(shapes_1: Shapes, shapes_2: Shapes) -> FloatArray:
    """MAC of every shape of one set with every shape of another.

    shapes_1   (..., n_1, n_channels), real or complex [-]
    shapes_2   (..., n_2, n_channels)
    returns    (..., n_1, n_2), in [0, 1]; 0 where a shape is zero

        MAC(φ1, φ2) = |φ1 φ2*|² / (φ1 φ1* · φ2 φ2*)

    Source: [foundation-updating] Eq. 5. Scale and phase of either shape do not matter.
    """
    products = np.abs(shapes_1 @ np.conj(np.swapaxes(shapes_2, -1, -2))) ** 2
    norms_1 = (np.abs(shapes_1) ** 2).sum(axis=-1)[..., :, None]
    norms_2 = (np.abs(shapes_2) ** 2).sum(axis=-1)[..., None, :]
    norms = norms_1 * norms_2
    return np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)


def complex_normalised(shape: Shapes) -> FloatArray:
    """Real shape whose largest component is exactly 1.

    shape     (..., n_channels), complex or real [-]
    returns   (..., n_channels)

        φ̄ = Re(φ / φ_i),  i = argmax |φ|

    Source: [foundation-updating] Eq. 11 (Fillod). For a damped mode, proportionally or not, it
    approximates the undamped one.
    """
    largest = np.argmax(np.abs(shape), axis=-1)[..., None]
    return np.real(shape / np.take_along_axis(shape, largest, axis=-1))


def normalised_to(shape: FloatArray, component: int) -> FloatArray:
    """The real shape scaled so that the given component is 1. shape: (..., n_channels)."""
    return shape / shape[..., component, None]


def renormalised_factor(shape: FloatArray, factor: FloatArray, component: int) -> FloatArray:
    """Covariance factor of a shape after another component was made the unit one.

    shape       φ, (n_channels,), normalised to any component [-]
    factor      (n_channels, n_columns): rows of Mode.covariance_factor that belong to φ
    component   j, the new unit component
    returns     (n_channels, n_columns) of φ' = φ / φ_j, first order:

        dφ' = (dφ − φ' dφ_j) / φ_j,   so row j becomes exactly zero
    """
    new_shape = normalised_to(shape, component)
    return (factor - np.outer(new_shape, factor[component])) / shape[component]
