"""Time histories of the outside model, and sensors that are not what their layout states."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import welch

from pipeline.sources.import_files import open_measurement
from sensors.files.layout_file import load_layout
from tests.outside.instruments import SensorFault, instruments
from tests.outside.loads import STRONG, modal_force_spectrum
from tests.outside.modal_data import DAMPING, LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL
from tests.outside.records import Record, record, write_csv, write_npz

TRUTH = Truth(NOMINAL)


@cache
def made(*faults: SensorFault, noise_share: float = 0.0, windows: int = 1) -> Record:
    """A record of the same forces, whatever the sensors."""
    return record(TRUTH, windows, np.random.default_rng(8), faults=faults, noise_share=noise_share)


def test_an_hour_at_40_hz_has_the_samples_of_six_windows() -> None:
    hour = made(windows=6)
    assert hour.samples.shape == (6 * 24_000, len(LAYOUT.channels))
    assert np.abs(hour.samples.mean(axis=0)).max() < 0.01 * hour.samples.std()


def test_the_power_near_a_mode_is_that_of_an_oscillator_under_white_noise() -> None:
    """∫ |ω² H|² G df over the peak is π f G / (4 ζ), G the one-sided spectrum of its force."""
    modes = TRUTH.modes()
    forces = modal_force_spectrum(modes, STRONG)
    readings = modes.readings(LAYOUT)
    number = int(np.argmin(np.abs(modes.frequencies - 3.411)))  # stands alone, side-side
    f = modes.frequencies[number]
    expected = np.pi * f * forces[number] / (4 * DAMPING) * readings[number] ** 2
    channel = int(np.argmax(np.abs(readings[number])))
    samples = made(windows=6).samples[:, channel]
    frequencies, spectrum = welch(samples, 40.0, nperseg=8192)
    peak = np.abs(frequencies - f) < 10 * DAMPING * f
    power = np.trapezoid(spectrum[peak], frequencies[peak])
    outside = 1 - 2 / np.pi * np.arctan(10)  # of the resonance's power beyond this band
    assert power == pytest.approx((1 - outside) * expected[channel], rel=0.12)


def test_noise_has_its_share_of_each_channels_rms() -> None:
    noise = made(noise_share=0.03).samples - made().samples
    assert noise.std(axis=0) / made().samples.std(axis=0) == pytest.approx(0.03, rel=0.02)


def test_a_flipped_channel_and_a_false_gain_scale_the_samples() -> None:
    flipped = made(SensorFault("flipped", 80.0)).samples
    louder = made(SensorFault("gain", 80.0, 0.1, axis=1)).samples
    assert_allclose(flipped[:, 1], -made().samples[:, 1], rtol=1e-6)
    assert_allclose(louder[:, 5], 1.1 * made().samples[:, 5], rtol=1e-6)
    assert_allclose(louder[:, 1], made().samples[:, 1], rtol=1e-6)


def test_swapped_heights_exchange_both_axes() -> None:
    swapped = made(SensorFault("swapped", 41.0, 106.0)).samples
    assert_allclose(swapped, made().samples[:, [2, 1, 0, 3, 6, 5, 4, 7]], rtol=1e-6)


def test_a_turned_sensor_mixes_its_two_axes() -> None:
    turned = made(SensorFault("turned", 145.0, 15.0)).samples
    samples = made().samples
    c, s = np.cos(np.radians(15)), np.sin(np.radians(15))
    assert_allclose(turned[:, 3], c * samples[:, 3] + s * samples[:, 7], rtol=1e-6, atol=1e-12)
    assert_allclose(turned[:, 7], c * samples[:, 7] - s * samples[:, 3], rtol=1e-6, atol=1e-12)


def test_a_false_height_and_no_sensor() -> None:
    true = instruments(LAYOUT, [SensorFault("height", 106.0, 3.0)]).true
    assert true.elevations.tolist() == [41, 80, 109, 145, 41, 80, 109, 145]
    with pytest.raises(ValueError, match="no sensor of outside is at 99 m"):
        instruments(LAYOUT, [SensorFault("turned", 99.0, 15.0)])


def test_drawn_shapes_have_the_same_faults() -> None:
    plain, flipped = (
        estimates(TRUTH, 1, np.random.default_rng(9), faults=faults)[0]
        for faults in ((), (SensorFault("flipped", 145.0),))
    )
    changed = {
        mode.name: mode.shape[3] * other.shape[3]
        for mode, other in zip(plain.modes, flipped.modes, strict=True)
        if abs(mode.shape[3]) > 0.3 and mode.unit_component != 3
    }
    assert changed
    assert max(changed.values()) < 0


def test_a_level_that_steps_moves_the_modes_of_its_windows() -> None:
    """Same forces: only the water differs, and the window in the same water is the same."""
    low, high = (
        record(
            TRUTH, 2, np.random.default_rng(10), levels=each, noise_share=0.0, sampling_rate=10.0
        ).samples
        for each in ((0.0, -1.0), (0.0, 1.0))
    )
    assert_allclose(low[:6000], high[:6000], rtol=1e-6, atol=1e-12)
    assert not np.allclose(low[6000:], high[6000:], rtol=0.1)


def test_blocks_are_the_samples_second_by_second() -> None:
    blocks = list(made().blocks())
    assert len(blocks) == 600
    assert {block.duration for block in blocks} == {1.0}
    assert blocks[1].start_ns - blocks[0].start_ns == 1_000_000_000
    joined = np.concatenate([block.samples for block in blocks])
    assert_allclose(joined, made().samples, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("write", [write_npz, write_csv])
def test_written_files_are_imported_as_the_same_samples(
    write: Callable[[Record, Path], tuple[Path, Path]], tmp_path: Path
) -> None:
    short = Record(made().samples[:400], made().sampling_rate, made().layout)
    path, layout = write(short, tmp_path)
    measurement = open_measurement([path], layout=load_layout(layout))
    assert measurement.sampling_rate == pytest.approx(40.0)
    assert measurement.layout.elevations == pytest.approx(LAYOUT.elevations)
    assert measurement.layout.directions == pytest.approx(LAYOUT.directions)
    joined = np.concatenate([block.samples for block in measurement.blocks()])
    assert_allclose(joined, short.samples, rtol=1e-5, atol=1e-6)
