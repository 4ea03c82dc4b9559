"""From a complex identified shape to the real, normalised one, with its uncertainty."""

from typing import Any

import numpy as np

from pipeline.modal_assurance import complex_normalised
from sensors.arrays import ComplexArray, FloatArray


def modal_phase_collinearity(shapes: ComplexArray) -> FloatArray:
    """MPC: 1 when all channels move in phase or in opposition, 0 when phases are scattered.

    shapes   (..., n_channels), complex [-]

        MPC = ((S_rr − S_ii)² + 4 S_ri²) / (S_rr + S_ii)²,  S_rr = Reφ·Reφ and so on

    Source: Pappa, Elliott, Schenk (1993), Consistent-mode indicator for the eigensystem
    realization algorithm, J. Guid. Control Dyn. 16. The shape is not centred: a mode whose
    channels all move alike is as collinear as any other.
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

    shape        φ, (n_channels,), complex, any scale
    deviations   Δφ, (n_channels, n_columns)
    returns      φ̄ = Re(φ/φ_i), (n_channels,), and its deviations, (n_channels, n_columns):

        Δφ̄ = Re((Δφ − (φ/φ_i) Δφ_i) / φ_i),  i = argmax |φ|

    Normalised first, then the real part: only so do scale and phase of the eigenvector, which
    mean nothing, stay out of the covariance. Row i is exactly zero.
    """
    unit = int(np.argmax(np.abs(shape)))
    scaled: Any = shape / shape[unit]
    change = (deviations - np.outer(scaled, deviations[unit])) / shape[unit]
    normalised = complex_normalised(shape)
    normalised[unit], change[unit] = 1.0, 0.0  # exactly, not to rounding
    return normalised, np.asarray(change.real)
