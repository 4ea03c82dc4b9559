"""Files that are there as a whole or not at all."""

import errno
import os
import stat
from pathlib import Path

import pytest

from sensors.atomic_write import make_folder_durably, written_whole
from tests.pipeline.power_cut import power_cut


def test_a_disk_that_refuses_leaves_what_was_there_and_the_error_names_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "summary.json"
    written_whole(path, b"before")

    def full(_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space left") as refused:
        written_whole(path, b"after")
    assert refused.value.filename == str(path)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


def test_a_folder_that_is_not_there_is_told_by_the_files_own_name(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as refused:
        written_whole(tmp_path / "gone" / "summary.json", b"")
    assert refused.value.filename == str(tmp_path / "gone" / "summary.json")


def test_a_file_may_be_read_by_whom_the_umask_lets(tmp_path: Path) -> None:
    before = os.umask(0o022)
    try:
        written_whole(tmp_path / "a", b"1")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o644


@pytest.mark.parametrize("before", [None, b"before"])
def test_what_was_written_is_there_after_a_power_cut(tmp_path: Path, before: bytes | None) -> None:
    with power_cut(tmp_path):
        path = tmp_path / "summary.json"
        if before is not None:
            written_whole(path, before)
        written_whole(path, b"after")
    assert path.read_bytes() == b"after"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_that_were_made_are_there_after_a_power_cut(tmp_path: Path) -> None:
    with power_cut(tmp_path):
        make_folder_durably(tmp_path / "a" / "b" / "c")
        written_whole(tmp_path / "a" / "b" / "c" / "file", b"content")
    assert (tmp_path / "a" / "b" / "c" / "file").read_bytes() == b"content"


def test_a_folder_that_is_there_stays_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "file").write_bytes(b"content")
    make_folder_durably(tmp_path / "a")
    assert (tmp_path / "a" / "file").read_bytes() == b"content"
