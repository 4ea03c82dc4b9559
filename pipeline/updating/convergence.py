"""How far a set of Markov chains can be trusted: split R̂, autocorrelation time, effective size.

All three take chains of one quantity as (n_steps, n_chains).
"""

import numpy as np

from pipeline.updating.forward_model import FloatArray


def split_rhat(chains: FloatArray) -> float:
    """Potential scale reduction of the chains cut in halves; 1 when all have the same law.

        R̂² = (n−1)/n + B/(n W),   W mean variance within, B/n variance of the means of the halves

    Source: Gelman et al., Bayesian Data Analysis, 3rd ed., §11.4. NaN for chains under 4 steps.
    """
    halves = _halves(chains)
    half = len(halves)
    if half < 2:
        return float("nan")
    within = halves.var(axis=0, ddof=1).mean()
    between = halves.mean(axis=0).var(ddof=1)
    if within == 0:
        return 1.0 if between == 0 else float("inf")
    return float(np.sqrt((half - 1) / half + between / within))


def autocorrelation_time(chains: FloatArray) -> float:
    """Integrated autocorrelation time τ of the ensemble [steps], at least 1.

        τ = 1 + 2 Σ_t ρ_t,   ρ_t = 1 − (W − mean over chains of the lag-t covariance) / V

    with V the pooled variance, so that chains that have not met count as correlated, and each chain
    cut in halves, so that a drift counts too; the sum runs while pairs ρ_2k + ρ_2k+1 are positive,
    made monotone.
    Source: Geyer (1992), Statistical Science 7; Vehtari et al. (2021), Bayesian Analysis 16.
    """
    if len(chains) < 8:
        return float("nan")
    halves = _halves(chains)
    n_steps = len(halves)
    covariances = _lag_covariances(halves).mean(axis=1)
    within = covariances[0] * n_steps / (n_steps - 1)
    pooled = covariances[0] + halves.mean(axis=0).var(ddof=1)
    if pooled == 0:
        return float("inf")
    correlations = 1 - (within - covariances) / pooled
    correlations[0] = 1.0
    pairs = correlations[: 2 * (n_steps // 2)].reshape(-1, 2).sum(axis=1)
    first_negative = int(np.argmax(pairs <= 0)) if np.any(pairs <= 0) else len(pairs)
    positive = np.minimum.accumulate(pairs[:first_negative])
    return float(max(2 * positive.sum() - 1, 1.0))


def effective_sample_size(chains: FloatArray) -> float:
    """Independent draws that would say as much about the mean: n_steps · n_chains / τ."""
    return chains.size / autocorrelation_time(chains)


def _halves(chains: FloatArray) -> FloatArray:
    """(n_steps // 2, 2 n_chains) the first and the second half of every chain."""
    half = len(chains) // 2
    return np.hstack([chains[:half], chains[len(chains) - half :]])


def _lag_covariances(chains: FloatArray) -> FloatArray:
    """(n_steps, n_chains) biased autocovariances of each chain about its own mean."""
    n_steps = len(chains)
    spectrum = np.fft.rfft(chains - chains.mean(axis=0), n=2 * n_steps, axis=0)
    return np.fft.irfft(np.abs(spectrum) ** 2, axis=0)[:n_steps] / n_steps
