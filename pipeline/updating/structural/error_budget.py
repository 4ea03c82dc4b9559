"""Which figure makes how much of a spring's interval.

The variance of ln k that a figure brings is what would vanish if it were known,

    share_i = C_ki² / (C_ii C_kk),

the squared correlation of the joint posterior; shares of correlated figures overlap and are scaled
to the part that figures make together, 1 − var(ln k | all figures) / var(ln k). And by how much a
spring moves with a figure of the prior that the data cannot see: ∂ ln k / ∂ z = C_ki / C_ii.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.updating.structural.prior import N_SPRINGS, JointCoordinates
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class ErrorBudget:
    """Shares and slopes by figure."""

    names: tuple[str, ...]
    """(n,) of the figures, the level and the sensors' figures; last "measurement": the rest"""
    shares: FloatArray
    """(n, 3) of the variance of ln k11, ln k22, ln k12, of sum 1 over n [-]"""
    slopes: FloatArray
    """(n, 3) change of ln k by one posterior standard deviation of the figure [-]"""


def error_budget(
    u: FloatArray, covariance: FloatArray, coordinates: JointCoordinates
) -> ErrorBudget:
    """The budget about a peak u with the joint covariance."""
    theta = coordinates.springs(u)
    logs = coordinates.slopes(u)[:N_SPRINGS, :N_SPRINGS] / theta[:, None]  # d ln θ / d u
    rows = np.zeros((N_SPRINGS, len(u)))
    rows[:, :N_SPRINGS] = logs
    total = np.einsum("ki,ij,kj->k", rows, covariance, rows)
    cross = rows @ covariance  # (3, n_dim)
    figures = np.arange(N_SPRINGS, len(u))
    stds = np.sqrt(np.diag(covariance)[figures])
    slopes = (cross[:, figures] / stds).T
    alone = (slopes**2 / total).clip(0.0, 1.0)
    inner = covariance[np.ix_(figures, figures)]
    explained = np.einsum("ki,ki->k", cross[:, figures] @ np.linalg.inv(inner), cross[:, figures])
    explained = np.clip(explained / total, 0.0, 1.0)
    shares = alone / np.maximum(alone.sum(axis=0), 1e-300) * explained
    return ErrorBudget(
        names=(*coordinates.names[N_SPRINGS:], "measurement"),
        shares=np.vstack([shares, 1 - explained]),
        slopes=np.vstack([slopes, np.sqrt((1 - explained) * total)]),
    )
