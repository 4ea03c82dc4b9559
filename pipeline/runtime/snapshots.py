"""Checkpoints on disk: an updating that was killed goes on to the posterior it would have had.

    checkpoints/updating-iea15mw.checkpoint    one small file a turbine, new after each window
        pilewatch-node 2 1717200600000000000 iea15mw\\n  layout's version, last window's end [ns]
        41803 FoundationPosterior\\n…                    the latest answers, as they were sent
        18212 state\\n…                                  `pipeline.updating.serialisation`

A file is written beside the old one, forced to disk and put in its place in one step, so that
whatever happens there is a whole one. It is written after the answers have gone out: a kill in
between makes the node answer that window once more, with the same posterior.

A transport gives a restarted node the latest estimates again. They are not counted twice, but the
latest of them are answered again, in the same words: an answer that was on its way when the node
was killed, or waited in its publisher's cache for a recorder that was down, went with the process.
"""

import hashlib
import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote, unquote

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    QualityWarning,
    WindowRejected,
)
from pipeline.nodes.updating import FoundationUpdaterNode
from pipeline.streams import stream_of
from pipeline.transport.codec import decode, encode
from pipeline.transport.errors import CodecError
from pipeline.updating.serialisation import CheckpointError
from pipeline.updating.updater import FoundationUpdater

logger = logging.getLogger(__name__)

FOLDER = "checkpoints"  # inside a session's folder
Answer = FoundationEvent | FoundationPosterior | WindowRejected  # of the updating
ANSWERS: dict[str, type[Answer | ModalEstimate]] = {
    each.__name__: each
    for each in (FoundationEvent, FoundationPosterior, WindowRejected, ModalEstimate)
}
LATEST = stream_of(FoundationPosterior).cached  # answers that a publisher would still have

KIND = "pilewatch-node"
VERSION = 2  # of the file's layout; another one is refused, never guessed at
STATE = "state"
MOST_FILES = 1000  # checkpoints in a folder; of more, those not renewed for longest go
LONGEST_NAME = 160  # of a turbine in a file's name; beyond it a checksum tells them apart


@dataclass(frozen=True, slots=True)
class NodeCheckpoint:
    """What a node that answers windows must not forget."""

    turbine: str
    answered_ns: int  # end of the last window that was answered [ns since 1970-01-01 UTC]
    state: bytes  # the updater's own checkpoint
    answers: tuple[Answer | ModalEstimate, ...] = ()  # the latest, oldest first


class CheckpointFolder:
    """One file a turbine in one folder, which is made when it is first needed, and at most
    MOST_FILES of them.

    node   whose they are; it stands in their names
    """

    def __init__(self, path: Path, node: str = "updating") -> None:
        self._path = path
        self._node = node

    def file_of(self, turbine: str) -> Path:
        """Where the turbine's checkpoint lies, if it has one."""
        return self._path / f"{self._node}-{_in_file_names(turbine)}.checkpoint"

    def write(self, checkpoint: NodeCheckpoint) -> None:
        """Replace the turbine's checkpoint in one step, the bytes on disk before the name.

        Raises OSError where the disk refuses; the one before is then still there.
        """
        self._path.mkdir(parents=True, exist_ok=True)
        path = self.file_of(checkpoint.turbine)
        if not path.exists():
            self._make_room()
        beside = path.with_suffix(".new")
        try:
            with beside.open("wb") as file:
                file.write(_written(checkpoint))
                file.flush()
                os.fsync(file.fileno())
        except OSError:
            beside.unlink(missing_ok=True)
            raise
        beside.replace(path)

    def _make_room(self) -> None:
        """For one more file: a stranger may make up turbines for ever, each answered window of
        his costs an updating, and those that exist renew theirs meanwhile."""
        files = sorted(self._path.glob(f"{self._node}-*.checkpoint"), key=_renewed)
        for longest_left in files[: len(files) + 1 - MOST_FILES]:
            logger.warning("removed %s: %d checkpoints are kept", longest_left, MOST_FILES)
            longest_left.unlink(missing_ok=True)

    def read(self, turbine: str) -> NodeCheckpoint | None:
        """The turbine's checkpoint; None where there is none.

        Raises CheckpointError: another version, another turbine, or no checkpoint at all.
        """
        path = self.file_of(turbine)
        try:
            content = path.read_bytes()
        except FileNotFoundError:
            return None
        except OSError as error:
            raise CheckpointError(
                f"cannot read the checkpoint {path}: {error.strerror}; mend its permissions or "
                "begin anew with --fresh"
            ) from error
        return _parsed(content, turbine, str(path))


def _renewed(path: Path) -> int:
    """When a file was last written [ns]; 0 for one that is gone."""
    try:
        return path.stat().st_mtime_ns
    except FileNotFoundError:
        return 0


def _in_file_names(turbine: str) -> str:
    """The turbine's id as every file system takes it, whatever a stranger calls his turbine."""
    name = quote(turbine, safe=" ")
    if len(name) <= LONGEST_NAME:
        return name
    return f"{name[:LONGEST_NAME]}-{hashlib.sha256(turbine.encode()).hexdigest()[:16]}"


def _written(checkpoint: NodeCheckpoint) -> bytes:
    turbine = quote(checkpoint.turbine, safe=" ")  # on one line, whatever it is called
    head = f"{KIND} {VERSION} {checkpoint.answered_ns} {turbine}\n".encode()
    sections = [(type(answer).__name__, encode(answer)) for answer in checkpoint.answers]
    sections.append((STATE, checkpoint.state))
    return head + b"".join(
        f"{len(content)} {name}\n".encode() + content for name, content in sections
    )


def _parsed(content: bytes, turbine: str, origin: str) -> NodeCheckpoint:
    head, _, rest = content.partition(b"\n")
    words = head.decode(errors="replace").split(" ", 3)
    if len(words) < 4 or words[0] != KIND:
        raise CheckpointError(
            f"{origin} begins with {content[:20]!r}: it is no checkpoint; move it away or begin "
            "anew with --fresh"
        )
    version, answered, written_for = *words[1:3], unquote(words[3])
    if version != str(VERSION):
        raise CheckpointError(
            f"{origin} has version {version} of the checkpoint's layout; this pilewatch reads "
            f"version {VERSION}; begin anew with --fresh"
        )
    if written_for != turbine:
        raise CheckpointError(
            f"{origin} is of turbine {written_for!r}, not of {turbine!r}; move it away or begin "
            "anew with --fresh"
        )
    try:
        *answers, (name, state) = _sections(rest)
        if name != STATE:
            raise ValueError(f"it ends with {name!r}")
        return NodeCheckpoint(
            turbine, int(answered), state, tuple(decode(ANSWERS[each], b) for each, b in answers)
        )
    except (ValueError, KeyError, CodecError) as error:
        raise CheckpointError(f"{origin} is damaged: {error}; begin anew with --fresh") from error


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


class CheckpointedUpdating:
    """The updating of one turbine with its checkpoint after every window.

    updater   the mathematics
    folder    where checkpoints lie
    turbine   whose checkpoint is read now, so that one that does not fit is told at the start

    A disk that is full costs the checkpoint, not the posterior; `warnings` says so.

    Raises CheckpointError for a checkpoint of another version, turbine, layout or foundation.
    """

    name = "updating"
    inputs: tuple[type, ...] = (ModalEstimate,)

    def __init__(self, updater: FoundationUpdater, folder: CheckpointFolder, turbine: str) -> None:
        self.warnings: tuple[QualityWarning, ...] = ()
        self._updater = updater
        self._folder = folder
        self._turbine = turbine
        self._restore()

    def _restore(self) -> None:
        found = self._folder.read(self._turbine)
        self._answered_ns = None if found is None else found.answered_ns
        answers = () if found is None else found.answers
        self._answers = tuple(each for each in answers if not isinstance(each, ModalEstimate))
        if found is None:
            self._node = FoundationUpdaterNode(self._updater)
            return
        path = self._folder.file_of(self._turbine)
        try:
            state = self._updater.restored(found.state, origin=str(path))
        except CheckpointError as error:
            raise CheckpointError(f"{error}; move it away or begin anew with --fresh") from error
        self._node = FoundationUpdaterNode(self._updater, state)
        logger.warning("updating of %s continues from %s", self._turbine, path)

    def handle(self, message: Message) -> Iterator[Answer]:
        """The answers to an estimate; once they have been taken, the checkpoint is written. One of
        the latest that comes again gets the answers that it got."""
        if not isinstance(message, ModalEstimate):
            return
        if message.turbine != self._turbine:  # made before it was known for whom
            self._turbine = message.turbine
            self._restore()
        if self._answered_ns is not None and message.end_ns <= self._answered_ns:
            yield from (each for each in self._answers if _window_end(each) == message.end_ns)
            return
        for answer in self._node.handle(message):
            self._answers = (*self._answers, answer)[-LATEST:]
            yield answer
        self._answered_ns = message.end_ns
        self._write()

    def _write(self) -> None:
        try:
            self._folder.write(self._checkpoint())
        except OSError as error:
            path, reason = self._folder.file_of(self._turbine), error.strerror or error
            text = f"{path} could not be written ({reason}): a restart goes on from the one before"
            self.warnings = (QualityWarning("checkpoint-not-written", text),)
            logger.error(text)
        else:
            self.warnings = ()

    def _checkpoint(self) -> NodeCheckpoint:
        assert self._answered_ns is not None
        return NodeCheckpoint(
            self._turbine, self._answered_ns, self._node.checkpoint(), self._answers
        )

    def close(self) -> None:
        """Nothing is held: the file is whole after every window."""
        self._node.close()


def _window_end(answer: Answer) -> int:
    return answer.end_ns if isinstance(answer, WindowRejected) else answer.time_ns
