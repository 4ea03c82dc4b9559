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
