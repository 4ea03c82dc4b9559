"""One measurement in every format; broken files of every format; formats of others."""

import re
import sys
from pathlib import Path

import numpy as np
import obspy
import pytest
from scipy.io import savemat

from sensors.files import formats
from sensors.files.formats import channels_in, read_chunks, read_file
from sensors.files.table import EVERYTHING, FileError, TimeColumn, Wanted, dated
from tests.sensors.files.conftest import NAMES, RATE, SAMPLES, SECONDS, START_NS, WRITERS

UNDATED = (".uff", ".outb")  # formats that do not store when the measurement began


def test_every_format_gives_the_same_samples_times_and_units(measurement: Path) -> None:
    table = read_file(measurement)
    np.testing.assert_array_equal(table.samples, SAMPLES)
    assert table.times is not None
    np.testing.assert_allclose(table.times, SECONDS, rtol=0, atol=1e-9)
    assert abs(table.start_ns - (0 if measurement.suffix in UNDATED else START_NS)) <= 1
    assert table.sampling_rate == RATE
    assert table.quantities == ("acceleration", "acceleration")
    if measurement.suffix == ".uff":  # knows nodes and directions only
        assert table.names == ("145+X", "106+X")
        assert table.units == ("m/s²", "m/s²")
    elif measurement.suffix == ".mseed":  # knows codes and counts only
        assert table.names == ("OW.T1..BNX", "OW.T1..BNY")
        assert table.units == ("", "")
    else:
        assert table.names == NAMES
        assert table.units == ("m/s²", "m/s²")


@pytest.mark.parametrize(
    ("code", "quantity"),
    [("BNZ", "acceleration"), ("BHZ", "velocity"), ("ELZ", "velocity"), ("EPN", "velocity")],
)
def test_the_second_letter_of_a_miniseed_channel_is_its_instrument(
    tmp_path: Path, code: str, quantity: str
) -> None:
    """SEED manual 2.4, appendix A: N an accelerometer, H, L and P seismometers of high and low gain
    and geophones."""
    trace = obspy.Trace(SAMPLES[:, 0].copy(), {"channel": code, "sampling_rate": RATE})
    trace.write(str(tmp_path / "a.mseed"), format="MSEED", encoding="FLOAT64")
    assert read_file(tmp_path / "a.mseed").quantities == (quantity,)


def test_a_file_that_is_cut_off_gives_one_line(measurement: Path) -> None:
    content = measurement.read_bytes()
    is_text = measurement.suffix == ".csv"  # which is cut behind a comma: a column is missing
    kept = content.rindex(b",") if is_text else len(content) - 701
    measurement.write_bytes(content[:kept])
    _assert_one_line(measurement)


def test_a_file_of_something_else_gives_one_line(measurement: Path) -> None:
    measurement.write_bytes(b"\x00\x01 something else \xff" * 60)
    _assert_one_line(measurement)


def test_an_empty_file_gives_one_line(measurement: Path) -> None:
    measurement.write_bytes(b"")
    _assert_one_line(measurement)


def test_a_file_that_is_damaged_anywhere_is_read_or_gives_one_line(measurement: Path) -> None:
    intact, rng = measurement.read_bytes(), np.random.default_rng(61)
    for _ in range(25):
        content = bytearray(intact)
        for place in rng.integers(0, min(len(intact), rng.choice([300, len(intact)])), size=3):
            content[place : place + rng.integers(0, 4)] = rng.bytes(rng.integers(0, 3))
        measurement.write_bytes(content)
        message = _error_of(measurement)
        assert message is None or (str(measurement) in message and "\n" not in message)


def _error_of(path: Path) -> str | None:
    """The error of a file that cannot be read; None of one that can."""
    try:
        read_file(path)
    except FileError as error:
        return str(error)
    return None


def test_a_missing_file_gives_one_line(measurement: Path) -> None:
    measurement.unlink()
    _assert_one_line(measurement)


def _assert_one_line(path: Path) -> None:
    with pytest.raises(FileError) as error:
        read_file(path)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("suffix", "module", "extra"),
    [
        ("h5", "h5py", "hdf5"),
        ("tdms", "nptdms", "tdms"),
        ("mseed", "obspy", "miniseed"),
        ("uff", "pyuff", "uff"),
    ],
)
def test_a_package_that_is_missing_is_named_with_its_extra(
    suffix: str, module: str, extra: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(
        FileError, match=rf"{module} is needed .* pip install 'pilewatch\[{extra}\]'"
    ):
        read_file(tmp_path / f"measured.{suffix}")


def test_a_reader_of_another_package_plugs_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sep005_io_mine.py").write_text(
        "def read_mine(path):\n"
        "    return [{'data': [1.0, 2.0, 3.0], 'name': 'top', 'unit_str': 'g', 'fs': 50.0,\n"
        "             'start_timestamp': '2024-03-01T12:00:00Z'}]\n"
        "def broken(path):\n"
        "    raise KeyError('header')\n"
    )
    package = tmp_path / "sep005_io_mine-1.0.dist-info"
    package.mkdir()
    (package / "METADATA").write_text("Metadata-Version: 2.1\nName: sep005-io-mine\nVersion: 1.0\n")
    (package / "entry_points.txt").write_text(
        "[pilewatch.files]\nmine = sep005_io_mine:read_mine\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(formats, "_installed_readers", formats._installed_readers.__wrapped__)
    path = tmp_path / "measured.mine"
    path.write_bytes(b"\x07")
    table = read_file(path)
    assert table.names == ("top",)
    assert table.units == ("m/s²",)
    assert table.sampling_rate == 50.0
    assert table.samples[0, 0] == pytest.approx(9.80665)
    by_name = read_file(path, "sep005_io_mine:read_mine")
    np.testing.assert_array_equal(by_name.samples, table.samples)
    with pytest.raises(FileError, match=r"'sep005_io_mine:broken' failed: KeyError: 'header'"):
        read_file(path, "sep005_io_mine:broken")
    with pytest.raises(FileError, match=r"cannot be loaded .*package\.module:function is needed"):
        read_file(path, "sep005_io_mine.nothing")


def test_a_channel_has_one_name_in_the_list_of_a_file_and_whatever_of_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sep005_io_plain.py").write_text(
        "def read_plain(path):\n"
        "    series = list(range(12)), [0.0, 1.0] * 6, [0.0, 2.0] * 6\n"
        "    return [{'data': each, 'name': '', 'unit_str': 'g', 'fs': 50.0} for each in series]\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    path, reader = tmp_path / "measured.plain", "sep005_io_plain:read_plain"
    path.write_bytes(b"\x07")
    assert channels_in(path, reader).names == ("ch1", "ch2", "ch3")
    every = read_file(path, reader)  # but the first, which counts its samples
    assert every.names == ("ch2", "ch3")
    second = read_file(path, reader, Wanted(names=frozenset({"ch2"})))
    np.testing.assert_array_equal(second.samples, every.samples[:, :1])


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_long_file_comes_in_chunks_that_join_without_a_seam(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"measured.{suffix}"
    WRITERS[suffix](path)
    monkeypatch.setattr("sensors.files.text.csv.CHUNK_BYTES", 4096)
    monkeypatch.setattr("sensors.files.readers.parquet.ROWS_OF_BATCH", 64)
    chunks = list(read_chunks(path))
    assert len(chunks) > 3
    assert {chunk.start_ns for chunk in chunks} == {START_NS}
    assert all(chunk.times is not None for chunk in chunks)
    times = np.concatenate([chunk.times for chunk in chunks if chunk.times is not None])
    np.testing.assert_allclose(times, SECONDS, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(np.concatenate([chunk.samples for chunk in chunks]), SAMPLES)


def test_the_channels_of_a_file_are_listed_without_its_samples(measurement: Path) -> None:
    listed, whole = channels_in(measurement), read_file(measurement)
    assert (listed.names, listed.units) == (whole.names, whole.units)
    assert len(listed.samples) == 0


@pytest.mark.parametrize(
    ("stated", "hours"), [("01-Jul-2026 12:00:00", 10), ("2026-07-01T12:00:00Z", 12)]
)
def test_a_start_without_a_zone_is_of_the_zone_that_is_stated(
    tmp_path: Path, stated: str, hours: int
) -> None:
    path = tmp_path / "a.mat"
    savemat(path, {"low": np.arange(50.0), "fs": 25.0, "StartTime": stated})
    zone = TimeColumn(zone="Europe/Copenhagen")
    start = np.datetime64(read_file(path, wanted=dated(EVERYTHING, zone)).start_ns, "ns")
    assert start == np.datetime64(f"2026-07-01T{hours:02d}:00:00")


@pytest.mark.parametrize("suffix", [*formats.CHANNEL_READERS, *formats.CHUNK_READERS])
def test_a_file_that_is_not_there_is_told_alike_by_every_reader(
    suffix: str, tmp_path: Path
) -> None:
    missing = tmp_path / f"gone.{suffix}"
    with pytest.raises(FileError, match=rf"^{re.escape(str(missing))}: No such file or directory$"):
        read_file(missing)
