"""A kept estimate has the covariances of the estimate, at a tenth of its size."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.archive.compact import kept_estimate, restored_estimate, triangular
from pipeline.messages import ModalEstimate, Mode
from pipeline.transport.codec import encode
from pipeline.updating.evidence.observations import mode_observations

CHANNELS = tuple(f"channel {i + 1}" for i in range(8))


def mode(generator: np.random.Generator, frequency: float, pair: str = "") -> Mode:
    shape = generator.uniform(-0.9, 0.9, 8)
    shape[3] = 1.0
    factor = 1e-3 * generator.standard_normal((10, 42))
    factor[5] = 0.0  # the unit component
    std = float(np.linalg.norm(factor[0]))
    return Mode("", frequency, std, 0.01, 0.001, shape, factor, 40, pair_id=pair)


@pytest.fixture
def estimate() -> ModalEstimate:
    generator = np.random.default_rng(8)
    modes = [mode(generator, 0.2 + 0.3 * i, "p" if i in (4, 6) else "") for i in range(40)]
    return ModalEstimate("t", 3, 0, 600 * 10**9, "l", CHANNELS, tuple(modes), weight=0.5)


def test_a_kept_estimate_has_the_covariance_of_each_mode(estimate: ModalEstimate) -> None:
    restored = restored_estimate(kept_estimate(estimate))

    assert replace(restored, modes=()).window == estimate.window
    for ours, theirs in zip(restored.modes, estimate.modes, strict=True):
        scale = np.sqrt(np.outer(np.diag(theirs.covariance), np.diag(theirs.covariance)))
        assert np.all(np.abs(ours.covariance - theirs.covariance) <= 1e-6 * scale)
        assert np.array_equal(ours.shape, theirs.shape)
        assert ours.shape_std[3] == 0.0  # exactly: it is known
        assert (ours.frequency, ours.frequency_std) == (theirs.frequency, theirs.frequency_std)
        assert ours.n_block_columns == theirs.n_block_columns


@pytest.mark.parametrize("n_common", [0, 7, 40])
def test_a_close_pair_is_seen_as_before(estimate: ModalEstimate, n_common: int) -> None:
    """The variance of its mean frequency needs the covariance between its members, and how sure
    that variance is the number of blocks that it was estimated from; 0 where it was not."""
    modes = [replace(mode, n_block_columns=n_common) for mode in estimate.modes]
    estimate = replace(estimate, modes=tuple(modes))
    (before,) = [each for each in mode_observations(estimate, CHANNELS) if each.close_pair]
    (after,) = [
        each
        for each in mode_observations(restored_estimate(kept_estimate(estimate)), CHANNELS)
        if each.close_pair
    ]

    assert np.linalg.norm(after.factor[0]) == pytest.approx(np.linalg.norm(before.factor[0]), 1e-6)
    assert after.n_blocks == before.n_blocks == n_common


def test_a_kept_estimate_is_a_seventh_of_what_is_sent(estimate: ModalEstimate) -> None:
    assert len(kept_estimate(estimate)) < len(encode(estimate)) / 7
    assert len(kept_estimate(estimate)) < 18_000


def test_what_is_kept_again_stays_as_it_is(estimate: ModalEstimate) -> None:
    """The signs of a triangle's columns are free; its covariances are not."""
    once = restored_estimate(kept_estimate(estimate))
    twice = restored_estimate(kept_estimate(once))

    for ours, theirs in zip(once.modes, twice.modes, strict=True):
        np.testing.assert_allclose(ours.covariance, theirs.covariance, rtol=1e-5, atol=1e-13)


def test_fewer_columns_than_rows_are_kept() -> None:
    factor = np.arange(20.0).reshape(10, 2)
    factor[4] = 0.0

    lower = triangular(factor)

    np.testing.assert_allclose(lower @ lower.T, factor @ factor.T, atol=1e-12)
    assert np.allclose(lower, np.tril(lower))
