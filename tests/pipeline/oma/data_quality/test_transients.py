"""A window that is loud for a moment is not one of steady motion."""

import numpy as np
import pytest

from pipeline.oma.data_quality.transients import loudest_octave

RATE = 10.0  # [Hz]


@pytest.mark.parametrize(("loudness", "transient"), [(1.0, False), (1.2, False), (4.0, True)])
def test_twenty_seconds_of_four_times_the_motion_are_a_transient(
    loudness: float, transient: bool
) -> None:
    samples = np.random.default_rng(5).standard_normal((6000, 2))
    samples[3000:3200] *= loudness
    octave = loudest_octave(samples, RATE)
    assert octave is not None
    assert (octave.excess > 1) is transient
    if transient:
        assert 270 < octave.begin < 320


@pytest.mark.parametrize(("n", "judged"), [(6000, True), (5120, False)])
def test_an_octave_is_judged_that_ends_below_the_instruments_filters(n: int, judged: bool) -> None:
    """A burst of 4 Hz at 10 Hz: in 600 s an octave ends at 4.27 Hz, in 512 s at 2.5 and at 5 Hz."""
    samples = np.random.default_rng(5).standard_normal((n, 2))
    time = np.arange(200) / RATE
    samples[2500:2700] += 8 * np.sin(2 * np.pi * 4.0 * time)[:, None]
    octave = loudest_octave(samples, RATE)
    assert octave is not None
    assert 2 * octave.low <= 0.45 * RATE
    assert (octave.excess > 1) is judged
