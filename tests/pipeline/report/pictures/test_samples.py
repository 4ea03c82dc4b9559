"""Spectra and statistics that grow block by block equal those of the whole record."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from pipeline.report.pictures.samples import ChannelRecord
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.example_messages import START_NS, block

RATE = 20.0  # [Hz]


def blocks(samples: np.ndarray, rate: float = RATE, session: str = "s") -> list[AccelerationBlock]:
    """The samples as blocks of one second."""
    n = round(rate)
    return [
        replace(
            block(number),
            session=session,
            sampling_rate=rate,
            first_sample=number * n,
            samples=samples[number * n : (number + 1) * n].astype(np.float32),
        )
        for number in range(len(samples) // n)
    ]


def recorded(samples: np.ndarray) -> ChannelRecord:
    record = ChannelRecord()
    for each in blocks(samples):
        record.push(each)
    return record


def test_spectra_block_by_block_are_welchs() -> None:
    samples = np.random.default_rng(2).standard_normal((10_000, 2))
    (found,) = recorded(samples).spectra()
    n = round(100 * RATE)
    f, expected = welch(
        samples, RATE, window="hann", nperseg=n, noverlap=n // 2, axis=0, detrend="constant"
    )
    np.testing.assert_allclose(found.frequencies, f)
    np.testing.assert_allclose(found.densities[1:-1], expected[1:-1], rtol=1e-3)


def test_a_short_recording_has_a_spectrum_too() -> None:
    (found,) = recorded(np.random.default_rng(2).standard_normal((600, 2))).spectra()
    assert found.densities.shape == (301, 2)


def test_a_gap_and_missing_samples_cut_segments_and_are_counted() -> None:
    samples = np.random.default_rng(2).standard_normal((4000, 2))
    samples[1000:1100, 1] = np.nan
    record = recorded(samples)
    assert record.spectra()
    assert record.n_segments == 1  # of what came after the missing samples
    sound, holed = record.statistics()
    assert sound.missing == 0.0
    assert holed.missing == pytest.approx(100 / 4000)
    assert sound.deviation == pytest.approx(samples[:, 0].std(), rel=1e-5)
    assert sound.largest == pytest.approx(np.abs(samples[:, 0] - samples[:, 0].mean()).max())


def sine(rate: float, seconds: int) -> np.ndarray:
    """Two channels that swing with 2 Hz."""
    return np.sin(2 * np.pi * 2.0 * np.arange(round(seconds * rate)) / rate)[:, None].repeat(2, 1)


@pytest.mark.parametrize("rates", [(50.0, 100.0), (100.0, 50.0), (50.0, 100.0, 50.0)])
def test_samples_of_another_rate_have_spectra_of_their_own(rates: tuple[float, ...]) -> None:
    record = ChannelRecord()
    for part, rate in enumerate(rates):
        for each in blocks(sine(rate, 320), rate, f"s{part}"):
            start_ns = START_NS + (part * 1000 + each.sequence) * NANOSECONDS
            record.push(replace(each, start_ns=start_ns))
    found = record.spectra()
    assert [each.sampling_rate for each in found] == [50.0, 100.0]
    assert record.sampling_rates == (50.0, 100.0)
    for each in found:
        assert each.frequencies[-1] == each.sampling_rate / 2
        assert each.frequencies[np.argmax(each.densities, axis=0)] == pytest.approx([2.0, 2.0])
    edges_ns, densities = record.spectrogram.picture() or pytest.fail("no spectrogram")
    edges = record.spectrogram.edges
    assert edges[-1] == 50.0
    for begin_ns, column in zip(edges_ns, densities.T, strict=False):
        part = (begin_ns - START_NS) // (1000 * NANOSECONDS)
        if np.isfinite(column).any() and not (begin_ns - START_NS) % (1000 * NANOSECONDS):
            band = int(np.nanargmax(column))
            assert edges[band] <= 2.0 + 0.06
            assert edges[band + 1] >= 2.0 - 0.06
            assert np.isnan(column[edges[:-1] > 25.0]).all() == (rates[part] == 50.0)


def test_another_rate_within_one_session_cuts_a_segment() -> None:
    """A block of another rate between the samples of a segment: they do not follow each other."""
    record, samples = ChannelRecord(), sine(RATE, 60)
    made = blocks(samples) + blocks(sine(2 * RATE, 1), 2 * RATE)
    made += [replace(each, first_sample=each.first_sample + 40) for each in blocks(samples)]
    for each in made:
        record.push(each)
    assert record.n_segments == 0
    assert {each.sampling_rate: len(each.frequencies) for each in record.spectra()} == {RATE: 601}


def test_rates_that_are_found_from_the_stamps_of_files_are_one_rate() -> None:
    record = ChannelRecord()
    for session, rate in (("a", RATE), ("b", RATE * (1 + 2e-5)), ("c", RATE * (1 - 2e-5))):
        for each in blocks(sine(RATE, 30), RATE, session):
            record.push(replace(each, sampling_rate=rate))
    assert record.sampling_rates == (RATE,)
