"""A stiffness that is not the same in every window: it wanders, or rides with the water.

The posterior of all windows is one of their mean stiffness. What is asked for is the stiffness now,
x_t. With y_t a window's ln f (the model's dependence on the water level taken out) and a bar for
means over the windows before it,

    y_t − ȳ = S (x_t − x̄) + ε,   ε ~ N(0, σ_t² + 1/n),   x_t = (walk)_t + α l_t

Residuals from the mean of what was before are independent of each other, so that a Kalman filter of
six numbers, u_t = (walk)_t − (its mean before t) and α, is exact:

    u_{t+1} = (1 − γ_t) u_t + N(0, q²),   γ_t = the share of window t in all windows until t

    now, from the mean of all:   x_t − x̄_t = (1 − γ_t) u_t + α (l_t − l̄_t)

γ is exact where every window sees the same modes. How fast it walks, q, and whether it rides with
the water are not known: a few answers run side by side, each weighted by how well it has predicted
the last hundred windows or so. Where nothing moves, q = 0 and α = 0 win and nothing is added.

Sources: West and Harrison (1997), Bayesian Forecasting and Dynamic Models, ch. 12 (several models
at once); Raftery, Kárný and Ettler (2010), Technometrics 52 (forgetting of their evidence).
"""

from dataclasses import dataclass, field

import numpy as np

from pipeline.updating.change.sufficient_statistics import (
    CUT,
    UNCUT_MOMENTS,
    ChangeSums,
    Seen,
    Sensitivities,
    WatchedWindow,
    reduced_moments,
)
from sensors.arrays import FloatArray

DRIFT_STEPS = np.repeat([0.0, 0.0005, 0.002, 0.008], 2)  # q, a window of weight 1 [-]
RIDES = np.tile([False, True], 4)
EXPECTED = np.log(np.repeat([0.7, 0.1, 0.1, 0.1], 2) / 2)  # log probability beforehand
RIDE_TOGETHER = 0.015  # standard deviation of α that all springs share [1/m]
RIDE_APART = 0.005  # and of each spring's own [1/m]
COMPARED_WINDOWS = 100.0  # windows over which the answers are compared
WALKED = DRIFT_STEPS[:, None, None] ** 2 * np.diag(
    [1.0, 1.0, 1.0, 0.0, 0.0, 0.0]
)  # a window's noise


def _at_rest() -> FloatArray:
    """(H, 6, 6) no deviation; α as expected beforehand where it rides."""
    covariance = np.zeros((len(DRIFT_STEPS), 6, 6))
    ride = RIDE_TOGETHER**2 * np.ones((3, 3)) + RIDE_APART**2 * np.eye(3)
    covariance[RIDES, 3:, 3:] = ride
    return covariance


@dataclass(frozen=True, slots=True, eq=False)
class WalkState:
    """Every answer's filter: the walk's deviation from its mean, and α [1/m]."""

    means: FloatArray = field(default_factory=lambda: np.zeros((len(DRIFT_STEPS), 6)))
    covariances: FloatArray = field(default_factory=_at_rest)
    """(H, 6, 6)."""
    evidence: FloatArray = field(default_factory=lambda: np.zeros(len(DRIFT_STEPS)))
    """(H,) log."""
    level: float = 0.0
    """Of the last window, from the mean of all [m]."""


@dataclass(frozen=True, slots=True, eq=False)
class Mixture:
    """Of Gaussians in d numbers."""

    weights: FloatArray
    """(H,) of sum 1."""
    means: FloatArray
    """(H, d)."""
    covariances: FloatArray
    """(H, d, d)."""

    @property
    def mean(self) -> FloatArray:
        """(d,)"""
        return np.asarray(self.weights @ self.means)

    @property
    def covariance(self) -> FloatArray:
        """(d, d)"""
        apart = self.means - self.mean
        within = self.weights @ self.covariances.reshape(len(self.weights), -1)
        between = (self.weights * apart.T) @ apart
        return np.asarray(within.reshape(between.shape) + between)

    def draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, d)"""
        which = generator.choice(len(self.weights), size=n, p=self.weights)
        values, axes = np.linalg.eigh(self.covariances)
        roots = axes * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        unit = generator.standard_normal((n, self.means.shape[1]))
        return np.asarray(self.means[which] + np.einsum("nab,nb->na", roots[which], unit))


def deviation(state: WalkState) -> Mixture:
    """The stiffness of the last window less the mean of all, in ratios k / nominal; d = 3."""
    turn = np.hstack([np.eye(3), state.level * np.eye(3)])
    return Mixture(
        weights=_weights(state),
        means=state.means @ turn.T,
        covariances=turn @ state.covariances @ turn.T,
    )


def _weights(state: WalkState) -> FloatArray:
    """(H,) probability of every answer."""
    logs = EXPECTED + state.evidence
    weights = np.exp(logs - logs.max())
    return np.asarray(weights / weights.sum())


def kalman_step(
    state: WalkState,
    sums: ChangeSums,
    window: WatchedWindow,
    observed: Seen,
    sensitivities: Sensitivities,
) -> WalkState:
    """The filters after one more window.

    Parameters
    ----------
    state : WalkState
        After the window before.
    sums : ChangeSums
        Of the windows before it.
    window : WatchedWindow
        The next one.
    observed : Seen
        The window by the sums' columns.
    sensitivities : Sensitivities
        Of the sums' tracks.
    """
    covariances = state.covariances + window.weight * WALKED
    seen, errors, variances, levels = _from_the_mean(sums, window, observed, sensitivities)
    S = sensitivities.stiffness[seen]
    design = np.concatenate([S, S * levels[:, None]], axis=1)  # D, (n_seen, 6)
    expected = Mixture(_weights(state), state.means, covariances)
    errors = _cut(errors, variances, design, expected.mean, expected.covariance)
    means, covariances, gained = _filtered(state.means, covariances, design, errors, variances)
    share = window.weight / (window.weight + float(sums.shares.sum()))
    kept = 1 - share
    keep = np.array([kept, kept, kept, 1.0, 1.0, 1.0])
    information, of_level = observed.totals[:2].sum(axis=1)
    mean_level = of_level / information if information > 0 else window.water_level
    return WalkState(
        means=means * keep,
        covariances=covariances * keep * keep[:, None],
        evidence=state.evidence * (1 - window.weight / COMPARED_WINDOWS) + gained,
        level=float(kept * (window.water_level - mean_level)),
    )


def _from_the_mean(
    sums: ChangeSums, window: WatchedWindow, observed: Seen, sensitivities: Sensitivities
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """For every paired track seen before: its column, y − ȳ, the variance of that, l − l̄."""
    totals = observed.totals[:, observed.columns]
    known = (totals[0] > 0) & sensitivities.stiffness[observed.columns].any(axis=1)
    seen, values, totals = observed.columns[known], observed.values[known], totals[:, known]
    slope, curvature = sensitivities.water[seen].T
    level, n = window.water_level, totals[0]
    (moment,) = reduced_moments(totals, sensitivities.water[seen], UNCUT_MOMENTS, 1)
    errors = values - (slope + curvature * level) * level - moment / n
    variances = (observed.variances[known] / window.weight + 1 / n) * sums.scatter_factor[seen]
    return seen, errors, variances, level - totals[1] / n


def _cut(
    errors: FloatArray,
    variances: FloatArray,
    design: FloatArray,
    mean: FloatArray,
    covariance: FloatArray,
) -> FloatArray:
    """The errors, (n,), none beyond three standard deviations of what all answers together expect,
    D m + N(0, D P Dᵀ + variances): the same for every answer, so that they can be compared."""
    predicted = design @ mean
    within = CUT * np.sqrt(variances + ((design @ covariance) * design).sum(axis=1))
    return np.minimum(np.maximum(errors, predicted - within), predicted + within)


def _filtered(
    means: FloatArray,
    covariances: FloatArray,
    design: FloatArray,
    errors: FloatArray,
    variances: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Kalman's step of every answer from errors = D m + N(0, variances), (n,); and each one's log
    probability of these errors up to what they share.

        P' = (1 + P M)⁻¹ P,   m' = m + P' r,   M = Dᵀ V⁻¹ D,   r = Dᵀ V⁻¹ e − M m
        2 log p = rᵀ P' r + 2 mᵀ Dᵀ V⁻¹ e − mᵀ M m − log det(1 + P M)
    """
    scaled = design / variances[:, None]
    information, pulled = design.T @ scaled, errors @ scaled  # M and Dᵀ V⁻¹ e
    inner = np.eye(6) + covariances @ information
    covariances = np.asarray(np.linalg.solve(inner, covariances), dtype=float)
    left = pulled - means @ information  # r, (H, 6)
    moved = (covariances @ left[:, :, None])[:, :, 0]
    logs = (left * moved + means * (pulled + left)).sum(axis=1) - np.linalg.slogdet(inner)[1]
    return means + moved, (covariances + covariances.swapaxes(1, 2)) / 2, 0.5 * logs
