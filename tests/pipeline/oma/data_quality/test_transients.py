"""A window that is loud for a moment is not one of steady motion."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pipeline.oma.data_quality.input_checks import check_stationarity
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


SECONDS = np.arange(9000) / RATE
SHAPES = np.array([[0.4, 1.0, 0.8, 0.3], [1.0, 0.3, -0.8, -0.5]])
SLOW = {
    "tone of .02 Hz": np.sin(2 * np.pi * 0.02 * SECONDS),
    "tone of .05 Hz": np.sin(2 * np.pi * 0.05 * SECONDS + 1),
    "tone of .2 Hz": np.sin(2 * np.pi * 0.2 * SECONDS + 2),
    "tide of 20 minutes": 2 * np.sin(2 * np.pi * SECONDS / 1200),
    "warming up": 2 * np.exp(-SECONDS / 200),
    "parabola": 2 * (SECONDS / 900) ** 2,
}


@pytest.mark.parametrize("name", SLOW)
def test_a_steady_tone_or_a_smooth_drift_is_no_transient(name: str) -> None:
    """Beside a footbridge that shakes at 1.3 and 3.1 Hz, next to nothing below."""
    for seed in range(5):
        loads = np.random.default_rng(seed).standard_normal((9000, 2))
        poles = np.exp((-0.01 + 1j) * 2 * np.pi * np.array([1.3, 3.1]) / RATE)
        motion = 0.01 * np.random.default_rng(100 + seed).standard_normal((9000, 4))
        for load, pole, shape in zip(loads.T, poles, SHAPES, strict=True):
            shaken = lfilter([1.0, -1.0], np.poly([pole, pole.conj()]).real, load)
            motion += np.outer(shaken / shaken.std(), shape)
        assert check_stationarity(motion, RATE) == ()
        assert check_stationarity(motion + SLOW[name][:, None], RATE) == ()


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
