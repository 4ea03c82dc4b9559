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
    updating: UpdatingPlan | None
    """None: modes only."""
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
    answers: tuple[StoredFrame, ...]
    """Of its tasks, in order of time."""


def day_frames(call: DayCall) -> tuple[StoredFrame, ...]:
    """Messages and stretches in order, then the state after the day."""
    plan = call.plan
    state = dict(call.state)
    tracked = None
    if TRACKED in state:
        tracked = decoded_checkpoint(state[TRACKED], TrackingState, plan.owner, origin="tracking")
    tracking = ArchiveTracking(plan.channels, plan.hop, tracked)
    followed = tracking.followed(kept_messages(call.answers))
    frames: list[StoredFrame] = []
    if plan.updating is None:
        frames += kept_frames(followed)
    else:
        before = _saved_pass(state[UPDATED]) if UPDATED in state else None
        updating = PosteriorPass(plan.updating, _done_at_once, before)
        for each in updating.answers(followed):
            frames += [_stretch_frame(each)] if isinstance(each, Call) else kept_frames([each])
        frames.append((UPDATED, _saved_bytes(updating.saved)))
    frames.append((TRACKED, encoded_checkpoint(tracking.state, plan.owner)))
    return tuple(frames)


def _done_at_once(key: str, make: Callable[[], tuple[StoredFrame, ...]]) -> tuple[StoredFrame, ...]:
    return make()


def _stretch_frame(call: Call) -> StoredFrame:
    stretch: StretchCall = call.argument
    parts = (stretch.state, *stretch.estimates)
    return (STRETCH, b"".join(_LENGTH.pack(len(part)) + part for part in parts))


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
        _stretch_call(plan, content) if kind == STRETCH else (kind, content)
        for kind, content in frames
        if kind not in states
    ]
    return PassedDay(tuple(entries), tuple(each for each in frames if each[0] in states))


def _stretch_call(plan: HistoryPlan, content: bytes) -> Call:
    parts, place = [], 0
    while place < len(content):
        (length,) = _LENGTH.unpack_from(content, place)
        place += _LENGTH.size
        parts.append(content[place : place + length])
        place += length
    assert plan.updating is not None
    stretch = StretchCall(plan.updating, parts[0], tuple(parts[1:]))
    return Call(stretch.key, posteriors, stretch)
