"""What loggers write where they have no value is missing; what a sensor measured is not."""

from pathlib import Path

import numpy as np
import pytest

from sensors.files.fill_values import FillValues
from sensors.files.formats import read_file
from sensors.files.table import ChannelTable

N = 6000
RATE = 50.0  # [Hz]
GAPS = [slice(200, 230), slice(231, 233), slice(2000, 2001), slice(5990, 6000)]


def noise(offset: float = 0.0) -> np.ndarray:
    return offset + 0.05 * np.random.default_rng(3).standard_normal(N)


def left_out(
    series: np.ndarray, *, name: str = "a", unit: str = "m/s²", chunk: int = N
) -> list[int]:
    """Numbers of the samples that are taken as missing."""
    taken = series.copy()
    fill_values = FillValues("a.csv")
    for begin in range(0, N, chunk):
        part = taken[begin : begin + chunk, None]
        fill_values.leave_out(ChannelTable((name,), (unit,), part, None, 0, RATE))
    assert np.array_equal(taken[~np.isnan(taken)], series[~np.isnan(taken)])
    return np.flatnonzero(np.isnan(taken)).tolist()


@pytest.mark.parametrize(
    ("value", "offset"),
    [(-9999.0, 0.0), (99999.0, 0.0), (1e30, 0.0), (0.0, 9.81), (-32768.0, 40.0)],
)
@pytest.mark.parametrize("chunk", [N, 500])
def test_what_is_repeated_far_from_all_measured_is_missing(
    value: float, offset: float, chunk: int
) -> None:
    series = noise(offset)
    for gap in GAPS:
        series[gap] = value
    assert left_out(series, chunk=chunk) == np.flatnonzero(series == value).tolist()


def test_most_of_a_channel_may_be_missing() -> None:
    series = noise()
    series[1000:5500] = -9999.0
    assert len(left_out(series)) == 4500
    assert len(left_out(series, chunk=500)) == 4500  # some chunks hold nothing else


def test_two_values_may_stand_for_none() -> None:
    series = noise()
    series[100:130], series[300:330] = -9999.0, 9999.0
    assert left_out(series) == [*range(100, 130), *range(300, 330)]


def test_a_zero_among_motions_about_zero_is_a_sample() -> None:
    series = noise()
    series[100:130] = 0.0
    assert left_out(series) == []


@pytest.mark.parametrize("decay", [0.2, 1.0])
@pytest.mark.parametrize("frequency", [4.0, 12.5])  # the latter a quarter of the sampling rate
@pytest.mark.parametrize("amplitude", [20.0, 200.0])
@pytest.mark.parametrize("step", [0.01, 0.06])
def test_blows_up_to_the_converters_limit_are_samples(
    decay: float, frequency: float, amplitude: float, step: float
) -> None:
    series, t = noise(), np.arange(1000) / RATE
    for begin in (500, 2500, 4500):
        ringing = np.exp(-decay * t) * np.sin(2 * np.pi * frequency * t)
        series[begin : begin + 1000] += amplitude * ringing
    assert left_out(np.clip(np.round(series / step) * step, -19.6133, 19.6133)) == []


def test_spikes_of_their_own_values_are_left_to_the_identification() -> None:
    series, rng = noise(), np.random.default_rng(5)
    series[rng.integers(0, N, 20)] = rng.uniform(-300.0, 300.0, 20)
    assert left_out(series) == []


def test_a_rotor_that_stands_for_a_while_has_a_speed() -> None:
    series = noise(7.5)
    series[1000:2500] = 0.0
    assert left_out(series, name="RotSpeed", unit="rpm") == []


def test_channels_that_are_constant_or_have_one_step_are_left() -> None:
    assert left_out(np.full(N, -9999.0)) == []
    assert left_out(np.where(np.arange(N) < 3000, 0.0, 5.0)) == []


def test_fill_values_of_a_file_are_named_with_their_channel(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    series = np.column_stack([noise(), noise()])
    series[41:50, 1] = -9999.0
    path = tmp_path / "a.npz"
    np.savez(path, LAT097_FA=series[:, 0], LAT050_SS=series[:, 1], fs=RATE)
    samples = read_file(path).samples
    assert np.argwhere(np.isnan(samples)).tolist() == [[i, 1] for i in range(41, 50)]
    (text,) = caplog.messages
    assert text == (
        f"{path}: LAT050_SS has -9999 again and again, the first time in sample 42, far from all "
        "that it measures, as loggers write where they have no value; these samples are taken as "
        "missing"
    )
