"""Beam elements of three nodes: quintic in bending, quadratic along and about the axis.

Bending has the degrees of freedom (v, v') at the start, the middle and the end; the six quintic
shape functions are the Hermite basis on ξ = −1, 0, 1. Properties vary inside the element: every
integral is by Gauss-Legendre points, cut where a property jumps.
"""

from collections.abc import Callable, Sequence
from functools import cache

import numpy as np
from numpy.polynomial import polynomial

from sensors.arrays import FloatArray

Property = Callable[[FloatArray], FloatArray]  # of the coordinate s [m], (n,) → (n,)

POINTS = 10  # exact for the mass of a quintic element whose properties are cubics


def integration_points(
    start: float, end: float, cuts: Sequence[float] = ()
) -> tuple[FloatArray, FloatArray]:
    """Gauss-Legendre points and weights of an interval, each part between two cuts on its own.

    Parameters
    ----------
    start, end : float
        Ends of the interval [m].
    cuts : sequence of float
        Where the integrand jumps [m]; those outside the interval are ignored.

    Returns
    -------
    points, weights : ndarray, shape (n,)
        [m]; the weights sum to end − start.
    """
    edges = np.array([start, *sorted(cut for cut in cuts if start < cut < end), end])
    unit, weights = _legendre()
    half = np.diff(edges)[:, None] / 2
    middle = (edges[1:] + edges[:-1])[:, None] / 2
    return (middle + half * unit).ravel(), (half * weights).ravel()


def quintic(s: FloatArray, start: float, end: float, derivative: int = 0) -> FloatArray:
    """Evaluate the shape functions of bending, or one of their derivatives.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Coordinates [m].
    start, end : float
        Ends of the element [m].
    derivative : int
        Order of the derivative with respect to s.

    Returns
    -------
    ndarray, shape (n, 6)
        v(s) = quintic(s) @ (v_0, v'_0, v_m, v'_m, v_1, v'_1).
    """
    half = (end - start) / 2
    xi = (np.asarray(s) - (start + end) / 2) / half
    powers = polynomial.polyvander(xi, 5) @ _derived(derivative).T
    return powers * np.array([1.0, half] * 3) / half**derivative


def quadratic(s: FloatArray, start: float, end: float, derivative: int = 0) -> FloatArray:
    """Evaluate the quadratic shape functions of start, middle and end; as `quintic`, (n, 3)."""
    half = (end - start) / 2
    xi = (np.asarray(s) - (start + end) / 2) / half
    if derivative == 0:
        return np.stack([xi * (xi - 1) / 2, 1 - xi**2, xi * (xi + 1) / 2], axis=1)
    return np.stack([xi - 0.5, -2 * xi, xi + 0.5], axis=1) / half


def weighted(shapes: FloatArray, density: FloatArray) -> FloatArray:
    """∫ density NᵀN ds as a sum over points: shapes (n, k), density × weights (n,) → (k, k)."""
    return (shapes.T * density) @ shapes


@cache
def _legendre() -> tuple[FloatArray, FloatArray]:
    points, weights = np.polynomial.legendre.leggauss(POINTS)
    return points, weights


@cache
def _derived(order: int) -> FloatArray:
    """(6, 6): row k the polynomial coefficients of shape function k, differentiated."""
    rows = []
    for xi in (-1.0, 0.0, 1.0):
        rows.append([xi**n for n in range(6)])
        rows.append([n * xi ** (n - 1) if n else 0.0 for n in range(6)])
    basis = np.linalg.inv(np.array(rows)).T
    derived = np.zeros((6, 6))
    for k, coefficients in enumerate(basis):
        own = polynomial.polyder(coefficients, order) if order else coefficients
        derived[k, : len(own)] = own
    return derived
