"""A packed file that holds more than a measurement is refused before it is all unpacked."""

import gzip
import zipfile
from pathlib import Path

import numpy as np
import pytest

from sensors.files.formats import channels_in, read_file
from sensors.files.table import FileError
from sensors.files.text import decoding


def test_a_bomb_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "LEAST_UNPACKED", 1_000_000)
    path = tmp_path / "bomb.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"t,z10-fa\n" + b"0,0\n" * 5_000_000)
    with pytest.raises(FileError, match="no measurement packs like that"):
        channels_in(path)


def test_an_archive_that_states_to_hold_too_much_is_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(decoding, "LEAST_UNPACKED", 1_000_000)
    path = tmp_path / "bomb.npz"
    np.savez_compressed(path, z10=np.zeros(3_000_000))
    with pytest.raises(FileError, match="no measurement packs like that"):
        channels_in(path)


def archive(path: Path, *names: str) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as file:
        for name in names:
            file.writestr(name, "t,z10-fa\n" + "".join(f"{i / 10},{i % 7}\n" for i in range(200)))
    return path


def test_the_one_file_of_an_archive_is_read(tmp_path: Path) -> None:
    table = channels_in(archive(tmp_path / "one.zip", "tower.csv"))
    assert table.names == ("z10-fa",)
    table = read_file(tmp_path / "one.zip")
    np.testing.assert_array_equal(table.samples[:, 0], np.arange(200) % 7)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (("a.csv", "b.csv"), r"holds 2 files \(a.csv, b.csv\): unpack it"),
        (("[Content_Types].xml", "xl/sheet1.xml"), "an archive or a workbook"),
        ((), "this is no text"),
    ],
)
def test_other_archives_are_one_line(tmp_path: Path, names: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(FileError, match=sentence):
        channels_in(archive(tmp_path / "many.zip", *names))


def test_a_cut_archive_is_one_line(tmp_path: Path) -> None:
    path = archive(tmp_path / "one.zip", "tower.csv")
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(FileError, match="an archive or a workbook"):
        channels_in(path)


def test_messages_in_a_file_are_one_line_that_says_what_reads_them(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    path.write_text('{"ts": "2026-01-01T00:00:00Z", "z10": 0.1}\n' * 3)
    with pytest.raises(FileError, match=r"this is JSON and no table.*pilewatch feed"):
        channels_in(path)


def interrupted(path: Path, clock: bool, at: int, encoding: str = "utf-8") -> Path:
    """A file of 50 Hz of which the block of 4096 bytes from `at` on was not written."""
    rows = "".join(f"{f'{i / 50:.2f},' if clock else ''}{i % 7}.25,é\n" for i in range(6000))
    text = (("t," if clock else "") + "a,note\n" + rows).encode(encoding)
    path.write_bytes(text[:at] + bytes(4096) + text[at + 4096 :])
    return path


@pytest.mark.parametrize("at", [20_003, 10**9], ids=["within", "at the end"])
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252"])
def test_blocks_that_a_power_failure_left_empty_are_missing_samples(
    tmp_path: Path, at: int, encoding: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = interrupted(tmp_path / f"{at}-{encoding}.csv", True, at, encoding)
    table = read_file(path)
    assert table.sampling_rate == pytest.approx(50)
    assert table.times is not None
    samples = np.rint(table.times * 50).astype(int)
    np.testing.assert_array_equal(table.samples[:, 0], samples % 7 + 0.25)
    within = at < 10**9
    assert (len(samples) < 6000 - 200) == within
    assert samples[-1] == 5999
    assert "blocks of NUL bytes" in caplog.text
    assert "move up" not in caplog.text


def test_a_packed_file_with_such_a_block_is_read_as_it_is_unpacked(tmp_path: Path) -> None:
    plain = interrupted(tmp_path / "record.csv", True, 20_003)
    with gzip.open(tmp_path / "record.csv.gz", "wb") as file:
        file.write(plain.read_bytes())
    packed, table = read_file(tmp_path / "record.csv.gz"), read_file(plain)
    np.testing.assert_array_equal(packed.samples, table.samples)


def test_without_a_time_column_what_comes_behind_the_block_moves_up(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    table = read_file(interrupted(tmp_path / "record.csv", False, 20_003))
    assert set(np.unique(table.samples)) == {i + 0.25 for i in range(7)}
    assert "move up" in caplog.text


def test_numbers_in_binary_are_no_text(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_bytes(bytes(64) + np.arange(1000, dtype="<f4").tobytes())
    with pytest.raises(FileError, match="no text"):
        read_file(path)


def test_a_packed_file_gives_a_line_or_so_many_bytes_of_it(tmp_path: Path) -> None:
    path = tmp_path / "record.csv.gz"
    with gzip.open(path, "wb") as file:
        file.write(b"t,a\n0,1\n")
    with decoding.BoundedGzip(path) as packed:
        assert packed.readline(3) == b"t,a"
        assert packed.readline() == b"\n"
        assert packed.readline(-1) == b"0,1\n"
        assert packed.readline(None) == b""
