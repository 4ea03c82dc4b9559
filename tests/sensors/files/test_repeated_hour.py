"""Files of local time that begin in the hour that comes twice as summer time ends."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.sources.import_files import Measurement, open_measurement
from sensors.errors import InputError
from sensors.files.block_builder import moment, open_file
from sensors.files.repeated_hour import settle_repeated_hour
from sensors.files.table import TimeColumn, Wanted

BERLIN = TimeColumn(zone="Europe/Berlin")
CHANGE = np.datetime64("2025-10-26T01:00", "s")  # UTC: 03:00 CEST, then 02:00 CET
HOUR = np.timedelta64(1, "h")


def written(
    path: Path, begin: str, minutes: float = 10, *, ending: str = "", step: int = 2
) -> Path:
    """A file of a sample every `step` seconds in Berlin's local time from a moment of UTC on."""
    since = np.arange(0, 60 * minutes, step).astype("m8[s]")
    utc = np.datetime64(f"2025-10-26T{begin}", "s") + since
    local = utc + np.where(utc < CHANGE, 2, 1) * HOUR
    rows = [f"{stamp}{ending},{i % 7},{i % 5}" for i, stamp in enumerate(local)]
    path.write_text("\n".join(["time,z145-fa [g],z145-ss [g]", *rows]) + "\n")
    return path


def begins(measurement: Measurement) -> list[str]:
    return [f"{file.path.stem} {moment(file.start_ns)[11:16]}" for file in measurement.files]


def ten_minute_files(folder: Path, begin: str, count: int, names: str) -> list[Path]:
    first = np.datetime64(f"2025-10-26T{begin}", "m")
    return [
        written(folder / f"{name}.csv", str(first + 10 * i)[11:])
        for i, name in zip(range(count), names, strict=True)
    ]


@pytest.mark.parametrize("by_name", [False, True])
def test_files_of_both_hours_continue_one_another(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, by_name: bool
) -> None:
    files = ten_minute_files(tmp_path, "00:30", 5, "deabc")
    wanted = ["d 00:30", "e 00:40", "a 00:50", "b 01:00", "c 01:10"]
    if by_name:  # by their stamps: what is of the second hour stands first
        files = [files[i] for i in (3, 4, 0, 1, 2)]
    assert begins(open_measurement(files, time=BERLIN)) == wanted
    assert len(caplog.messages) == by_name  # the order of the stamps shows nothing
    assert all("b.csv on as of the second hour" in each for each in caplog.messages)


def test_files_of_the_same_local_times_are_taken_as_they_are_given(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    files = ten_minute_files(tmp_path, "00:30", 9, "012345678")
    in_order = [f"{i} {'00' if i < 3 else '01'}:{10 * (i + 3) % 60:02d}" for i in range(9)]
    assert begins(open_measurement(files, time=BERLIN)) == in_order
    assert not caplog.messages
    by_stamp = [files[i] for i in (3, 4, 5, 0, 6, 1, 7, 2, 8)]
    assert begins(open_measurement(by_stamp, time=BERLIN)) == in_order
    (warning,) = caplog.messages
    assert "in the order in which they are given" in warning


def test_a_lone_file_is_taken_as_of_the_first_hour_with_a_warning(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path / "a.csv", "01:20")
    assert begins(open_measurement([path], time=BERLIN)) == ["a 00:20"]
    (warning,) = caplog.messages
    assert "a.csv begins in an hour that comes twice in Europe/Berlin" in warning
    assert "--zone UTC+01:00" in warning
    assert begins(open_measurement([path], time=TimeColumn(zone="UTC+01:00"))) == ["a 01:20"]
    assert len(caplog.messages) == 1


@pytest.mark.parametrize(
    ("begin", "minutes", "ending"),
    [
        ("00:30", 50, ""),  # goes back
        ("01:30", 50, ""),  # runs past the hour
        ("01:59", 10, ""),
        ("00:55", 10, ""),
        ("02:00", 10, ""),
        ("23:55", 10, ""),
    ],
)
def test_a_file_that_shows_its_hour_is_read_without_a_word(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, begin: str, minutes: float, ending: str
) -> None:
    path = written(tmp_path / "a.csv", begin, minutes, ending=ending)
    assert begins(open_measurement([path], time=BERLIN)) == [f"a {begin}"]
    assert not [each for each in caplog.messages if "comes twice" in each]


def test_stamps_with_a_zone_are_of_one_hour(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path / "a.csv", "01:20", ending=" CET")
    assert begins(open_measurement([path], time=BERLIN)) == ["a 01:20"]
    assert not caplog.messages


def test_a_neighbour_of_known_time_decides(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    files = [written(tmp_path / "a.csv", "01:50"), written(tmp_path / "b.csv", "02:00")]
    assert begins(open_measurement(files, time=BERLIN)) == ["a 01:50", "b 02:00"]
    files = [written(tmp_path / "c.csv", "23:50"), written(tmp_path / "d.csv", "00:00")]
    files[0].write_text(files[0].read_text().replace("2025-10-27T00", "2025-10-26T01"))
    assert begins(open_measurement(files, time=BERLIN)) == ["c 23:50", "d 00:00"]
    assert not caplog.messages


def test_files_of_slow_rows_continue_one_another_too(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Rows of three minutes: from the last of a file to the first of the next is such a step."""
    begins_at = {"b": "00:30", "c": "00:45", "a": "01:00"}
    for name, begin in begins_at.items():
        written(tmp_path / f"{name}.csv", begin, 15, step=180)
    wanted = Wanted(time=BERLIN)
    read = settle_repeated_hour([open_file(tmp_path / f"{name}.csv", None, wanted)[0]
                                 for name in "abc"])  # fmt: skip
    assert {file.path.stem: moment(file.start_ns)[11:16] for file in read} == begins_at
    (warning,) = caplog.messages
    assert "only that files then continue one another shows" in warning


def test_a_file_that_runs_past_the_hour_ends_when_it_does(tmp_path: Path) -> None:
    """The next file lies behind it: what was open is where the first one begins."""
    files = [written(tmp_path / "a.csv", "01:30", 50), written(tmp_path / "b.csv", "01:20")]
    files.append(written(tmp_path / "c.csv", "02:20"))
    assert begins(open_measurement(files, time=BERLIN)) == ["b 01:20", "a 01:30", "c 02:20"]


def test_files_that_overlap_in_either_hour_name_the_change(tmp_path: Path) -> None:
    files = [written(tmp_path / f"{name}.csv", "00:20") for name in "abc"]
    for number, file in enumerate(files):
        file.write_text(file.read_text().replace(",3,3\n", f",3,{number}\n"))
    with pytest.raises(InputError, match=r"must not overlap\. Summer time of Europe/Berlin ends"):
        list(open_measurement(files, time=BERLIN).blocks())


def test_the_hour_of_a_start_in_the_name_is_found_too(tmp_path: Path) -> None:
    files = []
    for place, label in enumerate(("0240", "0250", "0200")):
        files.append(tmp_path / f"m{place}_20251026_{label}.csv")
        rows = "".join(f"{i % 7},{i % 5}\n" for i in range(6000))
        files[-1].write_text(f"z145-fa [g],z145-ss [g]\n{rows}")
    read = open_measurement(files, sampling_rate=10.0, time=BERLIN)
    assert [moment(file.start_ns)[11:16] for file in read.files] == ["00:40", "00:50", "01:00"]
