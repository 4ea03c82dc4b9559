"""Text files as they come from data loggers."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sensors.files.formats import read_file
from sensors.files.table import FileError


def written(folder: Path, text: str) -> Path:
    path = folder / "record.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_units_in_brackets_become_metres_per_second_squared(tmp_path: Path) -> None:
    table = read_file(written(tmp_path, "time [ms],a [g],b [mm/s²],c\n0,1,500,7\n10,2,1000,8\n"))
    assert table.names == ("a", "b", "c")
    assert table.units == ("m/s²", "m/s²", "")
    np.testing.assert_allclose(table.samples, [[9.80665, 0.5, 7], [19.6133, 1.0, 8]])
    assert table.sampling_rate == pytest.approx(100.0)


def test_a_decimal_comma_and_a_missing_sample_are_read(tmp_path: Path) -> None:
    table = read_file(written(tmp_path, "t;a;b\n0;1,5;2\n0,5;;3\n"))
    np.testing.assert_array_equal(table.samples, [[1.5, 2.0], [np.nan, 3.0]])
    assert table.sampling_rate == pytest.approx(2.0)


def test_dates_give_the_start_and_the_rate(tmp_path: Path) -> None:
    text = "timestamp,a\n2024-01-01T00:00:00.000,1\n2024-01-01T00:00:00.010,2\n"
    table = read_file(written(tmp_path, text))
    assert table.start_ns == 1_704_067_200 * 1_000_000_000
    assert table.sampling_rate == pytest.approx(100.0)


def test_stamps_rounded_to_the_millisecond_still_give_the_rate(tmp_path: Path) -> None:
    rows = "".join(f"{i / 425:.3f},{i}\n" for i in range(4250))
    assert read_file(written(tmp_path, "t,a\n" + rows)).sampling_rate == pytest.approx(
        425, rel=1e-3
    )


def test_a_gap_in_the_stamps_does_not_change_the_rate(tmp_path: Path) -> None:
    rows = "".join(f"{i / 50 + (30 if i > 100 else 0):.4f},{i}\n" for i in range(200))
    assert read_file(written(tmp_path, "t,a\n" + rows)).sampling_rate == pytest.approx(50, rel=1e-3)


def test_a_file_without_header_gets_numbered_channels(tmp_path: Path) -> None:
    table = read_file(written(tmp_path, "1,2\n3,4\n5,6\n"))
    assert table.names == ("ch1", "ch2")
    assert len(table.samples) == 3


def test_two_columns_of_one_name_stay_two_channels(tmp_path: Path) -> None:
    assert read_file(written(tmp_path, "a,a\n1,2\n3,4\n")).names == ("a", "a.2")


def test_the_new_name_of_a_repeated_column_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = written(tmp_path, "a,b,a,a\n1,2,3,4\n3,4,7,5\n")
    read_file(path)
    assert [record.getMessage() for record in caplog.records] == [
        f"{path}: several columns have one name: column 3, 'a', is called 'a.2', column 4, 'a', "
        "is called 'a.3'"
    ]


def test_rows_of_separators_alone_are_no_samples(tmp_path: Path) -> None:
    """Spreadsheets write them behind the last row, and where a row was emptied."""
    table = read_file(written(tmp_path, "t;a;b\n0;1;2\n;;\n1;;3\n2;3;4\n;;\n;;\n"))
    np.testing.assert_array_equal(table.samples, [[1, 2], [np.nan, 3], [3, 4]])
    assert table.times is not None
    np.testing.assert_allclose(table.times, [0, 1, 2])


def test_a_row_with_a_sample_and_no_time_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="'t' has no value in sample 2; every row needs"):
        read_file(written(tmp_path, "t;a;b\n0;1;2\n;1;\n1;2;3\n"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "the file is empty; a header row is needed"),
        ("a,b\n", "0 samples"),
        ("a,b\n1,2\n", "1 sample; at least two"),
        ("a,b\n1,x\n2,3\n", "column 'b' has 'x' in line 2"),
        ("a,b\nnan,\n,nan\n", "only NaN in a, b"),
        ("t,a\n0,1\n-1,2\n", "does not increase"),
        ("t [weeks],a\n0,1\n1,2\n", "the time column 't' is in [weeks]; its unit can be s"),
        ("t\n0\n1\n", "no channel beside the time column"),
        ("a,b\n1,2\n3,4,5\n", "line 3 has 3 columns where 2 are expected"),
    ],
)
def test_a_broken_file_gives_one_line(tmp_path: Path, text: str, message: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(FileError) as error:
        read_file(path)
    assert message in str(error.value)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileError, match=r"nothing\.csv: No such file"):
        read_file(tmp_path / "nothing.csv")


def test_units_or_names_say_what_a_channel_measures(tmp_path: Path) -> None:
    table = read_file(
        written(tmp_path, "t,top [mm/s],vel_2,disp-x [mm],z [g]\n0,1,2,3,4\n1,1,2,3,4\n")
    )
    assert table.quantities == ("velocity", "velocity", "displacement", "acceleration")
    assert table.units == ("m/s", "", "m", "m/s²")
    assert table.samples[0, 2] == pytest.approx(3e-3)
    unknown = read_file(written(tmp_path, "t,vel,ch2\n0,1,2\n1,1,2\n"))
    assert unknown.quantities is None


def test_comments_and_empty_rows_among_the_samples_are_passed_over(tmp_path: Path) -> None:
    table = read_file(written(tmp_path, "t,a,b\n0,1,2\n# paused\n\n0.5,3,4\n   \n1,5,6\n"))
    np.testing.assert_array_equal(table.samples, [[1, 2], [3, 4], [5, 6]])


@pytest.mark.parametrize(
    "rows",
    [
        "a,b\n1,2\n3,4\n",
        "t [s],a\n0,2\n0.5,4\n",
        "time,a\n2024-12-31T23:00:00,2\n2024-12-31T23:00:01,4\n",
    ],
)
def test_columns_of_numbers_and_times_load_no_pandas(tmp_path: Path, rows: str) -> None:
    """A quarter of a second of each `pilewatch identify`."""
    path = written(tmp_path, rows)
    reads = "import sys; from pathlib import Path; from sensors.files.formats import read_file; "
    reads += f"read_file(Path({str(path)!r})); print('pandas' in sys.modules)"
    ran = subprocess.run([sys.executable, "-c", reads], capture_output=True, text=True, check=False)
    assert ran.stdout.strip() == "False", ran.stderr
