"""What one window says of a mode, and of two modes that it could not tell apart."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import ModalEstimate, Mode
from pipeline.updating.evidence.observations import ModeObservation, condensed, mode_observations

SHAPE = np.array([1.0, 0.5])


def member(frequency: float, *, common: float, own: float) -> Mode:
    """One of a pair: std of what both share, and of what is its own."""
    factor = np.zeros((4, 2))
    factor[0] = common, own
    factor[1, 0], factor[3, 0] = 1e-3, 0.01
    std = float(np.hypot(common, own))
    return Mode("m", frequency, std, 0.01, 1e-3, SHAPE, factor, 1, pair_id="pair")


def mean_of(*modes: Mode):
    estimate = ModalEstimate("t1", 0, 0, 600, "layout", ("a", "b"), modes)
    (seen,) = mode_observations(estimate, ("a", "b"))
    return seen


def test_the_mean_of_two_independent_frequencies_is_known_root_two_times_better() -> None:
    seen = mean_of(member(1.0, common=0.0, own=3e-3), member(1.01, common=0.0, own=3e-3))
    assert seen.close_pair
    assert seen.frequency == pytest.approx(1.005)
    assert np.linalg.norm(seen.factor[0]) == pytest.approx(3e-3 / np.sqrt(2))


def test_what_both_share_is_not_averaged_away() -> None:
    seen = mean_of(member(1.0, common=2e-3, own=0.0), member(1.01, common=2e-3, own=0.0))
    assert np.linalg.norm(seen.factor[0]) == pytest.approx(2e-3)


def test_errors_of_opposite_sign_leave_the_mean_alone() -> None:
    one, other = member(1.0, common=2e-3, own=0.0), member(1.01, common=-2e-3, own=0.0)
    assert np.linalg.norm(mean_of(one, other).factor[0]) == pytest.approx(0, abs=1e-18)


def test_the_pair_says_nothing_of_a_shape() -> None:
    seen = mean_of(member(1.0, common=1e-3, own=0.0), member(1.01, common=1e-3, own=0.0))
    assert np.isnan(seen.shape).all()
    assert not seen.factor[1:].any()


def test_modes_apart_stay_two() -> None:
    one, other = (replace(member(f, common=1e-3, own=0.0), pair_id="") for f in (1.0, 1.4))
    estimate = ModalEstimate("t1", 0, 0, 600, "layout", ("b", "a"), (one, other))
    seen = mode_observations(estimate, ("a", "b"))
    assert [each.frequency for each in seen] == [1.0, 1.4]
    assert list(seen[0].shape) == [0.5, 1.0]  # in the layout's order


def test_a_condensed_covariance_stays_one_where_the_shape_is_normalised_otherwise() -> None:
    """Standard deviations in one column were errors that go together: they cancelled."""
    generator = np.random.default_rng(3)
    factor = generator.normal(scale=0.02, size=(6, 40))
    factor[[2, 5]] = 0.0  # of the largest component, and of a channel that is absent
    values = np.array([1.7, 0.99, 1.0, 0.9, 0.5, np.nan])
    whole = ModeObservation("m", values, factor, 40)
    kept = condensed(whole)
    assert kept.factor.shape[1] <= 6
    for one, other in ((whole, kept), (whole.normalised_to(0), kept.normalised_to(0))):
        np.testing.assert_allclose(
            other.factor @ other.factor.T, one.factor @ one.factor.T, atol=1e-15
        )
        np.testing.assert_array_equal(other.factor.any(axis=1), one.factor.any(axis=1))
