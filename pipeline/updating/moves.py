"""A proposal fitted to the ensemble itself, for emcee."""

from typing import Any

import emcee
import numpy as np

from pipeline.updating.forward_model import FloatArray

DEGREES_OF_FREEDOM = 5.0  # of the proposal: tails heavy enough to fetch a walker that lags behind


class FittedStudentMove(emcee.moves.RedBlueMove):  # type: ignore[misc]  # emcee has no types
    """Independent draws from a Student-t with mean and covariance of the other half's walkers.

    A Gaussian kernel density of the same walkers (emcee's KDEMove) has light tails: a walker that
    starts further out than its fellows is hardly ever proposed a way back, and stays. The step
    obeys detailed balance because the other half stands still while this one moves
    (Foreman-Mackey et al. 2013, §2).
    """

    def get_proposal(
        self, moving: FloatArray, standing: list[FloatArray], random: np.random.RandomState
    ) -> tuple[FloatArray, FloatArray]:
        """Proposed points, (n, n_dim), and log q(old) − log q(new), (n,). Called by emcee."""
        others = np.concatenate(standing, axis=0)
        mean = others.mean(axis=0)
        factor = np.asarray(np.linalg.cholesky(np.cov(others.T)))
        scale = random.chisquare(DEGREES_OF_FREEDOM, size=len(moving)) / DEGREES_OF_FREEDOM
        normal = random.standard_normal(moving.shape)
        proposed = mean + (normal / np.sqrt(scale)[:, None]) @ factor.T
        return proposed, _log_student(moving, mean, factor) - _log_student(proposed, mean, factor)


def _log_student(points: FloatArray, mean: FloatArray, factor: FloatArray) -> FloatArray:
    """Log density of the multivariate Student-t at points, (n, n_dim), constant dropped."""
    squares = np.asarray(np.linalg.solve(factor, (points - mean).T) ** 2).sum(axis=0)
    return -(DEGREES_OF_FREEDOM + points.shape[1]) / 2 * np.log1p(squares / DEGREES_OF_FREEDOM)


def fitting_moves() -> list[tuple[Any, float]]:
    """Moves with their shares: the Student-t mostly; the kernel density where the density is
    bent; differences of two walkers for one that both proposals have left behind."""
    return [(FittedStudentMove(), 0.7), (emcee.moves.KDEMove(), 0.25), (emcee.moves.DEMove(), 0.05)]
