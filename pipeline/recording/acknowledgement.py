"""Which blocks are on disk: what a recorder acknowledges to their units.

block ──► noted ──► file and folder synced ──► RecordedUntil ──► the unit lets go of it
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce

from pipeline.messages import BlockRange, RecordedUntil
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.bounded_dict import BoundedDict

MOST_RANGES = 64  # of a session, in one acknowledgement; of more the latest to grow
MOST_ACKNOWLEDGED = 2000  # that are remembered; of more the silent ones go
FOLLOWS_WITHIN = 0.5  # of stamps between two blocks that follow each other [s]

SessionKey = tuple[str, str, str]  # turbine, unit, session


@dataclass(slots=True)
class _Run:
    """Blocks that follow each other by number and by stamp."""

    first: int
    end: int
    first_ns: int
    """Stamp of the first."""
    end_ns: int
    """Stamp at which the next one begins."""
    earliest_ns: int
    latest_ns: int

    @classmethod
    def of(cls, block: AccelerationBlock) -> "_Run":
        start_ns = block.start_ns
        return cls(block.sequence, block.sequence + 1, start_ns, block.end_ns, start_ns, start_ns)

    @property
    def range(self) -> BlockRange:
        return BlockRange(self.first, self.end, self.earliest_ns, self.latest_ns)

    def has(self, block: "_Run") -> bool:
        return self.range.has(block.first, block.first_ns)

    def is_followed_by(self, other: "_Run") -> bool:
        apart = abs(other.first_ns - self.end_ns)
        return self.end == other.first and apart <= FOLLOWS_WITHIN * NANOSECONDS


class Acknowledgements:
    """Collects the blocks of units while they are written, and acknowledges them once synced."""

    def __init__(self) -> None:
        self._noted: list[tuple[SessionKey, _Run]] = []
        self._synced: list[tuple[SessionKey, _Run]] = []  # and not acknowledged yet
        self._runs = BoundedDict[SessionKey, list[_Run]](MOST_ACKNOWLEDGED)

    def note(self, block: AccelerationBlock) -> None:
        """Take note of a block that was written, or that had been written before."""
        self._noted.append(((block.turbine, block.unit, block.session), _Run.of(block)))

    def forget(self, *, synced: bool = False) -> None:
        """What was noted since the last sync is not on disk.

        Parameters
        ----------
        synced : bool, optional
            Nor is what was synced and is not acknowledged yet: its file has gone.
        """
        self._noted.clear()
        if synced:
            self._synced.clear()

    def sync(self) -> int:
        """Take note that the disk has all this; how many blocks are to be acknowledged."""
        self._synced += self._noted
        self._noted.clear()
        return len(self._synced)

    def acknowledged(self, now_ns: int) -> tuple[RecordedUntil, ...]:
        """Acknowledge every block that was synced.

        Parameters
        ----------
        now_ns : int
            Clock of this machine [ns since 1970-01-01 UTC].
        """
        grown: dict[SessionKey, None] = {}
        for key, block in self._synced:
            runs = self._runs.pop(key, [])
            self._runs[key] = _with_block(runs, block)
            grown[key] = None
        self._synced.clear()
        return tuple(
            RecordedUntil(*key, now_ns, _ranges(self._runs[key]))
            for key in grown
            if key in self._runs
        )


def _with_block(runs: list[_Run], block: _Run) -> list[_Run]:
    """Return the runs with one block more; the one that has it comes last."""
    if any(run.has(block) for run in reversed(runs)):
        return runs
    if runs and runs[-1].is_followed_by(block) and len(runs) == 1:  # as nearly always
        return [_joined(runs[0], block)]
    before = [run for run in runs if run.is_followed_by(block)][-1:]
    after = [run for run in runs if block.is_followed_by(run)][-1:]
    others = [run for run in runs if run not in (*before, *after)]
    return [*others, reduce(_joined, (*before, block, *after))][-MOST_RANGES:]


def _joined(one: _Run, other: _Run) -> _Run:
    return _Run(
        one.first,
        other.end,
        one.first_ns,
        other.end_ns,
        min(one.earliest_ns, other.earliest_ns),
        max(one.latest_ns, other.latest_ns),
    )


def _ranges(runs: Iterable[_Run]) -> tuple[BlockRange, ...]:
    return tuple(sorted((run.range for run in runs), key=lambda each: each.latest_ns))
