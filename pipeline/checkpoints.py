"""Checkpoints on disk: an updating that was killed goes on to the posterior it would have had.

    checkpoints/updating-iea15mw.checkpoint    one small file a turbine, new after each window
        pilewatch-node 1 1717200600000000000 iea15mw\\n  layout's version, last window's end [ns]
        the updater's own bytes                            `pipeline.updating.checkpoint`

A file is written beside the old one, forced to disk and put in its place in one step, so that
whatever happens there is a whole one. It is written after the answers have gone out: a kill in
between makes the node answer that window once more, with the same posterior. A transport gives a
restarted node the latest estimates again; those that were answered already are passed over.
"""

import logging
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    WindowRejected,
)
from pipeline.nodes.updating import FoundationUpdaterNode
from pipeline.updating.checkpoint import CheckpointError
from pipeline.updating.updater import FoundationUpdater

logger = logging.getLogger(__name__)

FOLDER = "checkpoints"  # inside a session's folder
Answer = FoundationEvent | FoundationPosterior | WindowRejected

KIND = b"pilewatch-node"
VERSION = 1  # of the first line; another one is refused, never guessed at


@dataclass(frozen=True, slots=True)
class NodeCheckpoint:
    """What a node that answers windows must not forget."""

    turbine: str
    answered_ns: int  # end of the last window that was answered [ns since 1970-01-01 UTC]
    state: bytes  # the updater's own checkpoint


class CheckpointFolder:
    """One file a turbine in one folder, which is made when it is first needed."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def file_of(self, turbine: str) -> Path:
        """Where the turbine's checkpoint lies, if it has one."""
        return self._path / f"updating-{turbine}.checkpoint"

    def write(self, checkpoint: NodeCheckpoint) -> None:
        """Replace the turbine's checkpoint in one step, the bytes on disk before the name."""
        self._path.mkdir(parents=True, exist_ok=True)
        path = self.file_of(checkpoint.turbine)
        beside = path.with_suffix(".new")
        head = b"%s %d %d %s\n" % (
            *(KIND, VERSION, checkpoint.answered_ns),
            checkpoint.turbine.encode(),
        )
        with beside.open("wb") as file:
            file.write(head + checkpoint.state)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(path)

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


def _parsed(content: bytes, turbine: str, origin: str) -> NodeCheckpoint:
    head, _, state = content.partition(b"\n")
    words = head.split(b" ", 3)
    if len(words) < 4 or words[0] != KIND:
        raise CheckpointError(
            f"{origin} begins with {content[:20]!r}: it is no checkpoint; move it away or begin "
            "anew with --fresh"
        )
    version, answered, written_for = words[1:]
    if version != b"%d" % VERSION:
        raise CheckpointError(
            f"{origin} has version {version.decode(errors='replace')} of the checkpoint's layout; "
            f"this pilewatch reads version {VERSION}; begin anew with --fresh"
        )
    if written_for.decode(errors="replace") != turbine:
        raise CheckpointError(
            f"{origin} is of turbine {written_for.decode(errors='replace')!r}, not of {turbine!r}; "
            "move it away or begin anew with --fresh"
        )
    if not answered.lstrip(b"-").isdigit():
        raise CheckpointError(
            f"{origin} is damaged: {answered!r} is no time; begin anew with --fresh"
        )
    return NodeCheckpoint(turbine, int(answered), state)


class CheckpointedUpdating:
    """The updating of one turbine with its checkpoint after every window.

    updater   the mathematics
    folder    where checkpoints lie
    turbine   whose checkpoint is read now, so that one that does not fit is told at the start

    Raises CheckpointError for a checkpoint of another version, turbine, layout or foundation.
    """

    name = "updating"
    inputs: tuple[type, ...] = (ModalEstimate,)

    def __init__(self, updater: FoundationUpdater, folder: CheckpointFolder, turbine: str) -> None:
        self._updater = updater
        self._folder = folder
        self._turbine = turbine
        self._restore()

    def _restore(self) -> None:
        found = self._folder.read(self._turbine)
        self._answered_ns = None if found is None else found.answered_ns
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
        """The answers to an estimate; once they have been taken, the checkpoint is written."""
        if not isinstance(message, ModalEstimate):
            return
        if message.turbine != self._turbine:  # made before it was known for whom
            self._turbine = message.turbine
            self._restore()
        if self._answered_ns is not None and message.end_ns <= self._answered_ns:
            return
        yield from self._node.handle(message)
        self._answered_ns = message.end_ns
        self._folder.write(NodeCheckpoint(self._turbine, message.end_ns, self._node.checkpoint()))

    def close(self) -> None:
        """Nothing is held: the file is whole after every window."""
        self._node.close()
