"""What a node goes on from: snapshots on disk, and of the recordings what it had not answered.

    checkpoints/updating-iea15mw.checkpoint    one small file a turbine, new after each window
        pilewatch-node 3 EPOCH CRC iea15mw\\n            layout's version, run that wrote, checksum
        41803 FoundationPosterior\\n…                    what is kept as it was sent
        18212 state\\n…                                  as the node itself reads it

A file is written beside the old one, forced to disk and put in its place in one step, so that
whatever happens there is a whole one. It is written after the answers have gone out: a kill in
between makes the node answer that window once more, in the same words. The checksum covers all
that follows the first line.
"""

import hashlib
import logging
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote, unquote

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    WindowRejected,
)
from pipeline.nodes.node import NodeSnapshot
from pipeline.nodes.units.acquisition_units import read_back
from pipeline.oma.settings import OmaSettings
from pipeline.recording.latest_messages import latest_messages
from pipeline.transport.codec import decode, encode
from pipeline.transport.errors import CodecError
from pipeline.updating.checkpoint import CheckpointError
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.atomic_write import make_folder_durably, written_whole

logger = logging.getLogger(__name__)

FOLDER = "checkpoints"  # of the updating, inside a session's folder
ANSWERS = "tracks"  # of the identification
KEPT_MESSAGES: dict[str, type[Message]] = {
    each.__name__: each
    for each in (FoundationEvent, FoundationPosterior, WindowRejected, ModalEstimate, SensorLayout)
}
SNAPSHOT_HEADER = "pilewatch-node"
SNAPSHOT_VERSION = 3  # of the file's layout; any other is refused
STATE_SECTION = "state"
MOST_FILES = 1000  # snapshots in a folder; of more, those not renewed for longest go
LONGEST_NAME = 160  # of a turbine in a file's name; beyond it a checksum distinguishes them
MEASUREMENTS = (SensorLayout, AccelerationBlock, ScadaSample)


class FencedError(OSError):
    """A later run has taken the folder over: this one writes no more."""


@dataclass(frozen=True, slots=True)
class SnapshotFolder:
    """One file a turbine in one folder, which is made when it is first needed, and at most
    MOST_FILES of them."""

    path: Path
    node: str = "updating"
    """Whose they are; it stands in their names."""
    epoch: int = field(default=0, kw_only=True)
    """Number of the run that writes; a file of a later run is not replaced."""

    def file_of(self, turbine: str) -> Path:
        """Return where the turbine's snapshot lies, if it has one."""
        return self.path / f"{self.node}-{_in_file_names(turbine)}.checkpoint"

    def write(self, turbine: str, snapshot: NodeSnapshot) -> None:
        """Replace the turbine's snapshot in one step, the bytes on disk before the name.

        Raises
        ------
        OSError
            If the disk refuses; the one before is then still there.
        FencedError
            If a later run has written one.
        """
        path = self.file_of(turbine)
        try:
            make_folder_durably(self.path)
            if not path.exists():
                self._make_room()
            elif (later := _epoch_in(path)) > self.epoch:
                raise FencedError(0, f"run {later} has taken it over from run {self.epoch}")
            written_whole(path, written(turbine, snapshot, self.epoch))
        except OSError as error:
            error.filename = error.filename or str(path)
            raise

    def _make_room(self) -> None:
        """For one more file: turbines may be made up for ever, and those that exist renew theirs
        meanwhile."""
        files = [file for file in self.path.iterdir() if file.name.startswith(f"{self.node}-")]
        if len(files) < MOST_FILES:  # when each was renewed costs ten times as much
            return
        files.sort(key=_renewed)
        for longest_left in files[: len(files) + 1 - MOST_FILES]:
            logger.warning("removed %s: %d checkpoints are kept", longest_left, MOST_FILES)
            longest_left.unlink(missing_ok=True)

    def read(self, turbine: str) -> NodeSnapshot | None:
        """Return the turbine's snapshot; None where there is none.

        Raises CheckpointError: another version, another turbine, damaged, or none at all.
        """
        path = self.file_of(turbine)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise CheckpointError(
                f"cannot read the checkpoint {path}: {error.strerror}; correct its permissions or "
                "start with --fresh"
            ) from error
        logger.warning("%s of %s continues from %s", self.node, turbine, path)
        return parsed(content, turbine, str(path))


def _renewed(path: Path) -> int:
    """When a file was last written [ns]; 0 for one that is gone."""
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return 0


def _epoch_in(path: Path) -> int:
    """Return the epoch of a snapshot on disk; 0 where it states none."""
    try:
        with path.open("rb") as file:
            words = file.readline(1000).split(b" ")
        return int(words[2]) if words[1] == str(SNAPSHOT_VERSION).encode() else 0
    except (OSError, IndexError, ValueError):
        return 0


def _in_file_names(turbine: str) -> str:
    """Return the turbine's id as every file system takes it, whatever it is called."""
    name = quote(turbine, safe=" ")
    if len(name) <= LONGEST_NAME:
        return name
    return f"{name[:LONGEST_NAME]}-{hashlib.sha256(turbine.encode()).hexdigest()[:16]}"


def written(turbine: str, snapshot: NodeSnapshot, epoch: int = 0) -> bytes:
    """Return a snapshot as a file's bytes."""
    sections = [(type(each).__name__, encode(each)) for each in snapshot.messages]
    sections.append((STATE_SECTION, snapshot.state))
    body = b"".join(f"{len(content)} {name}\n".encode() + content for name, content in sections)
    name = quote(turbine, safe=" ")  # on one line, whatever it is called
    return (
        f"{SNAPSHOT_HEADER} {SNAPSHOT_VERSION} {epoch} {zlib.crc32(body):08x} {name}\n".encode()
        + body
    )


def parsed(content: bytes, turbine: str | None, origin: str) -> NodeSnapshot:
    """Return the snapshot in a file's bytes, of that turbine or of any. Raises CheckpointError."""
    head, _, body = content.partition(b"\n")
    words = head.decode(errors="replace").split(" ", 4)
    header, version, _, checksum, name = words + [""] * (5 - len(words))
    if header != SNAPSHOT_HEADER:
        raise CheckpointError(
            f"{origin} begins with {content[:20]!r}: it is no checkpoint; move it away or start "
            "with --fresh"
        )
    if version != str(SNAPSHOT_VERSION):
        raise CheckpointError(
            f"{origin} has version {version} of the checkpoint's layout; this pilewatch reads "
            f"version {SNAPSHOT_VERSION}; start with --fresh"
        )
    if turbine not in (None, unquote(name)):
        raise CheckpointError(
            f"{origin} is of turbine {unquote(name)!r}, not of {turbine!r}; move it away or start "
            "with --fresh"
        )
    if checksum != f"{zlib.crc32(body):08x}":
        raise CheckpointError(
            f"{origin} is damaged: its checksum is not that of its {len(body)} bytes; start with "
            "--fresh"
        )
    return _body(body, origin)


def _body(body: bytes, origin: str) -> NodeSnapshot:
    try:
        *messages, (name, state) = _sections(body)
        if name != STATE_SECTION:
            raise ValueError(f"it ends with {name!r}")
        return NodeSnapshot(state, tuple(decode(KEPT_MESSAGES[each], b) for each, b in messages))
    except (ValueError, KeyError, CodecError) as error:
        raise CheckpointError(f"{origin} is damaged: {error}; start with --fresh") from error


def _sections(content: bytes) -> Iterator[tuple[str, bytes]]:
    """Name and bytes of each section. Raises ValueError where one is not whole."""
    while content:
        head, _, content = content.partition(b"\n")
        length, name = head.decode(errors="replace").split(" ", 1)
        size = int(length)
        if not 0 <= size <= len(content):
            raise ValueError(f"{size} bytes of {name!r} were written, {len(content)} are there")
        yield name, content[:size]
        content = content[size:]


def recorded_past(files: Sequence[Path], settings: OmaSettings) -> tuple[Message, ...]:
    """The samples of an open window, and of one before it that may not have been answered."""
    return latest_messages(files, MEASUREMENTS, horizon=read_back(settings))
