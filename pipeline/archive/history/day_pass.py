"""One day of a turbine's history, on a worker: tracking, sums and anchors from the day before's.

    state ─► [tracking] ─► [sums, anchors] ─► messages, stretches whose posteriors are wanted, state

A day begins from the bytes that the day before has left, in every run: so a run that continues
gives the bits of one that begins with the first day.
"""

import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pipeline.archive.compact import kept_frames, kept_messages
from pipeline.archive.posteriors import (
    PosteriorPass,
    SavedPass,
    StretchCall,
    UpdatingPlan,
    posteriors,
)
from pipeline.archive.store import StoredFrame
from pipeline.archive.tracking import ArchiveTracking, TrackingState
from pipeline.archive.work import Call
from pipeline.messages import Message
from pipeline.updating.checkpoint import CheckpointOwner, decoded_checkpoint, encoded_checkpoint

STRETCH, TRACKED, UPDATED = "Stretch", "TrackingState", "SavedPass"  # kinds of frames
_LENGTH = struct.Struct("<I")


@dataclass(frozen=True, slots=True, eq=False)
class HistoryPlan:
    """What makes a turbine's history from its identified windows."""

    turbine: str
    channels: tuple[str, ...]
    """That any window may have."""
    hop: float
    """From one window's start to the next one's [s]."""
    updating: tuple[UpdatingPlan, ...]
    """Of each layout period, in order of time; () modes only."""
    key: str
    """Fingerprint of all of it, and of how windows are identified."""

    @property
    def owner(self) -> CheckpointOwner:
        """Whose tracking it is."""
        return CheckpointOwner(self.turbine, self.channels, (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True, eq=False)
class DayCall:
    """One day's windows, after those before."""

    plan: HistoryPlan
    state: tuple[StoredFrame, ...]
    """That the day before has left; () there is none."""
    answers: tuple[tuple[int, tuple[StoredFrame, ...]], ...]
    """Of its tasks, in order of time: those in a row of one layout period, under its number."""


def day_frames(call: DayCall) -> tuple[StoredFrame, ...]:
    """Messages and stretches in order, then the state after the day."""
    plan = call.plan
    state = dict(call.state)
    tracked = None
    if TRACKED in state:
        tracked = decoded_checkpoint(state[TRACKED], TrackingState, plan.owner, origin="tracking")
    tracking = ArchiveTracking(plan.channels, plan.hop, tracked)
    frames: list[StoredFrame] = []
    updating = _Updating(plan, state)
    for period, answers in call.answers:
        frames += updating.frames(period, tracking.followed(kept_messages(answers)))
    frames += updating.saved
    frames.append((TRACKED, encoded_checkpoint(tracking.state, plan.owner)))
    return tuple(frames)


class _Updating:
    """The passes over a day's windows: one, or where the layout changes one each."""

    def __init__(self, plan: HistoryPlan, state: dict[str, bytes]) -> None:
        self._plan = plan
        self._period: int | None = None
        self._pass: PosteriorPass | None = None
        for kind, content in state.items():
            if _kind_of(kind) == UPDATED:
                self._begin(_number_of(kind), _saved_pass(content))

    def _begin(self, period: int, before: SavedPass | None = None) -> PosteriorPass:
        self._period = period
        self._pass = PosteriorPass(self._plan.updating[period], _done_at_once, before)
        return self._pass

    def frames(self, period: int, followed: Iterator[Message]) -> Iterator[StoredFrame]:
        """Yield windows, and what follows from them, of one layout period."""
        if not self._plan.updating:
            yield from kept_frames(followed)
            return
        going_on = self._pass if period == self._period else None
        for each in (going_on or self._begin(period)).answers(followed):
            if isinstance(each, Call):
                yield _stretch_frame(each, period)
            else:
                yield from kept_frames([each])

    @property
    def saved(self) -> Iterator[StoredFrame]:
        """The state after the day."""
        if self._pass is not None and self._period is not None:
            yield (_numbered(UPDATED, self._period), _saved_bytes(self._pass.saved))


def _numbered(kind: str, period: int) -> str:
    """Return the kind of a frame of a layout period; the first has none, as in earlier versions."""
    return f"{kind} {period}" if period else kind


def _kind_of(kind: str) -> str:
    return kind.partition(" ")[0]


def _number_of(kind: str) -> int:
    return int(kind.partition(" ")[2] or 0)


def _done_at_once(key: str, make: Callable[[], tuple[StoredFrame, ...]]) -> tuple[StoredFrame, ...]:
    return make()


def _stretch_frame(call: Call, period: int) -> StoredFrame:
    stretch: StretchCall = call.argument
    parts = (stretch.state, *stretch.estimates)
    return (_numbered(STRETCH, period), b"".join(_LENGTH.pack(len(part)) + part for part in parts))


def _saved_bytes(saved: SavedPass) -> bytes:
    return json.dumps(saved.since_anchor).encode() + b"\n" + saved.state


def _saved_pass(content: bytes) -> SavedPass:
    since_anchor, _, state = content.partition(b"\n")
    return SavedPass(state, json.loads(since_anchor))


@dataclass(frozen=True, slots=True, eq=False)
class PassedDay:
    """What `day_frames` gave."""

    entries: tuple[StoredFrame | Call, ...]
    """In order; a call gives its posteriors."""
    state: tuple[StoredFrame, ...]
    """After the day."""

    @property
    def calls(self) -> Iterator[Call]:
        """Whose posteriors are wanted."""
        return (each for each in self.entries if isinstance(each, Call))

    def messages(self, results: Callable[[str], tuple[StoredFrame, ...]]) -> Iterator[Message]:
        """Yield all of the day's messages in order.

        Parameters
        ----------
        results : callable
            Key → the frames that its call has given.
        """
        for each in self.entries:
            yield from kept_messages(results(each.key) if isinstance(each, Call) else (each,))


def passed_day(plan: HistoryPlan, frames: tuple[StoredFrame, ...]) -> PassedDay:
    """Return the day, taken apart."""
    states = (TRACKED, UPDATED)
    entries = [
        _stretch_call(plan.updating[_number_of(kind)], content)
        if _kind_of(kind) == STRETCH
        else (kind, content)
        for kind, content in frames
        if _kind_of(kind) not in states
    ]
    return PassedDay(tuple(entries), tuple(each for each in frames if _kind_of(each[0]) in states))


def _stretch_call(plan: UpdatingPlan, content: bytes) -> Call:
    parts, place = [], 0
    while place < len(content):
        (length,) = _LENGTH.unpack_from(content, place)
        place += _LENGTH.size
        parts.append(content[place : place + length])
        place += length
    stretch = StretchCall(plan, parts[0], tuple(parts[1:]))
    return Call(stretch.key, posteriors, stretch)
