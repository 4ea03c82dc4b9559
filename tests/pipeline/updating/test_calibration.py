"""Intervals hold the truth as often as they say, in short: the long form is
`python -m tests.benchmarks calibration`."""

import pytest

from tests.benchmarks._pairing_trials import pairing_counts
from tests.benchmarks.calibration import (
    CASES,
    Posteriors,
    as_stated,
    covered_streams,
    truth_ranks,
)
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower
from tests.tiers import and_at_night


def posteriors_of(tails, **options):
    return Posteriors.of(as_stated(tails), model=LinearTower(), layout=LAYOUT, **options)


@pytest.mark.parametrize(("case", "n_windows"), list(zip(CASES, (6, 6, 30), strict=True)))
@pytest.mark.parametrize(
    ("n_streams", "fewest"),
    [
        pytest.param(14, 10, id="day"),
        pytest.param(25, 19, id="night", marks=pytest.mark.nightly),
    ],
)
def test_intervals_of_a_stream_hold_the_truth_at_the_stated_rate(
    case, n_windows, n_streams, fewest
):
    """Overlapping windows share nine tenths of their samples, and 30 of them say what four others
    do."""
    found = covered_streams(posteriors_of("gaussian"), case, n_streams, n_windows, first_seed=401)
    # binomial, three parameters that are correlated: below 19 of 25 and 10 of 14 once in a hundred
    # for each
    assert found.covered.min() >= fewest / n_streams
    assert found.covered.mean() >= 0.82
    # σ is integrated over a prior of 10 %: where there is no discrepancy, intervals are wide
    assert 0.4 < found.scaled_error.min() < found.scaled_error.max() < 1.5


@pytest.mark.nightly
def test_the_truth_ranks_anywhere_among_the_draws_of_its_posterior():
    found = truth_ranks(posteriors_of("gaussian", highest_sigma=0.01), 50, first_seed=402)
    assert found.uniformity.min() > 0.01


@pytest.mark.parametrize("n_streams", and_at_night(5, 10))
def test_modes_that_are_missing_spoilt_or_invented_are_hardly_ever_paired_wrongly(n_streams):
    counts = pairing_counts(n_streams, first_seed=403)
    assert counts.wrong_share <= 0.01
    assert counts.paired["clean"] > 0.98 * counts.identified["clean"]
    assert counts.paired["spurious"] < 0.1 * counts.identified["spurious"]
