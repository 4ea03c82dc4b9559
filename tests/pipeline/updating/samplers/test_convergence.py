"""Figures that say how far chains can be trusted, against processes whose answer is known."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pipeline.updating.samplers.convergence import (
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
    assert autocorrelation_time(frozen) == 100
    assert split_rhat(frozen) == float("inf")


def test_chains_too_short_to_be_judged_say_so():
    short = np.random.default_rng(5).standard_normal((7, 20))
    assert np.isnan(split_rhat(short))
    assert np.isnan(autocorrelation_time(short))
    assert np.isnan(effective_sample_size(short))
