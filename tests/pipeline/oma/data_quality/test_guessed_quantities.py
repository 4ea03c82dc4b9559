"""What channels measure is guessed from their spectra, which are those of scipy."""

import numpy as np
import pytest
from scipy.signal import csd

from pipeline.oma.data_quality.guessed_quantities import cross_spectra


@pytest.mark.parametrize("length", [256, 301])
def test_cross_spectra_are_those_of_scipy(length: int) -> None:
    samples = np.random.default_rng(8).standard_normal((2_000, 3)).cumsum(axis=0)
    f, spectra = cross_spectra(samples, 40.0, length)
    rows = samples.T
    expected_f, expected = csd(rows[:, None], rows[None], fs=40.0, nperseg=length)
    np.testing.assert_allclose(f, expected_f, rtol=1e-12)
    np.testing.assert_allclose(spectra, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
