"""Whether the joint posterior predicts what it has not seen, and its figures are believable.

One mode left out, the others predict it: with H the posterior's precision and J_g, D_g the mode's
rows, H_−g = H − J_gᵀ D_g⁻¹ J_g, and

    e = η_g + J_g δ_−g,   cov e = D_g + J_g H_−g⁻¹ J_gᵀ,   χ²_g = eᵀ (cov e)⁻¹ e

in closed form, δ_−g the step that the others alone would take. The discrepancy σ is zero here: a σ
that has been inferred from a misfit explains it.
The figures' posterior mean ẑ has the covariance I − C under the prior, C the posterior's: a figure
with |ẑ_i| / √(1 − C_ii) of four is outside its prior.
Sources: Gelman et al., "Bayesian Data Analysis" (2013), chapter 6; Cook and Weisberg, "Residuals
and Influence in Regression" (1982), for leaving out without fitting again.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc  # scipy.stats takes a third of a second to load

from pipeline.updating.likelihood.mode_errors import ModeErrors
from pipeline.updating.structural.joint_model import JointPeak
from pipeline.updating.structural.prior import N_SPRINGS, JointCoordinates
from sensors.arrays import FloatArray

LEAST_ROOM = 0.02  # 1 − C_ii: below, the data do not constrain a figure [-]
UNPREDICTED = 1e-3  # p-value at which a left-out mode is unpredicted [-]


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutChecks:
    """Each observation predicted by the others."""

    squares: FloatArray
    """(n_observations,) χ²"""
    counts: FloatArray
    """(n_observations,) components"""
    frequency_misfits: FloatArray
    """(n_observations,) of the frequency, identified minus predicted [standard deviations]"""

    @property
    def p_values(self) -> FloatArray:
        """(n_observations,) chance of as large a misfit."""
        return np.asarray(chdtrc(self.counts, self.squares))

    @property
    def unpredicted_share(self) -> float:
        """Of the observations."""
        return float(np.mean(self.p_values < UNPREDICTED))


def held_out_checks(peak: JointPeak, coordinates: JointCoordinates) -> HeldOutChecks:
    """Leave out every observation in turn."""
    found: ModeErrors = peak.comparison
    D = found.variances + found.floors
    weights = found.robust_weights(D) / D
    J = found.jacobian
    H = (J.T * weights) @ J + coordinates.prior_precision
    gradient = J.T @ (weights * found.errors)
    gradient += coordinates.prior_precision @ (peak.u - coordinates.origin)
    squares, counts, misfits = [], [], []
    for group in range(len(found.used)):
        rows = np.flatnonzero(found.groups == group)
        own, w = J[rows], weights[rows]
        without = np.linalg.inv(H - (own.T * w) @ own)
        step = -without @ (gradient - own.T @ (w * found.errors[rows]))
        error = found.errors[rows] + own @ step
        covariance = np.diag(D[rows]) + own @ without @ own.T
        squares.append(float(error @ np.linalg.solve(covariance, error)))
        counts.append(len(rows))
        misfits.append(-error[0] / np.sqrt(covariance[0, 0]))
    return HeldOutChecks(np.array(squares), np.array(counts, dtype=float), np.array(misfits))


@dataclass(frozen=True, slots=True)
class FigureConflict:
    """A figure whose posterior lies where its prior hardly allows."""

    name: str
    deviations: float
    """ẑ / √(1 − C) [prior standard deviations]"""


def figure_conflicts(
    mean: FloatArray, covariance: FloatArray, coordinates: JointCoordinates
) -> tuple[FigureConflict, ...]:
    """Of every figure, level and sensor that the data constrain, the worst first."""
    prior = np.linalg.inv(coordinates.prior_precision)
    names = coordinates.names
    found = []
    for i in range(N_SPRINGS, len(names)):
        room = prior[i, i] - covariance[i, i]
        if room > LEAST_ROOM * prior[i, i]:
            off = (mean[i] - coordinates.origin[i]) / np.sqrt(room)
            found.append(FigureConflict(names[i], float(off)))
    return tuple(sorted(found, key=lambda each: -abs(each.deviations)))
