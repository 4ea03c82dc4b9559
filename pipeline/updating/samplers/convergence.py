"""How far a set of Markov chains can be trusted: split R̂, autocorrelation time, effective size.

All three take chains of one quantity as (n_steps, n_chains), and are ArviZ's, with what it leaves
open decided: chains that never moved, and such as are too short to be judged.

Source: Vehtari et al. (2021), Bayesian Analysis 16, 667.
"""

from typing import Any

import numpy as np

from sensors.arrays import FloatArray

FEWEST_STEPS = 8  # two halves of four, below which ArviZ has no answer


def split_rhat(chains: FloatArray) -> float:
    """Potential scale reduction R̂ of the ranks of the chains cut in halves; 1 when all have the
    same law, NaN for chains under eight steps."""
    if len(chains) < FEWEST_STEPS:
        return float("nan")
    if _frozen(chains):
        return float("inf")
    return float(_array_stats().rhat(chains, chain_axis=1, draw_axis=0, method="rank"))


def autocorrelation_time(chains: FloatArray) -> float:
    """Integrated autocorrelation time τ of the ensemble [steps], at least 1: draws for each
    effective one. Chains that have not met, or drift, count as correlated."""
    return max(chains.size / effective_sample_size(chains), 1.0)


def effective_sample_size(chains: FloatArray) -> float:
    """Independent draws with as much information about the mean; NaN for chains under eight steps,
    one a chain for such as never moved."""
    if len(chains) < FEWEST_STEPS:
        return float("nan")
    if _frozen(chains):
        return float(chains.shape[1])
    return float(_array_stats().ess(chains, chain_axis=1, draw_axis=0, method="mean"))


def _frozen(chains: FloatArray) -> bool:
    return not np.any(chains != chains[0])


def _array_stats() -> Any:
    """ArviZ's functions of plain arrays, imported by who samples: a tower unit never does."""
    from arviz_stats.base.array import array_stats

    return array_stats
