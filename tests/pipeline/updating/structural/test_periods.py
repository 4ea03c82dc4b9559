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
    parts = _by_component(both, periods, n_dim, 0.0)
    assert len(parts) == len(both[0].errors)
    apart = np.array([-1.0, 1.0])
    difference = [apart @ np.linalg.inv(information) @ apart for _, _, information in parts]
    np.testing.assert_allclose(difference, 2 * (both[0].variances + 0.1 * both[0].floors))


def test_a_mode_that_one_period_alone_has_shares_nothing() -> None:
    n_dim = 5
    both = (comparison(1, n_dim), comparison(1, n_dim, tracks=(3, 4, 5)))
    periods = [Period(cast(Any, None), np.arange(n_dim)) for _ in both]
    parts = _by_component(both, periods, n_dim, 0.0)
    assert [information.shape for _, _, information in parts] == [(1, 1)] * 18
