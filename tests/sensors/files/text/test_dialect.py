"""What the beginning of a file says is read from whole lines only."""

from pathlib import Path

import numpy as np
import pytest

from sensors.files.table import FileError, TimeColumn
from sensors.files.text.dialect import BEGINNING, read_head
from sensors.files.text.preamble import start_in_name, stated_rate, stated_start_ns


def cut_within(folder: Path, cell: str, *, kept: int) -> Path:
    """A long file of which `kept` characters of one line's last cell are among those looked at."""
    row = "12.500;0.125\n"
    last = f"12.500;{cell}\n"
    before = BEGINNING - len("12.500;") - kept
    head = "t;a\n"
    rows = (before - len(head)) // len(row)
    padding = before - len(head) - rows * len(row)
    text = f"# {'.' * (padding - 3)}\n" if padding >= 3 else ""
    if padding < 3:  # too little room for a comment: give one row less
        rows -= 1
        text = f"# {'.' * (padding + len(row) - 3)}\n"
    path = folder / "long.csv"
    path.write_text(text + head + row * rows + last + row * 100, encoding="ascii")
    with path.open("rb") as file:
        assert file.read(BEGINNING).endswith(b";" + cell[:kept].encode())
    return path


@pytest.mark.parametrize(("cell", "kept"), [("-0.125", 1), ("nan5", 2), ("0.125", 0)])
def test_a_line_that_was_begun_says_nothing_of_missing_values(
    tmp_path: Path, cell: str, kept: int
) -> None:
    """Of "-0.125" only "-" may be among what is looked at, which elsewhere stands for no value."""
    assert read_head(cut_within(tmp_path, cell, kept=kept)).missing == ()


def test_a_cell_without_a_value_is_known_as_it_is_written(tmp_path: Path) -> None:
    path = tmp_path / "short.csv"
    path.write_text("t;a\n0;1\n1;-\n2;3\n3;4\n", encoding="ascii")
    assert read_head(path).missing == ("-",)


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("Sampling rate: 50 Hz", 50.0),
        ("Sampling rate [Hz];50", 50.0),
        ("Sampling rate (kHz): 2", 2000.0),
        ("Sampling rate [1/s]: 50", 50.0),
        ("Sampling rate [s-1]: 50", 50.0),
        ("Sampling rate: 100 samples per second", 100.0),
        ("Sample Rate 1000 S/s", 1000.0),
        ("Sampling rate;2;[kHz]", 2000.0),
        ("fs=100, s=5", 100.0),
        ("Sampling rate [Hz]: 2 kHz", None),
        ("Sampling rate: 1 MHz", None),
        ("Sampling rate: 10 ms", None),
        ("Update rate of the offset: 5", None),
        ("# Filter frequency: 20 Hz", None),
        ("Cut-off frequency;20 Hz", None),
        ("# Nyquist frequency (half the sampling rate): 20 Hz", None),
        ("filter_frequency_hz: 20", None),
        ("Eigenfrequenz: 0,3 Hz", None),
        ("Filter-Frequenz: 20 Hz", None),
        ("Rotor frequency: 0.2 Hz", None),
        ("Frequency: 20 Hz", None),
        ("Update rate: 1 Hz", None),
        ("Message rate: 1 Hz", None),
        ("Filter frequency: 20 Hz; sampling rate: 50 Hz", 50.0),
        ("Filter frequency (at a sampling rate of 50 Hz): 20 Hz", 50.0),
        ("FS: 2 g", None),  # full scale
        ("FS = 10 V", None),
        ("Rate: 50 Hz", 50.0),
        ("Data rate [Hz]: 50", 50.0),
        ("# Frequency of sampling: 50", 50.0),
        ("Die Frequenz der Messung: 50 Hz", 50.0),
        ("Sampled at a rate of 50 Hz", 50.0),
        ("Measurement frequency: 50 Hz", 50.0),
        ("Messfrequenz [Hz];50", 50.0),
        ("Abtastfrequenz: 50 Hz", 50.0),
        ("sampling_frequency_hz = 50", 50.0),
        ("Logging rate: 50 Hz", 50.0),
        ("Scanning frequency: 50 Hz", 50.0),
        ("Sampling interval 0,01 s", 100.0),
        ("# Sampling interval [ms]: 10", 100.0),
        ("# dt (ms) = 5", 200.0),
        ("dt_ms = 5", 200.0),
        ("sampling_interval_ms: 5", 200.0),
        ("Sampling interval in ms: 5", 200.0),
        ("Sampling interval;10;ms", 100.0),
        ("Sampling interval: 10 milliseconds", 100.0),
        ("dt [us]: 5000", 200.0),
        ("dt [µs]: 5000", 200.0),
        ("dt [μs]: 5000", 200.0),
        ("dt [ns]: 5000000", 200.0),
        ("dt [s]: 0.005", 200.0),
        ("dt [s]: 5 ms", None),
        ("dt [min]: 0.001", None),
        ("Sampling interval [Hz]: 50", None),
        ("dt = 0", None),
        ("Sampling time: 12:30", None),
        ("Sampling time: 0.05 s", 20.0),
        ("Sampling time: 600 s", None),  # how long was measured
        ("Sample period [s]: 60", None),
        ("Sampling interval: 60 s", 1 / 60),
        ("FS1;FS2", None),  # channels
        ("DT1;DT2", None),
    ],
)
def test_a_stated_rate_or_interval_is_in_the_unit_beside_it(
    line: str, expected: float | None
) -> None:
    found = stated_rate([line])
    assert found == (None if expected is None else pytest.approx(expected, rel=1e-12))


@pytest.mark.parametrize(
    ("value", "decimal_point", "expected"),
    [
        ("1,000", ".", None),
        ("1,000", ",", None),
        ("50,00", ".", 50.0),
        ("0,005", ".", 0.005),  # no group of thousands begins with 0
        ("1000,000", ".", 1000.0),
        ("1,000e2", ".", 100.0),
        ("50.000", ".", 50.0),  # as programs write three decimals
        ("1.000", ",", None),
        ("0.005", ",", 0.005),
        ("50.0", ",", 50.0),
        ("1,000.0", ".", None),
        ("1,000,000", ".", None),
        ("1 000", ".", None),
        ("1 000,5", ",", None),
        ("1'000", ".", None),
    ],
)
def test_a_rate_whose_thousands_may_be_decimals_is_not_stated(
    value: str, decimal_point: str, expected: float | None
) -> None:
    assert stated_rate([f"Sampling rate: {value} Hz"], decimal_point) == expected
    step = stated_rate([f"dt = {value}"], decimal_point)
    assert step == (None if expected is None else pytest.approx(1 / expected))


@pytest.mark.parametrize(("rows", "rate"), [("1,5;2,5\n", None), ("1.5;2.5\n", 50.0)])
def test_a_point_between_thousands_is_told_by_the_samples(
    tmp_path: Path, rows: str, rate: float | None
) -> None:
    path = tmp_path / "rated.csv"
    path.write_text(f"Sampling rate: 50.000 Hz\na;b\n{rows * 5}", encoding="ascii")
    assert read_head(path).columns.rate == rate


@pytest.mark.parametrize("line", ["Filter frequency: 20 Hz", "Nyquist frequency;20 Hz"])
def test_a_filters_frequency_is_no_sampling_rate(tmp_path: Path, line: str) -> None:
    path = tmp_path / "filtered.csv"
    path.write_text(f"# {line}\nax;ay\n" + "1.5;2.5\n" * 5, encoding="ascii")
    columns = read_head(path).columns
    assert ([each.title for each in columns.all], columns.rate) == (["ax", "ay"], None)


@pytest.mark.parametrize(
    "line",
    ["Sampling rate;1,000;Hz", "Cut-off frequency;20;Hz", "Start;03/02/2024 04:05:06;logger"],
)
def test_a_line_of_the_measurement_that_is_not_understood_is_no_line_of_titles(
    tmp_path: Path, line: str
) -> None:
    path = tmp_path / "untitled.csv"
    path.write_text(f"{line}\n" + "1.5;2.5\n" * 5, encoding="ascii")
    assert [each.title for each in read_head(path).columns.all] == ["ch1", "ch2"]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("# start: 2024-02-03 04:05:06", 1_706_933_106_000_000_000),
        ("# Trigger time 2024-02-03T04:05:06.25", 1_706_933_106_250_000_000),
        ("# begin 2024-02-03 04:05:06+01:00", 1_706_929_506_000_000_000),
        ("Start time:\t23.02.2024 04:05:06,250", 1_708_661_106_250_000_000),
        ("# start: 2024-02-03 05:05:06 MEZ", 1_706_933_106_000_000_000),
        ("Start time:\t23.02.2024 06:05:06,250 (UTC+2)", 1_708_661_106_250_000_000),
        ("Start time: 2/23/2024 04:05:06 AM", 1_708_661_106_000_000_000),
        ("Start time:\t03/02/2024 04:05:06", 0),  # in February or in March
        ("# recorded yesterday", 0),
        ("Start: 2024-02-03 05:05:06 +01:00", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 05:05:06 +0100", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 05:05:06+01", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03T05:05:06,250+01:00", 1_706_933_106_250_000_000),
        ("Start: 2024-02-03T04:05:06.1234567899Z", 1_706_933_106_123_456_789),
        ("Start: 2024-02-03 06:05:06 GMT+2", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 04:05:06.25 (UTC)", 1_706_933_106_250_000_000),
        ("Start: 2024-02-03 04:05:06 PM", 1_706_976_306_000_000_000),
        ("Start: 2024-02-03 05:05:06 p.m. CET", 1_706_976_306_000_000_000),
        ("Start: 2024-02-03 12:05:06 AM", 1_706_918_706_000_000_000),
        ("Start 23.02.2024 05:05:06 +01:00", 1_708_661_106_000_000_000),
        ("Start: 23-Feb-2024 05:05:06.5 PM +01:00", 1_708_704_306_500_000_000),
        ("Start;2024-02-03 05:05:06;CET", 1_706_933_106_000_000_000),
        ("Start;2024-02-03 05:05:06;+01:00;", 1_706_933_106_000_000_000),
        ("Start;2024-02-03 04:05:06;-5;", 1_706_933_106_000_000_000),
        ("Start;2024-02-03 04:05:06;-1.5", 1_706_933_106_000_000_000),
        ("Start;2024-02-03 04:05:06;mast 7", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 04:05:06, End: 2024-02-03 05:05:06", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 04:05:06 Duration: 600 s", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 04:05:06 - 2024-02-03 05:05:06", 1_706_933_106_000_000_000),
        ('"Start: 2024-02-03 04:05:06"', 1_706_933_106_000_000_000),
        ("Beginn: 03.02.2024 04:05:06 Uhr", 1_706_933_106_000_000_000),
        ("Start: 2024-02-03 04:05:06 IST", 0),  # of India, Israel or Ireland
        ("Start: 2024-02-03 04:05:06 local time", 0),
        ("Start: 2024-02-03 04:05:06 Zone: CET", 0),
        ("Start: 2024-02-03 04:05:06 +15:00", 0),
        ("Start: 2024-02-03 04:05:06 -01-02", 0),
        ("Start: 2024-02-03 04:05:06/7", 0),
        ("Start: 2024-13-03 04:05:06", 0),
        ("Start: 2024-02-03 04:05:61", 0),
    ],
)
def test_a_stated_start_counts_from_1970_in_utc(line: str, expected: int) -> None:
    assert stated_start_ns([line]) == expected


def test_the_first_start_that_is_understood_is_the_one() -> None:
    lines = ["Start: 2024-02-03 04:05:07 IST", "Trigger: 2024-02-03 04:05:06"]
    assert stated_start_ns(lines) == 1_706_933_106_000_000_000


def test_a_zone_behind_a_start_counts_before_the_one_that_is_stated_beside_the_file() -> None:
    beside = TimeColumn(zone="Europe/Berlin")
    for line in ("Start: 2024-02-03 05:05:06", "Start: 2024-02-03 04:05:06 +00:00"):
        assert stated_start_ns([line], beside) == 1_706_933_106_000_000_000


def test_a_start_that_may_be_in_two_months_is_the_one_that_is_said() -> None:
    line = "Start time:\t03/02/2024 04:05:06"
    assert stated_start_ns([line], TimeColumn(dates="day-first")) == 1_706_933_106_000_000_000
    assert stated_start_ns([line], TimeColumn(dates="month-first")) == 1_709_352_306_000_000_000


@pytest.mark.parametrize(
    ("name", "zone", "begin"),
    [
        ("mast_20250301_000230", "", "2025-03-01T00:02:30"),
        ("T1-2025-03-01T00-02-30", "", "2025-03-01T00:02:30"),
        ("202503010002", "", "2025-03-01T00:02:00"),
        ("mast_20250301_000230", "Europe/Berlin", "2025-02-28T23:02:30"),
        ("mast_20250701_000230", "Europe/Berlin", "2025-06-30T22:02:30"),
        ("mast_20250301_000230Z", "Europe/Berlin", "2025-03-01T00:02:30"),
        ("mast_20250301", "", None),
        ("tower_2025_97m_100Hz", "", None),
        ("20251301_000230", "", None),
    ],
)
def test_the_start_in_a_files_name(name: str, zone: str, begin: str | None) -> None:
    found = start_in_name(name, TimeColumn(zone=zone))
    wanted = 0 if begin is None else int(np.datetime64(begin, "ns").astype(np.int64))
    assert found == wanted


def test_an_unknown_zone_is_refused() -> None:
    with pytest.raises(FileError, match="zone 'Berlin' is no time zone"):
        TimeColumn(zone="Berlin")


def titles_of(folder: Path, above: str) -> list[tuple[str, str]]:
    path = folder / "titled.csv"
    path.write_text(f"{above}0;1;2\n1;2;3\n2;3;4\n", encoding="ascii")
    return [(each.title, each.unit) for each in read_head(path).columns.all]


@pytest.mark.parametrize("between", ["", "measured\n", ";;\n", ";\n"])
def test_lines_between_units_and_samples_are_neither_titles_nor_units(
    tmp_path: Path, between: str
) -> None:
    found = titles_of(tmp_path, f"Logger 7\nt;a;b\ns;g;g\n{between}")
    assert found == [("t [s]", "s"), ("a [g]", "g"), ("b [g]", "g")]


def test_columns_below_a_line_of_another_length_have_numbers_for_titles(tmp_path: Path) -> None:
    assert titles_of(tmp_path, "Logger 7\n") == [("ch1", ""), ("ch2", ""), ("ch3", "")]
