"""Peaks of a window's lines: how near to each other they may lie."""

import numpy as np

from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.unseen_modes import _peaks

RATE = 10.0


def test_peaks_lie_apart_by_as_much_as_a_lightly_damped_mode_is_wide() -> None:
    """Noise has a top every three lines; of ten minutes six lines lie between two peaks below
    .56 Hz, six half bandwidths of ζ = .3 % above."""
    samples = np.random.default_rng(8).standard_normal((6000, 2))
    peaks = np.sort(_peaks(WindowSpectrum(samples, RATE), [], highest=1500.0))
    apart, below = np.diff(peaks), peaks[:-1]
    assert len(peaks) > 20
    assert (apart >= 6 / 600 - 1e-9).all()
    assert (apart[below > 1.0] >= 6 * 0.003 * below[below > 1.0]).all()
