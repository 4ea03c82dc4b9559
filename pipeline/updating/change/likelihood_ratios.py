"""Likelihood ratios of a change against none, for every window that it may have begun with.

Modal drift: some modes have shifted, for whatever reason. Each mode is taken to have shifted with
chance p, by a step of its own, δ_j ~ N(0, τ²):

    LR = Π_j (1 − p + p L(g_j, h_j; τ²)),   mixed over τ and p

p = 1 / J looks for one mode alone, p = 1 for all of them, what lies between for a family of them.

A change of the foundation: three springs that explain the steps of all modes.

    δ_j = S_jᵀ κ,   S = ∂ ln f / ∂ (k / nominal),   κ ~ N(0, τ² 1)

With G = Σ_j g_j S_j and H = Σ_j h_j S_j S_jᵀ the likelihood ratio is

    LR = det(1 + τ² H)^(−½) exp(½ Gᵀ (H + 1/τ²)⁻¹ G),   mixed over τ
"""

from dataclasses import dataclass

import numpy as np

from pipeline.updating.change.sufficient_statistics import Sensitivities, Steps
from sensors.arrays import FloatArray

SHIFTS = np.array([0.001, 0.004, 0.016])  # τ of ln f [-]
FAMILY = 0.25  # p of a family of modes [-]
LARGEST_LOG_RATIO = (
    300.0  # log L of one mode, beyond which exp overflows and 1 − p is nothing beside it
)
STIFFNESS_SHIFTS = np.array([0.01, 0.05, 0.2])  # τ of the ratios k / nominal [-]
UPPER = np.triu_indices(3)  # (0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)
UNIT_DIRECTIONS = np.eye(3)[UPPER][:, None, None]
ITERATIONS = 10  # of least squares
TAIL_DEGREES = 4  # ν of Student's t


def log_step(g: FloatArray, h: FloatArray, variances: FloatArray) -> FloatArray:
    """(n_variances, …) log L of steps of these variances τ² against none, from g, h, (…):

    log L = ½ g² τ² / (1 + τ²h) − ½ log(1 + τ²h)
    """
    size = variances.reshape(-1, *(1,) * g.ndim)
    growth = 1 + size * h
    return np.asarray(0.5 * (g**2 * size / growth - np.log(growth)))


def log_sum(logs: FloatArray) -> FloatArray:
    """log Σ exp over the first axis; ten times faster than SciPy's on arrays this small."""
    highest = logs.max(axis=0)
    return np.asarray(highest + np.log(np.exp(logs - highest).sum(axis=0)))


def log_mean(logs: FloatArray) -> FloatArray:
    """log of the mean over the first axis."""
    return log_sum(logs) - np.log(len(logs))


def log_drift(steps: Steps) -> FloatArray:
    """(K,) log likelihood ratio of a modal drift that began with each candidate."""
    each = log_step(steps.g, steps.h, SHIFTS**2)  # (n_τ, K, J); 0 of a mode not seen before
    ratios = np.exp(np.minimum(each, LARGEST_LOG_RATIO))
    beyond = (
        np.maximum(each - LARGEST_LOG_RATIO, 0.0).sum(axis=2)
        if each.max(initial=0) > LARGEST_LOG_RATIO
        else 0.0
    )
    shares = (1 / max(int(np.count_nonzero(steps.h.any(axis=0))), 1), FAMILY)
    some = [np.log(p * ratios + (1 - p)).sum(axis=2) + beyond for p in shares]
    return log_mean(np.concatenate([each.sum(axis=2), *some]))


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessStep:
    """By how much the springs have changed."""

    ratios: FloatArray
    """κ, (3,) change of k / nominal [-]."""
    covariance: FloatArray
    """(3, 3)."""


def log_foundation(steps: Steps, stiffness: FloatArray) -> FloatArray:
    """(K,) log likelihood ratio of a change of stiffness that began with each candidate.

    Parameters
    ----------
    steps : Steps
        Of all candidates, (K, J).
    stiffness : ndarray, shape (J, 3)
        S = ∂ ln f / ∂ (k / nominal) [-].
    """
    gradient = (steps.g @ stiffness).T  # G, (3, K)
    hessian = (steps.h @ (stiffness[:, UPPER[0]] * stiffness[:, UPPER[1]])).T  # (6, K)
    size = (STIFFNESS_SHIFTS**2)[:, None]
    determinant, square = _solved(hessian[:, None] * size + UNIT_DIRECTIONS, gradient)
    return log_mean(0.5 * (size * square - np.log(determinant)))


def _solved(matrix: FloatArray, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
    """det M and vᵀ M⁻¹ v of symmetric positive 3 × 3 matrices by M = L D Lᵀ written out: for
    hundreds so small many times faster than a library's decomposition.

    matrix   the six entries of the upper triangle by rows, (6, …);  vector   v, (3, …)
    """
    a, b, c, d, e, f = matrix
    x, y, z = vector
    second, third = b / a, c / a  # of L's first column
    d, e, f = d - b * second, e - c * second, f - c * third
    y, z = y - second * x, z - third * x
    below = e / d
    f, z = f - e * below, z - below * y
    return a * d * f, x * x / a + y * y / d + z * z / f


def stiffness_step(step: Steps, known: Sensitivities) -> StiffnessStep:
    """κ and its covariance from one candidate's steps, (1, J).

    Parameters
    ----------
    step : Steps
        Of one candidate.
    known : Sensitivities
        Of the same tracks.

    Notes
    -----
    Iterated least squares with the weights of Student's t: one mode that jumped to its sister
    must not be read as a stiffness. Slopes of a rough model have an error, so that each step
    has one of its size. A level that follows from the modes is found with κ: what it took of the
    change is as uncertain as the level is.
    """
    g, h, slopes = step.g[0], step.h[0], known.slopes
    weights = np.ones(len(g))
    for _ in range(ITERATIONS):
        hessian = (slopes.T * (weights * h)) @ slopes + known.precision(STIFFNESS_SHIFTS[-1])
        found = np.linalg.solve(hessian, slopes.T @ (weights * g))
        sure = 1 / (1 + h * (known.half_way_error * (known.stiffness @ found[:3])) ** 2)
        squares = np.divide(
            (g - h * (slopes @ found)) ** 2 * sure, h, out=np.zeros_like(h), where=h > 0
        )
        weights = sure * (TAIL_DEGREES + 1) / (TAIL_DEGREES + squares)
    return StiffnessStep(found[:3], np.asarray(np.linalg.inv(hessian))[:3, :3])
