"""Lag covariances and the block Hankel matrix."""

import numpy as np
import pytest

from pipeline.oma.ssi.ssi_cov import block_hankel, lag_covariances, lagged_products


def samples(n: int = 500, n_channels: int = 3, seed: int = 4) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((n, n_channels))


def test_lag_covariances_are_the_sums_of_their_definition() -> None:
    y = samples()
    covariances = lag_covariances(y, n_lags=20, block_length=40)
    here = y[:480]
    scales = np.sqrt(np.mean(here**2, axis=0))
    np.testing.assert_allclose(covariances.scales, scales)
    for lag in (1, 7, 20):
        expected = y[lag : 480 + lag].T @ here / 480 / np.outer(scales, scales)
        np.testing.assert_allclose(covariances.mean[lag - 1], expected, atol=1e-13)


def test_block_mean_is_the_covariance_of_one_long_block() -> None:
    y = samples(n=20 + 12 * 40)
    by_block = lag_covariances(y, n_lags=20, block_length=40).mean
    at_once = lag_covariances(y, n_lags=20, block_length=240).mean
    np.testing.assert_allclose(by_block, at_once, atol=1e-13)


def test_reference_channels_are_columns_of_the_full_covariances() -> None:
    y = samples()
    full = lag_covariances(y, n_lags=20, block_length=40)
    reduced = lag_covariances(y, n_lags=20, block_length=40, references=np.array([2, 0]))
    np.testing.assert_allclose(reduced.blocks, full.blocks[..., [2, 0]], atol=1e-13)
    np.testing.assert_array_equal(reduced.scales, full.scales)


def test_hankel_block_i_j_is_the_covariance_of_lag_i_plus_j_plus_one() -> None:
    covariances = samples(n=10 * 3).reshape(10, 3, 3)
    hankel = block_hankel(covariances, block_rows=5)
    assert hankel.shape == (18, 15)
    np.testing.assert_array_equal(hankel[6:9, 9:12], covariances[2 + 3])


def test_deviations_give_the_variance_of_the_mean() -> None:
    """White noise of variance 1: the covariance of two channels over m samples has variance 1/m."""
    variances = []
    for seed in range(40):
        y = samples(n=1 + 40 * 25, n_channels=2, seed=seed)
        deviations = lag_covariances(y, n_lags=1, block_length=25).deviations
        variances.append(np.sum(deviations[:, 0, 0, 1] ** 2))
    assert np.mean(variances) == pytest.approx(1 / 1000, rel=0.15)


@pytest.mark.parametrize(("n_lags", "block_length"), [(1, 1), (20, 7), (20, 40), (7, 100)])
def test_segments_of_any_number_add_up_to_the_block(n_lags: int, block_length: int) -> None:
    y = samples(n=block_length + n_lags)
    products = lagged_products(y, n_lags) / block_length
    for lag in range(n_lags + 1):
        expected = y[lag : lag + block_length].T @ y[:block_length] / block_length
        np.testing.assert_allclose(products[lag], expected, atol=1e-13)


def test_a_record_shorter_than_its_blocks_is_refused() -> None:
    with pytest.raises(ValueError, match="too few"):
        lag_covariances(samples(n=30), n_lags=20, block_length=12)


@pytest.mark.parametrize("n_blocks", [2, 5, 40])
def test_deviations_add_up_to_the_unbiased_variance_of_the_mean(n_blocks: int) -> None:
    """Bessel's n − 1: with few blocks, n instead makes every standard deviation too small."""
    covariances = lag_covariances(samples(n=3 + n_blocks * 20), n_lags=3, block_length=20)
    of_mean = covariances.blocks.var(axis=0, ddof=1) / n_blocks
    np.testing.assert_allclose(np.sum(covariances.deviations**2, axis=0), of_mean, rtol=1e-10)
