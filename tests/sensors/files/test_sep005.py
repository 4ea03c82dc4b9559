"""Channels of SEP005 side by side: one clock, their gaps, their units, and what cannot be."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sensors.files.sep005 import (
    FEWEST_OF_RAMP,
    MOST_PADDED,
    TOGETHER,
    join_channels,
    list_channels,
    timestamp_ns,
)
from sensors.files.table import FileError

PATH = Path("a.mat")
RATE = 10.0  # [Hz]
START, LATER = "2024-03-01T12:00:00", "2024-03-01T12:00:00.5"
START_NS = 1_709_294_400 * 10**9


def channel(name: str, data: Any, **keys: Any) -> Any:
    return {"data": np.array(data, dtype=float), "name": name, "unit_str": "", "fs": RATE, **keys}


NOISE = [3.0, 1.0, 4.0, 1.0, 5.0, 9.0, 2.0, 6.0]


def test_channels_that_begin_apart_are_on_one_clock_with_nothing_where_they_have_nothing() -> None:
    first = channel("a", NOISE, start_timestamp=START)
    later = channel("b", NOISE[:4], start_timestamp=LATER)  # five samples on
    table = join_channels([later, first], PATH)
    assert (table.names, table.start_ns, table.stated_rate) == (("b", "a"), START_NS, RATE)
    assert table.times == pytest.approx(np.arange(9) / RATE)
    assert table.samples[:, 1] == pytest.approx([*NOISE, np.nan], nan_ok=True)
    assert table.samples[:, 0] == pytest.approx([np.nan] * 5 + NOISE[:4], nan_ok=True)


def test_where_no_channel_has_anything_is_a_gap() -> None:
    first = channel("a", NOISE[:2], start_timestamp=START)
    later = channel("b", NOISE[:2], start_timestamp=LATER)
    table = join_channels([first, later], PATH)
    assert table.times == pytest.approx([0.0, 0.1, 0.5, 0.6])


@pytest.mark.parametrize("sign", [-1, 1])
def test_samples_that_lie_apart_by_less_than_a_twentieth_are_sampled_together(sign: int) -> None:
    def apart(share: float) -> Any:
        off = round((5 + sign * share * TOGETHER) / RATE * 1e6)
        stamp = datetime(2024, 3, 1, 12, 0, 0, off, UTC)
        return [
            channel("a", NOISE, start_timestamp=START),
            channel("b", NOISE, start_timestamp=stamp),
        ]

    assert len(join_channels(apart(0.98), PATH).samples) == 13
    with pytest.raises(FileError, match=r"'b' is sampled 0.[09]5 of a sample after 'a'"):
        join_channels(apart(1.02), PATH)


@pytest.mark.parametrize(("padded", "taken"), [(MOST_PADDED, True), (MOST_PADDED + 1, False)])
def test_channels_may_begin_as_far_apart_as_a_hundred_times_their_length(
    padded: int, taken: bool
) -> None:
    second = datetime.fromtimestamp(START_NS / 1e9 + (padded - 1), UTC)  # ten samples each
    channels = [
        channel("a", [*NOISE, 0, 1], start_timestamp=START),
        channel("b", [*NOISE, 0, 1], start_timestamp=second),
    ]
    if taken:
        assert len(join_channels(channels, PATH).samples) == 20
    else:
        with pytest.raises(FileError, match=f"begin {padded - 1} s apart"):
            join_channels(channels, PATH)


@pytest.mark.parametrize(
    ("n", "change", "kept"),
    [
        (FEWEST_OF_RAMP, 0.0, False),
        (FEWEST_OF_RAMP - 1, 0.0, True),
        (FEWEST_OF_RAMP, 0.9, False),  # of half a step
        (FEWEST_OF_RAMP, 1.1, True),
    ],
)
def test_an_even_rise_is_a_counter_and_no_channel(n: int, change: float, kept: bool) -> None:
    rise = 5 + 2.0 * np.arange(n)
    rise[n // 2] += change
    other = np.random.default_rng(1).normal(size=n)
    names = join_channels([channel("n", rise), channel("a", other)], PATH).names
    assert names == (("n", "a") if kept else ("a",))
    assert join_channels([channel("n", rise[::-1]), channel("a", other)], PATH).names == ("n", "a")


def test_stamps_count_from_the_first_whatever_they_begin_at() -> None:
    times = np.array([100.0, 100.1, 100.3])
    assert (table := joined_at(times)).times == pytest.approx([0.0, 0.1, 0.3])
    assert table.start_ns == 0
    assert joined_at(times, start_timestamp=START).start_ns == START_NS + 100 * 10**9
    since_1970 = joined_at(times + START_NS / 1e9)
    assert since_1970.start_ns == pytest.approx(START_NS + 100 * 10**9, abs=1000)
    assert since_1970.times == pytest.approx([0.0, 0.1, 0.3], abs=1e-6)


def joined_at(times: np.ndarray, **keys: Any) -> Any:
    return join_channels([channel("a", NOISE[: len(times)], fs=None, time=times, **keys)], PATH)


def test_units_are_standard_ones_and_quantities_are_the_channels() -> None:
    channels = [
        channel("a", NOISE, unit_str="g", quantity="a"),
        channel("b", NOISE, unit_str="mm", quantity="d"),
        channel("b", NOISE, unit_str="bar"),
    ]
    table = join_channels(channels, PATH)
    assert table.units == ("m/s²", "m", "bar")
    assert table.stated_quantities == ("acceleration", "displacement", None)
    assert table.samples[0] == pytest.approx([3 * 9.80665, 0.003, 3.0])
    assert len(set(table.names)) == 3
    listed = list_channels(channels, PATH)
    assert (listed.names, listed.units, listed.samples.shape) == (table.names, table.units, (0, 3))


def test_a_masked_sample_is_missing() -> None:
    masked = channel("a", NOISE) | {"data": np.ma.masked_greater(np.array(NOISE), 8.0)}
    (row,) = np.flatnonzero(
        np.isnan(join_channels([masked, channel("b", NOISE)], PATH).samples[:, 0])
    )
    assert row == NOISE.index(9.0)


TIMES = np.arange(8) / RATE


@pytest.mark.parametrize(
    ("channels", "reason"),
    [
        ([], "there is no channel of numbers"),
        ([channel("a", NOISE), channel("b", NOISE, fs=20.0)], r"a 10 Hz, b 20 Hz\)"),
        ([channel("a", NOISE), channel("b", NOISE, fs=None)], "b of unknown rate"),
        ([channel("a", NOISE, fs=0.0)], "sampling rate is 0.0 Hz"),
        ([channel("a", NOISE, fs=float("inf"))], "must be positive"),
        ([channel("a", NOISE) | {"data": ["x"]}], "'a' holds no series of numbers"),
        ([channel("a", [NOISE, NOISE])], "has 2 dimensions"),
        ([channel("a", NOISE, fs=None), channel("b", NOISE[:7], fs=None)], r"'b' \(7 samples\)"),
        (
            [
                channel("a", NOISE, fs=None, time=TIMES),
                channel("b", NOISE, fs=None, time=TIMES + 1),
            ],
            "do not share their time stamps",
        ),
        ([channel("a", NOISE, fs=None, time=TIMES[:7])], "do not share their time stamps"),
    ],
)
def test_what_cannot_stand_side_by_side_is_refused(channels: list[Any], reason: str) -> None:
    with pytest.raises(FileError, match=reason):
        join_channels(channels, PATH)


@pytest.mark.parametrize(
    ("stamp", "since_ns"),
    [
        (START, 0),
        (f"{START}Z", 0),
        (f"{START}+01:00", -3600 * 10**9),
        (f"{START}.25+01:00", -3600 * 10**9 + 250_000_000),
        (f"{START}.123456789", 123_456_789),
        (f"{START}.1234567899", 123_456_789),
        ("2024-03-01.12:00:00", 0),
        (f"{START},75", 750_000_000),
        (f"{START},123456789+01:00", -3600 * 10**9 + 123_456_789),
        ("20240301T120000,75Z", 750_000_000),
        ("01-Mar-2024 13:00:00,75 CET", 750_000_000),
        (" 01-Mar-2024 12:00:00 ", 0),
        ("01-Dec-2024 12:00:00.5", 275 * 86_400 * 10**9 + 500_000_000),
        (datetime(2024, 3, 1, 12), 0),
        ("2024-03-01 12:00:00.5 UTC", 500_000_000),
        ("01-Mar-2024 13:00:00 CET", 0),
        ("2024-03-01T14:00:00 UTC+2", 0),
    ],
)
def test_a_start_is_utc_to_the_nanosecond_unless_it_states_a_zone(
    stamp: Any, since_ns: int
) -> None:
    assert timestamp_ns(stamp, PATH) == START_NS + since_ns


def test_a_start_without_a_zone_is_in_the_one_that_is_stated_beside_it() -> None:
    assert timestamp_ns(START, PATH, "Europe/Berlin") == START_NS - 3600 * 10**9
    assert timestamp_ns(None, PATH) == 0
    for odd in ("noon", "2024-03-01T12:00,5"):
        with pytest.raises(FileError, match=f"its start is '{odd}'"):
            timestamp_ns(odd, PATH)


def test_channels_of_one_name_are_told_what_they_are_called(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "two.npy"  # a sentence is logged once for a file
    table = join_channels([channel("a", NOISE), channel("a", NOISE[::-1])], path)
    assert table.names == ("a", "a.2")
    assert f"{path}: several channels have one name: channel 2, 'a', is called 'a.2'" in caplog.text
