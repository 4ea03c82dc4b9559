"""Modal drift: some modes have shifted, for whatever reason.

Each mode is taken to have shifted with chance p, by a step of its own, δ_j ~ N(0, τ²):

    LR = Π_j (1 − p + p L(g_j, h_j; τ²)),   mixed over τ and p

p = 1 / J looks for one mode alone, p = 1 for all of them, what lies between for a family of them.
"""

import numpy as np

from pipeline.updating.change.likelihood_ratio import log_mean, log_step
from pipeline.updating.change.sufficient_statistics import Steps
from sensors.arrays import FloatArray

SHIFTS = np.array([0.001, 0.004, 0.016])  # τ of ln f [-]
FAMILY = 0.25  # p of a family of modes [-]
LARGEST_LOG_RATIO = (
    300.0  # log L of one mode, beyond which exp overflows and 1 − p is nothing beside it
)


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
