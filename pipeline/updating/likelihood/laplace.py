"""The peak of the posterior and the curvature there: where chains start, never the answer."""

import numpy as np

from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import ModalLikelihood
from pipeline.updating.likelihood.pairing import DIFFERENCE, STEP_LENGTHS
from pipeline.updating.prior import Prior
from pipeline.updating.samplers.interface import Peak
from sensors.arrays import FloatArray

GAUSS_NEWTON_STEPS = 12  # at most
WIDEST = 1.0  # standard deviation of a ratio beyond which a Gaussian has no information [-]


def laplace_peak(
    likelihood: ModalLikelihood,
    forward: ForwardModel,
    prior: Prior,
    start: FloatArray,
) -> Peak:
    """Gauss-Newton from start, (3,) ratios, at the σ that is most likely on the way.

    H = Jᵀ Σ(σ)⁻¹ J,   J = dη/dr by differences;   covariance = H⁻¹
    """
    ratios = start
    hessian = np.eye(3)
    for _ in range(GAUSS_NEWTON_STEPS):
        points = ratios + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
        modes = forward.modal(prior.stiffness(points))
        whitened = likelihood.whitened(modes)
        jacobian = (whitened[1:] - whitened[0]).T / DIFFERENCE
        weights = likelihood.weights(whitened[0] ** 2)
        gradient = jacobian.T @ (weights * whitened[0])
        hessian = (jacobian.T * weights) @ jacobian
        if not np.all(np.isfinite(hessian)):
            return Peak(ratios, np.eye(3) * WIDEST**2)
        step = -np.linalg.pinv(hessian, rcond=1e-12) @ gradient
        better = _best_on_line(likelihood, forward, prior, ratios, step)
        if better is None:
            break
        ratios = better
        if np.abs(jacobian @ step).max() < 0.02:
            break
    return Peak(ratios, bounded_inverse(hessian))


def _best_on_line(
    likelihood: ModalLikelihood,
    forward: ForwardModel,
    prior: Prior,
    ratios: FloatArray,
    step: FloatArray,
) -> FloatArray | None:
    """The most likely of a few points along the step; None where standing still is best."""
    trials = np.vstack([ratios, ratios + STEP_LENGTHS[:, None] * step])
    trials = trials[prior.supports(trials)]
    if not len(trials):
        return None
    values = likelihood.log_likelihood(forward.modal(prior.stiffness(trials))).max(axis=1)
    best = int(np.argmax(values))
    return None if np.array_equal(trials[best], ratios) else trials[best]


def bounded_inverse(hessian: FloatArray) -> FloatArray:
    """H⁻¹ with every direction's standard deviation at most WIDEST."""
    values, directions = np.linalg.eigh(hessian)
    variances = 1 / np.maximum(values, 1 / WIDEST**2)
    return (directions * variances) @ directions.T
