"""Two periods share most of what is systematically wrong with a mode."""

from dataclasses import replace
from typing import Any, cast

import numpy as np

from pipeline.updating.structural.periods.joint_periods import Period, _by_component
from tests.pipeline.updating.structural.comparisons import comparison


def test_nine_tenths_of_a_modes_systematic_error_cancel_between_two_periods() -> None:
    """The variance of the difference is that of both windows and a tenth of both floors."""
    n_dim = 5
    both = (comparison(1, n_dim), comparison(1, n_dim))
    periods = [Period(cast(Any, None), np.arange(n_dim)) for _ in both]
    parts = _by_component(both, periods, n_dim, 0.0, 1.0)
    assert len(parts) == len(both[0].errors)
    apart = np.array([-1.0, 1.0])
    difference = [apart @ np.linalg.inv(information) @ apart for _, _, information in parts]
    np.testing.assert_allclose(difference, 2 * (both[0].variances + 0.1 * both[0].floors))


def test_a_mode_that_one_period_alone_has_shares_nothing() -> None:
    n_dim = 5
    both = (comparison(1, n_dim), comparison(1, n_dim, tracks=(3, 4, 5)))
    periods = [Period(cast(Any, None), np.arange(n_dim)) for _ in both]
    parts = _by_component(both, periods, n_dim, 0.0, 1.0)
    assert [information.shape for _, _, information in parts] == [(1, 1)] * 18


def test_what_both_have_in_common_counts_less_beside_data_with_the_same_floors() -> None:
    """The difference is as sure as before, the mean less so."""
    n_dim = 5
    both = (comparison(1, n_dim), comparison(1, n_dim))
    periods = [Period(cast(Any, None), np.arange(n_dim)) for _ in both]
    once, four = (_by_component(both, periods, n_dim, 0.0, c) for c in (1.0, 4.0))
    apart, together = np.array([-1.0, 1.0]), np.array([0.5, 0.5])
    for direction, more in ((apart, 0.0), (together, 3 * 0.9)):
        before, after = (
            [direction @ np.linalg.inv(part[2]) @ direction for part in parts]
            for parts in (once, four)
        )
        expected = np.array(before) + more * both[0].floors
        np.testing.assert_allclose(after, expected, rtol=1e-9)


def test_what_both_periods_miss_alike_says_no_less_of_the_difference_between_them() -> None:
    """A mode that the model has ten standard deviations off, before and now."""
    n_dim = 5
    first, second = comparison(1, n_dim), comparison(1, n_dim)
    missed = 10 * np.sqrt(first.variances + first.floors)
    off = [replace(each, errors=each.errors + missed) for each in (first, second)]
    periods = [Period(cast(Any, None), np.arange(n_dim)) for _ in off]
    apart, together = np.array([-1.0, 1.0]), np.array([0.5, 0.5])
    near, far = (_by_component(each, periods, n_dim, 0.0, 1.0) for each in ((first, second), off))
    for before, after in zip(near, far, strict=True):
        np.testing.assert_allclose(
            apart @ np.linalg.inv(after[2]) @ apart, apart @ np.linalg.inv(before[2]) @ apart
        )
        assert (
            together @ np.linalg.inv(after[2]) @ together
            > 3 * together @ np.linalg.inv(before[2]) @ together
        )


def test_a_period_that_departs_from_the_others_counts_less() -> None:
    """One of three took another mode for this one."""
    n_dim = 5
    three = [comparison(1, n_dim) for _ in range(3)]
    three[2] = replace(three[2], errors=three[2].errors + 10 * np.sqrt(three[2].variances))
    periods = [Period(cast(Any, None), np.arange(n_dim)) for _ in three]
    for _, _, information in _by_component(three, periods, n_dim, 0.0, 1.0):
        covariance = np.linalg.inv(information)
        assert covariance[2, 2] - covariance[0, 0] > 5 * (covariance[0, 0] - covariance[0, 1])
        np.testing.assert_allclose(covariance[0, 1], covariance[1, 2])
