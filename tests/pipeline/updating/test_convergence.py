"""Figures that say how far chains can be trusted, against processes whose answer is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pipeline.updating.convergence import (
    autocorrelation_time,
    effective_sample_size,
    split_rhat,
)


def autoregressive(correlation, *, n_steps, n_chains, seed):
    """Stationary AR(1) chains of unit variance, (n_steps, n_chains)."""
    noise = np.random.default_rng(seed).standard_normal((n_steps + 200, n_chains))
    chains = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], noise, axis=0)
    return chains[200:]


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_an_autoregressive_chain_has_its_closed_form_autocorrelation_time(correlation):
    chains = autoregressive(correlation, n_steps=2000, n_chains=40, seed=1)
    expected = (1 + correlation) / (1 - correlation)
    assert autocorrelation_time(chains) == pytest.approx(expected, rel=0.1)


def test_effective_draws_predict_the_scatter_of_the_mean():
    means = [autoregressive(0.8, n_steps=200, n_chains=10, seed=s).mean() for s in range(200)]
    ess = effective_sample_size(autoregressive(0.8, n_steps=200, n_chains=10, seed=0))
    assert np.var(means) == pytest.approx(1 / ess, rel=0.35)


def test_chains_of_one_law_have_an_rhat_of_one():
    chains = np.random.default_rng(2).standard_normal((500, 20))
    assert split_rhat(chains) == pytest.approx(1.0, abs=0.01)


def test_a_drift_within_the_chains_shows_although_they_agree_with_each_other():
    chains = np.random.default_rng(3).standard_normal((500, 20))
    assert split_rhat(chains + np.linspace(0, 3, 500)[:, None]) > 1.2


def test_chains_that_have_not_met_count_as_correlated():
    chains = np.random.default_rng(4).standard_normal((500, 20)) + 5.0 * np.arange(20)
    assert split_rhat(chains) > 2
    assert effective_sample_size(chains) < 200


def test_chains_that_never_moved_have_no_effective_draws():
    frozen = np.repeat(np.arange(5.0)[None], 100, axis=0)
    assert effective_sample_size(frozen) < 10
    assert split_rhat(frozen) == float("inf")


@pytest.mark.peer
@pytest.mark.parametrize("correlation", [0.0, 0.7, 0.95])
def test_effective_draws_and_rhat_agree_with_arviz(correlation):
    peer = pytest.importorskip("arviz_stats.base", reason="arviz-stats is not installed")
    chains = autoregressive(correlation, n_steps=1000, n_chains=16, seed=5)
    drifting = chains + np.linspace(0, 1, 1000)[:, None]
    for each in (chains, drifting):
        counted = float(peer.array_stats.ess(each.T, method="mean"))
        assert effective_sample_size(each) == pytest.approx(counted, rel=0.02)
        assert split_rhat(each) == pytest.approx(
            float(peer.array_stats.rhat(each.T, method="split")), abs=1e-6
        )
