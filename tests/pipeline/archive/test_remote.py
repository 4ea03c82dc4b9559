"""An archive behind a URL gives the numbers of the same files on a disk."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.archive.access.remote import is_remote, on_disk, remote_files, remote_stamp, url_of
from pipeline.archive.identification import READ, messages_of
from pipeline.archive.survey import archive_files, surveyed
from pipeline.recording.errors import RecordingError
from pipeline.transport.codec import encode
from sensors.errors import InputError

fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def bucket(archive: list[Path]) -> Iterator[str]:
    system = fsspec.filesystem("memory")
    for path in archive:
        system.pipe_file(f"/archive/2026/{path.name}", path.read_bytes())
    yield "memory://archive"
    system.rm("/archive", recursive=True)


def test_a_url_holds_what_the_disk_does(bucket: str, archive: list[Path]) -> None:
    """All that is ever read of a file: its survey, and its messages."""
    files = archive_files([f"{bucket}/**/*.mcap"])
    assert [each.name for each in files] == sorted(each.name for each in archive)
    for there, here in zip(files, sorted(archive), strict=True):
        far, near = surveyed(there), surveyed(here)
        assert far.fingerprint == near.fingerprint
        assert far.parts == tuple(replace(part, path=there) for part in near.parts)
    far, near = ([encode(each) for each in messages_of(path, READ)] for path in (there, here))
    assert far == near


def test_folder_file_and_pattern_are_listed_alike(bucket: str) -> None:
    folder = remote_files(bucket)
    assert folder == remote_files(f"{bucket}/2026/*.mcap")
    (one,) = remote_files(url_of(folder[0]))
    assert one == folder[0]
    assert remote_stamp(url_of(one)) is not None
    assert remote_stamp(f"{bucket}/gone.mcap") is None


def test_what_cannot_be_had_is_one_line(bucket: str) -> None:
    with pytest.raises(InputError, match="names no recording"):
        archive_files([f"{bucket}/none/*.mcap"])
    with pytest.raises(InputError, match="Protocol not known"):
        archive_files(["nothing://bucket/*.mcap"])
    gone = Path("memory:/archive/gone.mcap")
    with pytest.raises(RecordingError, match=r"memory://archive/gone\.mcap cannot be fetched"):
        on_disk(gone).__enter__()


def test_a_server_that_is_gone_before_a_file_is_looked_at_is_one_line(
    bucket: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """botocore's errors of a connection are no OSError."""

    def gone(system: object, path: str) -> None:
        raise LookupError("Could not connect to the endpoint URL")

    (one, *_) = remote_files(bucket)
    monkeypatch.setattr(fsspec.filesystem("memory").__class__, "info", gone)
    with pytest.raises(RecordingError, match="cannot be fetched: Could not connect"):
        remote_stamp(url_of(one))


@pytest.mark.parametrize(
    ("text", "remote"), [("s3://b/a.mcap", True), ("C://x", False), ("a/b.mcap", False)]
)
def test_a_url_survives_as_a_path(text: str, remote: bool) -> None:
    assert is_remote(text) is remote
    assert url_of(Path(text)) == (text if remote else "")
