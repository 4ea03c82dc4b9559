"""A spectrogram keeps a bounded number of columns, and gaps stay gaps."""

import numpy as np

from pipeline.report.pictures.samples import BANDS, MOST_COLUMNS, Spectrogram

FREQUENCIES = np.arange(0, 201) * 0.05  # [Hz]
SEGMENT = 50 * 10**9  # [ns]


def density(peak: float) -> np.ndarray:
    return np.exp(-(((FREQUENCIES - peak) / 0.1) ** 2))[:, None] + 1e-6


def grown(numbers: range, peak: float = 2.0) -> Spectrogram:
    spectrogram = Spectrogram()
    for number in numbers:
        spectrogram.add(number * SEGMENT, FREQUENCIES, density(peak))
    return spectrogram


def test_a_long_recording_has_columns_of_more_segments() -> None:
    edges, densities = grown(range(3 * MOST_COLUMNS)).picture() or (np.zeros(0), np.zeros(0))
    assert densities.shape == (BANDS, len(edges) - 1)
    assert MOST_COLUMNS / 2 <= densities.shape[1] < MOST_COLUMNS
    assert edges[0] == 0
    np.testing.assert_allclose(np.diff(edges), 4 * SEGMENT)


def test_the_largest_density_stands_at_its_frequency() -> None:
    spectrogram = grown(range(8), peak=3.0)
    _, densities = spectrogram.picture() or (None, np.zeros(0))
    band = int(np.argmax(densities[:, 0]))
    assert spectrogram.edges[band] <= 3.05
    assert spectrogram.edges[band + 1] >= 2.95


def test_a_gap_is_a_column_without_numbers() -> None:
    spectrogram = grown(range(6))
    for number in range(20, 26):
        spectrogram.add(number * SEGMENT, FREQUENCIES, density(2.0))
    edges, densities = spectrogram.picture() or (np.zeros(0), np.zeros(0))
    assert np.isnan(densities[0]).tolist() == [False] * 6 + [True] + [False] * 6
    assert np.diff(edges)[6] == 14 * SEGMENT


def test_a_short_recording_has_none() -> None:
    assert grown(range(3)).picture() is None
