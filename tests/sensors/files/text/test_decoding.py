"""A packed file that holds more than a measurement is refused before it is all unpacked."""

import gzip
from pathlib import Path

import numpy as np
import pytest

from sensors.files.formats import channels_in
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
