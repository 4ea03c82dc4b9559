"""One mode that two bands report: which estimate stays, and how sure of it one may be."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.band_merging import merged, told_apart
from pipeline.oma.ssi.band_identification import mode_from_factor
from pipeline.oma.ssi.bands import Band
from sensors.arrays import FloatArray

SHAPE = np.array([1.0, 0.5])
STD = 1e-3  # [Hz]
DAMPING_STD = 1e-3
SLOW = Band(decimation=8, sampling_rate=5.0, lowest=0.1, highest=1.9, orders=(2,), block_rows=10)
FAST = replace(SLOW, decimation=1, sampling_rate=40.0, highest=16.0)


def mode(
    frequency: float,
    column: int,
    *,
    std: float = STD,
    damping: float = 0.01,
    shape: FloatArray = SHAPE,
) -> Mode:
    """Known to `std`, its errors in one time block of its own."""
    n = 2 + len(shape)
    factor = np.zeros((n, 6))
    factor[0, column], factor[1, column], factor[3, column] = std, DAMPING_STD, 0.01
    return mode_from_factor(
        frequency=frequency,
        damping_ratio=damping,
        shape=shape,
        block_factor=factor,
        own_factor=np.zeros((n, 2)),
        phase_collinearity=1.0,
        presence=1.0,
    )


def only(slow: Mode, fast: Mode) -> Mode:
    (found,) = merged([[slow], [fast]], [SLOW, FAST])
    assert not found.alone
    return found.mode


def test_bands_that_agree_change_nothing() -> None:
    slow, fast = mode(1.0, 0), mode(1.0, 1)
    assert only(slow, fast).frequency_std == pytest.approx(slow.frequency_std)


def test_what_two_bands_differ_by_beyond_their_stds_enters_the_std_of_the_one_that_stays() -> None:
    """Two estimates of equal weight, d apart with variance 2 s²: spread² = (d² − 2 s²) / 2."""
    distance = 4e-3
    kept = only(mode(1.0, 0), mode(1.0 + distance, 1))
    spread = (distance**2 - 2 * STD**2) / 2
    assert kept.frequency == 1.0  # the slower band's
    assert kept.frequency_std == pytest.approx(np.sqrt(STD**2 + spread))
    assert kept.frequency_std == pytest.approx(np.sqrt(kept.covariance[0, 0]))


def test_damping_ratios_that_differ_widen_the_damping_ratio_alone() -> None:
    slow, fast = mode(1.0, 0), mode(1.0, 1, damping=0.015)
    kept = only(slow, fast)
    spread = (0.005**2 - 2 * DAMPING_STD**2) / 2
    assert kept.damping_ratio_std == pytest.approx(np.sqrt(DAMPING_STD**2 + spread))
    assert kept.frequency_std == pytest.approx(slow.frequency_std)


def test_errors_that_both_bands_share_explain_no_difference_between_them() -> None:
    distance = 2e-3
    shared, apart = (only(mode(1.0, 0), mode(1.0 + distance, column)) for column in (0, 1))
    assert shared.frequency_std == pytest.approx(np.sqrt(STD**2 + distance**2 / 2))
    assert shared.frequency_std > apart.frequency_std


def test_the_sharpest_estimate_stays_whichever_band_it_comes_from() -> None:
    slow, blurred = mode(1.001, 0), mode(1.001, 0, std=1.5 * STD)
    assert only(slow, mode(1.0, 1)).frequency == 1.001
    assert only(blurred, mode(1.0, 1)).frequency == 1.0


def test_a_mode_in_the_reach_of_two_bands_that_one_of_them_reports_is_alone() -> None:
    within, above = merged([[], [mode(1.0, 0), mode(5.0, 1)]], [SLOW, FAST])
    assert within.alone
    assert not above.alone


def test_modes_of_other_shape_or_frequency_are_not_merged() -> None:
    across = replace(mode(1.0, 1), shape=np.array([1.0, -1.0]))
    assert len(merged([[mode(1.0, 0)], [across]], [SLOW, FAST])) == 2
    assert len(merged([[mode(1.0, 0)], [mode(1.02, 1)]], [SLOW, FAST])) == 2


def test_what_few_orders_agree_upon_needs_a_second_rate_to_be_steady() -> None:
    few, most = (replace(mode(1.0, 0), presence=share) for share in (0.55, 0.8))
    high_passed = replace(SLOW, high_passed=True)

    def steady(modes: list[list[Mode]], bands: list[Band]) -> bool:
        (found,) = merged(modes, bands)
        return found.steady

    assert steady([[most], []], [SLOW, FAST])
    assert not steady([[few], []], [SLOW, FAST])
    assert not steady([[few], [few]], [SLOW, high_passed])
    assert steady([[few], [few]], [SLOW, FAST])
    assert steady([[few], [most]], [SLOW, high_passed])


LOWER_SHAPE, UPPER_SHAPE = np.array([1.0, 0.5, 0.2]), np.array([0.6, 1.0, -0.4])


def between(shape: FloatArray, std: float) -> tuple[Mode, ...]:
    """What a mode of the fast band at 1.05 Hz is taken for a mixture of; the slow one has two."""
    two = [mode(1.0, 0, shape=LOWER_SHAPE), mode(1.08, 1, shape=UPPER_SHAPE)]
    fast = mode(1.05, 2, std=std, shape=shape)
    return merged([two, [fast]], [SLOW, FAST])[1].between


def test_what_short_lags_see_between_two_modes_that_longer_lags_resolve_is_their_mixture() -> None:
    mixed = 0.6 * LOWER_SHAPE + 0.4 * UPPER_SHAPE
    assert [each.frequency for each in between(mixed, std=3 * STD)] == [1.0, 1.08]


@pytest.mark.parametrize(("std", "mixed"), [(0.01, False), (0.5, True)])
def test_a_mixture_may_lie_off_its_modes_plane_in_the_direction_that_one_is_known_vaguely_in(
    std: float, mixed: bool
) -> None:
    lower, upper = mode(1.0, 0, shape=LOWER_SHAPE), mode(1.08, 1, shape=UPPER_SHAPE)
    factor = upper.covariance_factor.copy()
    factor[4, 1] = std  # of the third channel
    shape = 0.6 * LOWER_SHAPE + 0.4 * UPPER_SHAPE + np.array([0.0, 0.0, 0.6])
    fast = mode(1.05, 2, std=3 * STD, shape=shape)
    two = [lower, replace(upper, covariance_factor=factor)]
    found = merged([two, [fast]], [SLOW, FAST])[1]
    assert bool(found.between) == mixed


def test_a_shape_of_its_own_or_a_frequency_known_better_is_no_mixture() -> None:
    mixed = 0.6 * LOWER_SHAPE + 0.4 * UPPER_SHAPE
    assert between(np.array([0.1, 0.3, 1.0]), std=3 * STD) == ()
    assert between(mixed, std=0.5 * STD) == ()


def test_two_modes_of_one_shape_that_no_window_tells_apart_are_reported_once() -> None:
    """.2801 and .2809 Hz in ten minutes: half a line apart."""
    one, other = mode(0.2801, 0, std=3e-4), mode(0.2809, 1, std=4e-4)
    found = told_apart([one, other], 600.0)
    (kept,) = found.modes
    assert kept.frequency == one.frequency
    assert kept.frequency_std == pytest.approx(np.hypot(3e-4, 4e-4))  # covers the other one
    assert [each.frequency for each in found.refused] == [other.frequency]


@pytest.mark.parametrize(
    ("distance", "shape"),
    [(4e-3, SHAPE), (8e-4, np.array([0.1, 1.0]))],
    ids=["farther than it resolves", "another shape"],
)
def test_modes_that_a_window_tells_apart_are_both_reported(
    distance: float, shape: FloatArray
) -> None:
    two = [mode(0.28, 0, std=3e-4), mode(0.28 + distance, 1, std=3e-4, shape=shape)]
    found = told_apart(two, 600.0)
    assert [each.frequency for each in found.modes] == [each.frequency for each in two]
    assert not found.refused
