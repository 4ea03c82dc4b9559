"""Text files as instruments, spreadsheets and programs write them: one measurement in each."""

import gzip
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.files.formats import read_file
from sensors.files.table import EVERYTHING, DateOrder, FileError, TimeColumn, dated

RATE = 50.0  # [Hz]
G = 9.80665  # [m/s²], by definition (CGPM 1901)
START = np.datetime64("2024-03-13T12:00:00.250", "ns")
START_NS = int(START.astype(np.int64))
SAMPLES = np.round(np.random.default_rng(5).normal(size=(40, 2)), 6)  # [m/s²]
STAMPS = START + (np.arange(len(SAMPLES)) * 20_000_000).astype("timedelta64[ns]")
MOMENTS: list[datetime] = [datetime.fromisoformat(str(each)[:26]) for each in STAMPS]
SI = "a [m/s²]{0}b [m/s²]\n"


def rows(
    stamp: Callable[[int], str] | None, separator: str = ",", point: str = ".", end: str = "\n"
) -> str:
    """All samples, each with its stamp before it."""
    lines = []
    for i, pair in enumerate(SAMPLES.tolist()):
        numbers = [repr(value).replace(".", point) for value in pair]
        lines.append(separator.join([stamp(i)] * (stamp is not None) + numbers) + end
                     if stamp is not None else separator.join(numbers) + end)  # fmt: skip
    return "".join(lines)


def seconds(i: int) -> str:
    return f"{i / RATE:.3f}"


def comma_seconds(i: int) -> str:
    return seconds(i).replace(".", ",")


def as_date(form: str) -> Callable[[int], str]:
    return lambda i: MOMENTS[i].strftime(form)


def clock_digits(i: int) -> str:
    """Hours, minutes and seconds from 11:59:59.60 on: 115959.60."""
    hours, rest = divmod(12 * 3600 - 0.4 + i / RATE, 3600)
    return f"{hours * 10_000 + rest // 60 * 100 + round(rest % 60, 2):09.2f}"


def german(i: int, hour: int = 12) -> str:
    moment = MOMENTS[i].replace(hour=hour)
    return moment.strftime("%d.%m.%Y %H:%M:%S,") + f"{moment.microsecond // 1000:03d}"


def written(path: Path, text: str, encoding: str = "utf-8") -> Path:
    path.write_bytes(text.encode(encoding))
    return path


RELATIVE = {
    "decimal commas": "Zeit [s];" + SI.format(";") + rows(comma_seconds, ";", ","),
    "CRLF and a separator at every end": "t;" + SI.format(";").replace("\n", ";\r\n")
    + rows(seconds, ";", end=";\r\n"),
    "a separator at the end of the rows alone": "t;" + SI.format(";")
    + rows(seconds, ";", end=";\n"),
    "units in the second row": "Time,a,b\ns,m/s2,m/s^2\n" + rows(seconds),
    "units in brackets in the second row": "Time,a,b\n(s),(m/s²),(m/s²)\n\n" + rows(seconds),
    "lines of words above": "Logger X16\nSerial, 1234\nComment; hello, world, this is\n\n"
    "Time (s)," + SI.format(",") + rows(seconds),
    "a header in a comment": "# made today\n# t," + SI.format(",") + rows(seconds),
    "a footer": "t," + SI.format(",") + rows(seconds) + "# end\n",
    "quoted names with commas": '"t","a [m/s²]","b, top [m/s²]"\n' + rows(seconds),
    "quoted decimal commas": '"t","a [m/s²]","b [m/s²]"\n'
    + rows(comma_seconds, '","', ",").replace("\n", '"\n"').removesuffix('"').join(['"', ""]),
    "columns apart by blanks": "   t[s]    a[m/s²]   b[m/s²]\n"
    + rows(lambda i: f"  {i / RATE:8.3f}", "   "),
    "old lines of Macintosh": ("t," + SI.format(",") + rows(seconds)).replace("\n", "\r"),
    "an index of pandas": ",t," + SI.format(",") + rows(lambda i: f"{i},{seconds(i)}"),
    "names and units apart by a stroke": "Zeit / s;a / m/s²;b / m/s²\n"
    + rows(comma_seconds, ";", ","),
    "times of day": "Time," + SI.format(",") + rows(as_date("%H:%M:%S.%f")),
    "milliseconds by name": "time_ms," + SI.format(",") + rows(lambda i: f"{20 * i}"),
    "a clock of digits": "UTC," + SI.format(",") + rows(clock_digits),
    "a clock of digits by its unit": "Time [hhmmss]," + SI.format(",")
    + rows(lambda i: f"1200{i / RATE:05.2f}"),
    "a date of digits and a clock of digits": "Date;Time;" + SI.format(";")
    + rows(lambda i: f"20240313;{clock_digits(i)}", ";"),
    "milliseconds since midnight": "t [ms]," + SI.format(",")
    + rows(lambda i: f"{(86_399_500 + 20 * i) % 86_400_000}"),
}  # fmt: skip
ABSOLUTE = {
    "dates as Germans write them": "Datum/Uhrzeit;" + SI.format(";") + rows(german, ";", ","),
    "date and time of day in two columns": "Datum;Uhrzeit;" + SI.format(";")
    + rows(lambda i: german(i).replace(" ", ";"), ";", ","),
    "month first": "Date/Time," + SI.format(",") + rows(as_date("%m/%d/%Y %I:%M:%S.%f %p")),
    "months by name": "Time," + SI.format(",") + rows(as_date("%d-%b-%Y %H:%M:%S.%f")),
    "ISO with a zone": "UTC," + SI.format(",") + rows(as_date("%Y-%m-%dT%H:%M:%S.%fZ")),
    "ISO with another zone": "Time," + SI.format(",")
    + rows(lambda i: MOMENTS[i].strftime("%Y-%m-%d 13:%M:%S.%f+01:00")),
    "a zone by its name": "Zeit;" + SI.format(";")
    + rows(lambda i: german(i, 13) + " MEZ", ";", ","),
    "an offset with its name": "Zeit;" + SI.format(";")
    + rows(lambda i: german(i, 14) + " UTC+2", ";", ","),
    "a zone in the title": "Zeit (MESZ);" + SI.format(";")
    + rows(lambda i: german(i, 14), ";", ","),
    "an offset in the title": "Zeit (UTC+1);" + SI.format(";")
    + rows(lambda i: german(i, 13), ";", ","),
    "strokes between year and month": "Time," + SI.format(",")
    + rows(as_date("%Y/%m/%d %H:%M:%S.%f")),
    "ISO without marks": "Time," + SI.format(",") + rows(as_date("%Y%m%dT%H%M%S.%fZ")),
    "digits apart by a blank": "Time;" + SI.format(";") + rows(as_date("%Y%m%d %H%M%S,%f"), ";"),
    "a date of digits and a time of day": "Date;Time;" + SI.format(";")
    + rows(as_date("%Y%m%d;%H:%M:%S.%f"), ";"),
    "milliseconds since 1970": "timestamp," + SI.format(",")
    + rows(lambda i: str(STAMPS[i].astype(int) // 10**6)),
    "nanoseconds since 1970": "timestamp," + SI.format(",")
    + rows(lambda i: str(STAMPS[i].astype(int))),
}  # fmt: skip


@pytest.mark.parametrize("text", RELATIVE.values(), ids=RELATIVE)
def test_seconds_from_a_start_are_read_however_they_are_written(tmp_path: Path, text: str) -> None:
    table = read_file(written(tmp_path / "a.csv", text))
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert table.units == ("m/s²", "m/s²")
    assert table.sampling_rate == pytest.approx(RATE, rel=1e-9)
    assert table.start_ns == 0


@pytest.mark.parametrize("text", ABSOLUTE.values(), ids=ABSOLUTE)
def test_dates_are_read_however_they_are_written(tmp_path: Path, text: str) -> None:
    table = read_file(written(tmp_path / "a.csv", text))
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert table.units == ("m/s²", "m/s²")
    assert table.start_ns == START_NS
    assert table.times is not None
    np.testing.assert_allclose(table.times, np.arange(len(SAMPLES)) / RATE, atol=1e-9)


@pytest.mark.parametrize(("origin", "exact"), [(25_569, 2e-6), (719_529, 3e-5)])
def test_days_of_spreadsheets_and_of_matlab_are_no_seconds(
    tmp_path: Path, origin: int, exact: float
) -> None:
    days = origin + STAMPS.astype(np.int64) / (86400 * NANOSECONDS)
    text = "Time," + SI.format(",") + rows(lambda i: repr(float(days[i])))
    table = read_file(written(tmp_path / "a.csv", text))
    assert abs(table.start_ns - START_NS) < exact * NANOSECONDS
    assert table.sampling_rate == pytest.approx(RATE, rel=1e-3)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-be", "latin-1"])
def test_every_encoding_has_its_square(tmp_path: Path, encoding: str) -> None:
    text = "t," + SI.format(",") + rows(seconds)
    table = read_file(written(tmp_path / "a.csv", text, encoding))
    assert table.names == ("a", "b")
    assert table.units == ("m/s²", "m/s²")
    np.testing.assert_array_equal(table.samples, SAMPLES)


def test_a_date_of_digits_alone_is_no_time(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path / "a.csv", "Date," + SI.format(",") + rows(lambda i: "20240313"))
    table = read_file(path, wanted=replace(EVERYTHING, rate_known=True))
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert table.times is None
    assert caplog.messages == [f"{path}: column 'Date' left out; it has the date alone"]


def test_a_zipped_file_is_read_and_a_cut_one_is_one_line(tmp_path: Path) -> None:
    packed = gzip.compress(("t," + SI.format(",") + rows(seconds)).encode())
    (tmp_path / "a.csv.gz").write_bytes(packed)
    np.testing.assert_array_equal(read_file(tmp_path / "a.csv.gz").samples, SAMPLES)
    (tmp_path / "b.csv.gz").write_bytes(packed[: len(packed) // 2])
    with pytest.raises(FileError, match=r"b\.csv\.gz.*ended before"):
        read_file(tmp_path / "b.csv.gz")


@pytest.mark.parametrize("missing", ["NaN", "-", "--", "#N/A", "#NV", "NA", " ", "null", ""])
def test_a_cell_without_a_value_is_no_number(tmp_path: Path, missing: str) -> None:
    lines = ("t,a,b\n" + rows(seconds)).splitlines()
    cells = lines[7].split(",")
    lines[7] = ",".join([*cells[:2], missing])
    table = read_file(written(tmp_path / "a.csv", "\n".join(lines)))
    assert np.argwhere(np.isnan(table.samples)).tolist() == [[6, 1]]


def test_the_lines_above_say_rate_and_start(tmp_path: Path) -> None:
    text = "Start: 2024-03-13 12:00:00.25\nSampling rate [Hz];50\n\na;b\n" + rows(None, ";", ",")
    table = read_file(written(tmp_path / "a.csv", text))
    assert table.sampling_rate == RATE
    assert table.start_ns == START_NS
    assert table.names == ("a", "b")


def test_what_numbers_the_samples_or_is_text_is_no_channel(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    text = "Sample,a [g],b [g],state\n" + rows(str, end=",OK\n")
    table = read_file(written(tmp_path / "a.csv", text))
    np.testing.assert_allclose(table.samples, SAMPLES * G)
    assert table.sampling_rate is None
    assert "column 'state' holds text ('OK') and is left out" in caplog.text


def test_axes_in_brackets_are_no_units(tmp_path: Path) -> None:
    table = read_file(written(tmp_path / "a.csv", "t,Acc (X),Acc (Y)\n" + rows(seconds)))
    assert table.names == ("Acc (X)", "Acc (Y)")
    assert table.units == ("", "")


@pytest.mark.parametrize(("dates", "month"), [("day-first", 4), ("month-first", 3)])
def test_the_order_of_day_and_month_can_be_stated(
    tmp_path: Path, dates: DateOrder, month: int
) -> None:
    text = "Time,a,b\n" + rows(as_date("03/04/2024 %H:%M:%S.%f"))
    table = read_file(
        written(tmp_path / "a.csv", text), wanted=dated(EVERYTHING, TimeColumn(dates=dates))
    )
    assert np.datetime64(table.start_ns, "ns").astype("datetime64[M]") == np.datetime64(
        f"2024-{month:02d}"
    )


def test_a_stated_order_does_not_turn_dates_that_are_clear(tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "Time,a,b\n" + rows(as_date("13/04/2024 %H:%M:%S.%f")))
    assert (
        read_file(path).start_ns
        == read_file(path, None, dated(EVERYTHING, TimeColumn(dates="month-first"))).start_ns
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("when," + SI.format(",") + rows(seconds), "column 'when' rises evenly from 0 by 0.02"),
        ("Time,a,b\n" + rows(as_date("03/04/2024 %H:%M:%S.%f")), "is the day or the month first"),
        ("t,a,b\n" + rows(lambda i: str(20 * i)), "steps by 20 and has no unit"),
        ("t [s],a,b\n" + rows(lambda i: str(10**12 + 20 * i)), "after the year 2100"),
        ("t,a\n" + rows(seconds), "line 1 has 2 titles, the samples below it 3 columns"),
        (
            "t,a,b\n" + rows(seconds) + '0.8,"1,234.5",1\n',
            "in line 42; a number is needed, without",
        ),
        ("t,a,b\nx\n" + "\0xy" * 50, "this is no text"),
        ("t,a,b\nx\n" + "\0" * 50, "0 samples below the header"),  # a block left unwritten
        ("# only\n# comments\n", "the file is empty"),
        ("PK\x03\x04" + "\0" * 50, "no text but an archive or a workbook"),
        ('"TOB1","TOWER"\n' + "\0" * 50, "convert it to TOA5"),
        ("t,a,b\n" + rows(lambda i: f"12 o'clock {i}"), "a time is needed"),
        ("t,a,b\n" + rows(lambda i: f"{23 + i // 17}:{i % 17:02d}:00"), "'24:00:00' in sample 18;"),
    ],
)
def test_what_may_be_meant_otherwise_is_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(FileError, match=message) as error:
        read_file(written(tmp_path / "a.csv", text))
    assert str(tmp_path / "a.csv") in str(error.value)
    assert "\n" not in str(error.value)


def counted(number: Callable[[float], str], separator: str = ";") -> str:
    """Counts of two channels, up to a few thousand, at 10 ms."""
    titles = separator.join(["t [ms]", "a", "b [m/s²]"]) + "\n"
    lines = (
        separator.join([str(10 * i), *map(number, pair)])
        for i, pair in enumerate((2000 * SAMPLES).tolist())
    )
    return titles + "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (counted(lambda x: f"{x:,.0f}"), "column 'a' has '-1,604' and '-497'"),
        (counted(lambda x: f"{x:,.0f}".replace(",", ".")), "column 'a' has '-1.604' and '-497'"),
        (counted(lambda x: f'"{x:,.0f}"', ","), "column 'a' has '-1,604' and '-497'"),
        (counted(lambda x: f"{x:,.1f}"), "holds text ('-1,603.9') where numbers are needed"),
        (counted(lambda x: f"{x:,.1f}".replace(",", "'")), 'holds text ("-1\'603.9")'),
    ],
)
def test_marks_between_thousands_are_one_line(tmp_path: Path, text: str, message: str) -> None:
    """They were decimal marks, and 1,604 a thousandth of 1604."""
    path = written(tmp_path / "a.csv", text)
    with pytest.raises(FileError, match=re.escape(message)):
        read_file(path)


@pytest.mark.parametrize("number", ["{:.3f}", "{:.4g}", "{:.6g}", "{:.0f}"])
def test_decimals_of_three_digits_are_decimals(tmp_path: Path, number: str) -> None:
    shown = [[float(number.format(x)) for x in pair] for pair in (20 * SAMPLES).tolist()]
    lines = (";".join([str(10 * i), *map(number.format, pair)]) for i, pair in enumerate(shown))
    path = written(tmp_path / "a.csv", "t [ms];a;b\n" + "\n".join(lines) + "\n")
    np.testing.assert_array_equal(read_file(path).samples, shown)


def campbell(i: int) -> str:
    """Stamps as a Campbell logger writes them: no zeros at the end of a fraction."""
    return MOMENTS[i].strftime("%Y-%m-%d %H:%M:%S.%f").rstrip("0").rstrip(".")


@pytest.mark.parametrize("statistics", ["Smp", "Avg"])
def test_a_campbell_table_has_units_and_no_channel_of_its_record_counter(
    tmp_path: Path, statistics: str
) -> None:
    head = (
        '"TOA5","CR6","CR6","1234","CR6.Std.10","CPU:tower.CR6","4567","Fast"\n'
        '"TIMESTAMP","RECORD","a","b"\n"TS","RN","m/s^2","mg"\n'
        f'"","","{statistics}","{statistics}"\n'
    )
    text = head + rows(lambda i: f'"{campbell(i)}",{i + (i > 3)}')  # a record is missing in between
    table = read_file(written(tmp_path / "a.dat", text))
    assert table.names == ("a", "b")
    assert table.units == ("m/s²", "m/s²")
    factors = np.array([1.0, 1e-3 * G])
    np.testing.assert_allclose(table.samples, SAMPLES * factors, rtol=1e-15)
    assert table.start_ns == START_NS
    assert table.sampling_rate == pytest.approx(RATE)


def test_a_campbell_table_of_unknown_units_has_titles(tmp_path: Path) -> None:
    head = (
        '"TOA5","CR6","CR6","1234","CR6.Std.10","CPU:tower.CR6","4567","Fast"\n'
        '"TIMESTAMP","RECORD","a","b","c"\n"TS","RN","volts","bits","ticks"\n"","","Smp","Smp","Smp"\n'
    )
    text = head + rows(lambda i: f'"{campbell(i)}",{i},1.5')
    table = read_file(written(tmp_path / "a.dat", text))
    assert table.names == ("a", "b", "c")
    assert table.units == ("volts", "bits", "ticks")


def test_a_spreadsheets_empty_columns_at_the_end_need_no_titles(tmp_path: Path) -> None:
    text = "sep=;\nTime [s];a [g];b [g];;\n" + "".join(
        f"{i / RATE:.3f};{a:.6E};{b:.6E};;\n".replace(".", ",") for i, (a, b) in enumerate(SAMPLES)
    )
    table = read_file(written(tmp_path / "a.csv", text))
    assert table.names == ("a", "b")
    assert table.units == ("m/s²", "m/s²")
    np.testing.assert_allclose(table.samples, SAMPLES * G, rtol=1e-6)


def test_a_stated_rate_leaves_out_a_time_under_another_name(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path / "a.csv", "when,a,b\n" + rows(seconds))
    table = read_file(path, None, replace(EVERYTHING, rate_known=True))
    assert table.names == ("a", "b")
    assert "column 'when' rises evenly from 0 by 0.02 and is left out" in caplog.text
