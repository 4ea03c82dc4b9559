"""Two periods share most of what is systematically wrong with a mode."""

from typing import Any, cast

import numpy as np

from pipeline.updating.structural.periods import Period, _by_component
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
