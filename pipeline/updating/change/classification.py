"""Was it the foundation? Two explanations of one change weighed against each other.

The alarm counts errors cut, so that a single wild estimate cannot raise it; a change that is large
is cut as well and then no longer looks like what it is. So the kind is judged once, at the most
probable start, on the frequencies as they were. Under a change of the springs each mode may still,
with a very small chance p, have a step of its own: one mode taken for its sister must not acquit
the foundation, and costs it fourteen nats instead of any number. With δ_j = S_jᵀ κ and g, h as in
the package's docstring,

    p(g | κ) / p(g | 0) = Π_j exp(g_j δ_j − ½ h_j δ_j²) (1 − p + p L(g_j − h_j δ_j, h_j; τ_o²))

integrated over κ ~ N(0, τ² 1) by Laplace's approximation around its peak, mixed over τ. A mode that
is paired with none of the model's (its frequency may lie above the model's highest) moves with the
foundation too, by an unknown amount: by τ times what the paired ones are sensitive on average,
up or down. A model's slopes are never exact, so each step along S κ has an error of its own, a
share of δ_j: a large change is not acquitted for being large. Against all this stands the modal
drift, in closed form. Where the level follows from the modes, what it took of the change is unknown
to both: to the foundation it is one coefficient more, of the slopes a; to the drift a step along a,
as large as is likeliest, that its own steps may or may not come on top of.
Source: Kass and Raftery (1995), Journal of the American Statistical Association 90.
"""

from dataclasses import replace
from typing import Literal

import numpy as np

from pipeline.updating.change.likelihood_ratios import (
    ITERATIONS,
    LARGEST_LOG_RATIO,
    SHIFTS,
    STIFFNESS_SHIFTS,
    log_drift,
    log_mean,
    log_step,
)
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import Sensitivities, Steps
from sensors.arrays import FloatArray

ChangeKind = Literal["foundation", "modal-drift", "undecided"]

MISTAKEN = 1e-6  # p of a mode that moves on its own while the foundation changes [-]
PAIRING_MISTAKE = float(SHIFTS[-1])  # τ_o of its ln f [-]


def foundation_probability(step: Steps, known: Sensitivities, settings: ChangeSettings) -> float:
    """That a change was the foundation's, from its steps on frequencies uncut, (1, J) each.

    Parameters
    ----------
    step : Steps
        Of one candidate.
    known : Sensitivities
        Its stiffness is zero for a track that is paired with no mode of the model.
    settings : ChangeSettings
        With π, `foundation_share`.

    Notes
    -----
        P = π E_foundation / (π E_foundation + (1 − π) E_drift),   π = settings.foundation_share
    """
    foundation = log_foundation_with_mistakes(step, known) + np.log(settings.foundation_share)
    drift = log_drift_in_water(step, known) + np.log(1 - settings.foundation_share)
    return float(np.exp(foundation - np.logaddexp(foundation, drift)))


def log_drift_in_water(step: Steps, known: Sensitivities) -> float:
    """log likelihood ratio of a modal drift against none, the level known or not."""
    alone = float(log_drift(step)[0])
    if known.level_std == 0.0:
        return alone
    slope = known.water[:, 0]
    pull, information = float(step.g[0] @ slope), float(step.h[0] @ slope**2)
    risen = pull / (information + known.level_std**-2)
    level = 0.5 * (pull * risen - np.log1p(known.level_std**2 * information))
    rest = replace(step, g=step.g - step.h * slope * risen)
    return float(np.logaddexp(alone, level + log_drift(rest)[0]) - np.log(2))


def kind_of(probability: float, settings: ChangeSettings) -> ChangeKind:
    """What to call a change that is the foundation's with this probability."""
    if probability >= settings.certainty:
        return "foundation"
    if probability <= 1 - settings.certainty:
        return "modal-drift"
    return "undecided"


def log_foundation_with_mistakes(step: Steps, known: Sensitivities) -> float:
    """log likelihood ratio of a change of the springs against none."""
    stiffness = known.stiffness
    g, h, paired = step.g[0], step.h[0], stiffness.any(axis=1)
    if not paired.any():
        return 0.0
    typical = float(np.mean((stiffness[paired] ** 2).sum(axis=1)))  # variance of ln f over τ²
    sizes = [
        _log_integral(g[paired], h[paired], known.of_tracks(np.flatnonzero(paired)), size)
        + _log_unpaired(g[~paired], h[~paired], size**2 * typical)
        for size in STIFFNESS_SHIFTS
    ]
    return float(log_mean(np.array(sizes)))


def _log_unpaired(g: FloatArray, h: FloatArray, variance: float) -> float:
    """The same of modes that move by steps of this variance with the foundation."""
    along, alone = log_step(g, h, np.array([variance, PAIRING_MISTAKE**2]))
    return float(np.logaddexp(np.log1p(-MISTAKEN) + along, np.log(MISTAKEN) + alone).sum())


def _log_integral(g: FloatArray, h: FloatArray, known: Sensitivities, size: float) -> float:
    """log ∫ p(g | κ) / p(g | 0) N(κ; 0, size²) dκ

    The peak by iterated least squares; its weights are what each mode's errors leave of it when
    it may be mistaken.
    """
    weights, slopes, precision = np.ones(len(g)), known.slopes, known.precision(size)
    for _ in range(ITERATIONS):
        hessian = (slopes.T * (weights * h)) @ slopes + precision
        found = np.linalg.solve(hessian, slopes.T @ (weights * g))
        steps = slopes @ found
        rest = g - h * steps
        error = (known.slope_error * (known.stiffness @ found[:3])) ** 2
        along = 0.5 * (rest**2 * error / (1 + h * error) - np.log1p(h * error))
        mistaken = log_step(rest, h, np.array([PAIRING_MISTAKE**2]))[0]
        own = MISTAKEN * np.exp(np.minimum(mistaken - along, LARGEST_LOG_RATIO))
        right = (1 - MISTAKEN) / (1 + error * h)
        weights = (right + own / (1 + PAIRING_MISTAKE**2 * h)) / (1 - MISTAKEN + own)
    logs = (
        g * steps
        - 0.5 * h * steps**2
        + np.logaddexp(np.log(MISTAKEN) + mistaken, np.log1p(-MISTAKEN) + along)
    )
    prior = 0.5 * (np.linalg.slogdet(precision)[1] - found @ precision @ found)
    return float(logs.sum() + prior - 0.5 * np.linalg.slogdet(hessian)[1])
