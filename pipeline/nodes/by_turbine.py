"""One node a turbine: made, restored, snapshot and let go; so many at most."""

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from pipeline.messages import Message, QualityWarning
from pipeline.nodes.node import NodeSnapshot, NodeStatistics, TurbineNode
from pipeline.oma.windows.block_admission import LimitSettings

logger = logging.getLogger(__name__)

MOST_TURBINES = LimitSettings().turbines


class SnapshotStore(Protocol):
    """Keeps what nodes must not forget."""

    def read(self, turbine: str) -> NodeSnapshot | None:
        """Return the turbine's snapshot; None where there is none. Raises CheckpointError."""
        ...

    def write(self, turbine: str, snapshot: NodeSnapshot) -> None:
        """Replace the turbine's snapshot in one step. Raises OSError."""
        ...


N = TypeVar("N", bound=TurbineNode)


class NodeByTurbine(Generic[N]):
    """One node a turbine: made at the turbine's first message, restored from where the one
    before it ended, snapshot after what it must not forget, let go where there are too many.

    Parameters
    ----------
    make : callable
        Turbine → its node.
    store : SnapshotStore, optional
        Where nodes go on from; None: they begin with nothing seen. A disk that is full costs the
        snapshot, not the answers; `statistics` warns of it.
    past : sequence of Message
        What was recorded last, in the order of recording.
    most_turbines : int, optional
        Of more, the one with the fewest messages is let go.
    """

    def __init__(
        self,
        make: Callable[[str], N],
        *,
        store: SnapshotStore | None = None,
        past: Sequence[Message] = (),
        most_turbines: int = MOST_TURBINES,
    ) -> None:
        self.members: dict[str, N] = {}
        self._make = make
        self._store = store
        self._past: dict[str, list[Message]] = {}
        for message in past:
            self._past.setdefault(message.turbine, []).append(message)
        self._names = LimitedMembers(most_turbines)
        self._kept: dict[str, int] = {}  # revision of the last snapshot
        self._not_kept: tuple[QualityWarning, ...] = ()
        self._of_the_past = NodeStatistics()
        self._early_answers: list[Message] = []  # of nodes made before their first message

    def begin(self, turbine: str) -> None:
        """Make a turbine's node before its first message.

        Raises CheckpointError for a snapshot that it cannot go on from.
        """
        self._early_answers += self._started(turbine)

    def _started(self, turbine: str) -> Iterator[Message]:
        """Make the turbine's node; what it answers again, or for the first time."""
        if turbine in self.members:
            return
        node = self.members[turbine] = self._make(turbine)
        self._kept[turbine] = node.revision
        snapshot = None if self._store is None else self._store.read(turbine)
        past = self._past.pop(turbine, [])
        if snapshot is not None:
            yield from node.restore(snapshot, past)

    def handle(self, message: Message) -> Iterator[Message]:
        """The answers of the turbine's node; when they have been taken, its snapshot is kept."""
        turbine = message.turbine
        leaving = self._names.note(turbine)
        if leaving is not None and leaving in self.members:
            yield from self._let_go(leaving)
        early, self._early_answers = self._early_answers, []
        yield from early
        yield from self._started(turbine)
        yield from self.members[turbine].handle(message)
        self._keep(turbine)

    def _let_go(self, turbine: str) -> Iterator[Message]:
        node = self.members.pop(turbine)
        self._kept.pop(turbine, None)
        yield from node.finish()
        self._of_the_past += replace(node.statistics, warnings=())

    def _keep(self, turbine: str) -> None:
        node = self.members[turbine]
        if self._store is None or node.revision == self._kept[turbine]:
            return
        self._kept[turbine] = node.revision
        try:
            self._store.write(turbine, node.snapshot())
        except OSError as error:
            text = (
                f"{error.filename} could not be written ({error.strerror or error}): a restart "
                "goes on from the snapshot before"
            )
            if not self._not_kept:
                logger.error(text)
            self._not_kept = (QualityWarning("checkpoint-not-written", text),)
        else:
            self._not_kept = ()

    @property
    def statistics(self) -> NodeStatistics:
        """Counts and warnings of all turbines."""
        counts = self._of_the_past
        for node in self.members.values():
            counts += node.statistics
        gone = self._names.gone
        warnings = (too_many(f"{self._names.most} turbines", gone),) if gone else ()
        return counts + NodeStatistics(warnings=(*self._not_kept, *warnings))

    def close(self) -> None:
        """Nothing is held: snapshots are whole after every window."""


class LimitedMembers:
    """Names that messages came from, so many at most.

    When one more comes, the one with the fewest messages goes; of these, the one silent longest.
    So a flood of new names drives out names of the flood, and none that has sent for a while.
    """

    def __init__(self, most: int) -> None:
        self.gone = 0  # names that had to go
        self.most = most
        self._messages: dict[str, int] = {}  # by name, the longest silent first

    def note(self, name: str) -> str | None:
        """Mark `name` as recently used; return the evicted name, or None."""
        leaving = None
        if name not in self._messages and len(self._messages) >= self.most:
            leaving = min(self._messages, key=self._messages.__getitem__)  # the first of equals
            del self._messages[leaving]
            self.gone += 1
        self._messages[name] = self._messages.pop(name, 0) + 1
        return leaving


def too_many(limit: str, gone: int) -> QualityWarning:
    """Warn that members had to be let go, and how often."""
    return QualityWarning(
        "too-many-turbines",
        f"more than {limit}: {gone} times the one with fewest messages went",
    )
