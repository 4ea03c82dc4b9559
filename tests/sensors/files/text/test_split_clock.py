"""Stamps whose parts stand in columns of their own."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from sensors.files.formats import read_file
from sensors.files.table import EVERYTHING, FileError

START = datetime(2026, 12, 31, 23, 59, 30, tzinfo=UTC)
RATE = 20.0
TITLES = {
    "Year,Month,Day,Hour,Minute,Second": lambda t: f"{t:%Y,%-m,%-d,%-H,%-M},{_second(t):.2f}",
    "Jahr,Monat,Tag,Stunde,Minute,Sekunde": lambda t: f"{t:%y,%m,%d,%H,%M},{_second(t):.2f}",
    "Year,DOY,SecondOfDay": lambda t: f"{t:%Y},{int(f'{t:%j}')},{_of_day(t):.2f}",
    "Year,Day_of_Year,HHMM,Sec": lambda t: f"{t:%Y},{t:%j},{t:%-H%M},{_second(t):.2f}",
    "year,month,day,hh,mi,ss,ms": lambda t: f"{t:%Y,%m,%d,%H,%M,%S},{t.microsecond // 1000}",
    "Date,Hour (UTC),Minute,Seconds": lambda t: f"{t:%Y-%m-%d},{t:%-H},{t:%-M},{_second(t):.2f}",
    "Date,Time,Millisecond": lambda t: f"{t:%Y-%m-%d,%H:%M:%S},{t.microsecond // 1000}",
    "Timestamp,us": lambda t: f"{t:%m/%d/%Y %I:%M:%S %p},{t.microsecond}",
}  # fmt: skip


def _second(time: datetime) -> float:
    return time.second + time.microsecond / 1e6


def _of_day(time: datetime) -> float:
    return time.hour * 3600 + time.minute * 60 + _second(time)


def written(folder: Path, titles: str, stamp: Callable[[datetime], str], n: int = 1200) -> Path:
    times = (START + timedelta(seconds=i / RATE) for i in range(n))
    rows = (f"{stamp(time)},{np.sin(i):.5f}\n" for i, time in enumerate(times))
    path = folder / "record.csv"
    path.write_text(f"{titles},top\n{''.join(rows)}", encoding="utf-8")
    return path


@pytest.mark.parametrize("titles", TITLES)
def test_its_parts_are_the_time_over_the_end_of_a_year(tmp_path: Path, titles: str) -> None:
    table = read_file(written(tmp_path, titles, TITLES[titles]))
    assert table.names == ("top",)
    assert table.start_ns == int(START.timestamp()) * 10**9
    assert table.times is not None
    np.testing.assert_allclose(table.times, np.arange(1200) / RATE, atol=1e-9)


def test_parts_without_a_date_go_on_over_midnight(tmp_path: Path) -> None:
    table = read_file(
        written(tmp_path, "Hour,Minute,Second", lambda t: f"{t:%H,%M},{_second(t):.2f}")
    )
    assert table.start_ns == 0
    assert table.times is not None
    np.testing.assert_allclose(table.times, np.arange(1200) / RATE, atol=1e-9)


def test_parts_beside_another_time_are_no_channels(tmp_path: Path) -> None:
    path = written(
        tmp_path, "time [s],Hour,Minute", lambda t: f"{_of_day(t) % 3570:.2f},{t:%H,%M}", 500
    )
    assert read_file(path).names == ("top",)


@pytest.mark.parametrize(
    ("titles", "row"), [("Max,Min", "1.5,-2"), ("Day,Hour", "3,4"), ("ms,us", "5000,3")]
)
def test_columns_that_make_no_clock_are_channels(tmp_path: Path, titles: str, row: str) -> None:
    path = tmp_path / "record.csv"
    path.write_text(f"t,{titles}\n" + "".join(f"{i / 50},{row}\n" for i in range(50)))
    assert read_file(path).names == tuple(titles.split(","))


def test_milliseconds_that_count_on_are_no_part(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        "Timestamp,ms",
        lambda t: f"{t:%Y-%m-%d %H:%M:%S.%f},{(t - START) / timedelta(milliseconds=1):.0f}",
    )
    assert read_file(path).names == ("ms", "top")


@pytest.mark.parametrize(
    ("titles", "row", "reason"),
    [
        ("Hour,Minute,Second", "12,73,5.0", "has minute 73; 0 to 59 are possible"),
        ("Year,DOY,HHMM,Sec", "2026,1,1273,0", "hour and minute 1273"),
        ("Year,Month,Day,Hour,Minute", "2026,13,1,0,0", "month 13; 1 to 12 are possible"),
        ("Year,DOY,Hour,Minute", "2026,1.5,0,0", "day of the year 1.5; 1 to 366 are possible"),
        ("Hour,Minute,Second", "12,,5.0", "has no value in sample 101"),
    ],
)
def test_what_is_no_part_is_named(tmp_path: Path, titles: str, row: str, reason: str) -> None:
    good = {"Hour,Minute,Second": "12,3,4.0", "Year,Month,Day,Hour,Minute": "2026,1,1,0,0"}
    path = tmp_path / "record.csv"
    path.write_text(
        f"{titles},top\n" + f"{good.get(titles, '2026,1,0,0')},1\n" * 100 + f"{row},2\n"
    )
    with pytest.raises(FileError, match=reason) as error:
        read_file(path)
    assert titles.split(",")[0] in str(error.value)


def test_a_rate_alone_needs_no_stamps_and_the_parts_are_no_channels(tmp_path: Path) -> None:
    path = written(tmp_path, *next(iter(TITLES.items())))
    wanted = replace(EVERYTHING, stamps=False)
    assert read_file(path, wanted=wanted).names == ("top",)
