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
