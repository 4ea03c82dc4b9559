"""Spectra and statistics that grow block by block equal those of the whole record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from pipeline.report.pictures.samples import ChannelRecord
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import block

RATE = 20.0  # [Hz]


def blocks(samples: np.ndarray) -> list[AccelerationBlock]:
    """The samples as blocks of one second."""
    n = round(RATE)
    return [
        replace(
            block(number),
            sampling_rate=RATE,
            first_sample=number * n,
            samples=samples[number * n : (number + 1) * n].astype(np.float32),
        )
        for number in range(len(samples) // n)
    ]


def recorded(samples: np.ndarray) -> ChannelRecord:
    record = ChannelRecord(RATE)
    for each in blocks(samples):
        record.push(each)
    return record


def test_spectra_block_by_block_are_welchs() -> None:
    samples = np.random.default_rng(2).standard_normal((10_000, 2))
    frequencies, densities = recorded(samples).spectra() or pytest.fail("no spectra")
    n = round(100 * RATE)
    f, expected = welch(
        samples, RATE, window="hann", nperseg=n, noverlap=n // 2, axis=0, detrend="constant"
    )
    np.testing.assert_allclose(frequencies, f)
    np.testing.assert_allclose(densities[1:-1], expected[1:-1], rtol=1e-3)


def test_a_short_recording_has_a_spectrum_too() -> None:
    found = recorded(np.random.default_rng(2).standard_normal((600, 2))).spectra()
    assert found is not None
    assert found[1].shape == (301, 2)


def test_a_gap_and_missing_samples_cut_segments_and_are_counted() -> None:
    samples = np.random.default_rng(2).standard_normal((4000, 2))
    samples[1000:1100, 1] = np.nan
    record = recorded(samples)
    assert record.spectra() is not None
    assert record.n_segments == 1  # of what came after the missing samples
    sound, holed = record.statistics()
    assert sound.missing == 0.0
    assert holed.missing == pytest.approx(100 / 4000)
    assert sound.deviation == pytest.approx(samples[:, 0].std(), rel=1e-5)
    assert sound.largest == pytest.approx(np.abs(samples[:, 0] - samples[:, 0].mean()).max())
