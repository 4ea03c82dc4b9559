"""Where a turbine's identification goes on after a restart: what a snapshot holds, which of the
recorded blocks are read again."""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from pipeline.messages import Message
from pipeline.nodes.units.acquisition_units import AcquisitionUnits
from pipeline.nodes.units.joined_session import IdentifiedSession, JoinedSession
from pipeline.oma.windows.block_admission import Boot
from pipeline.oma.windows.windowing import Beginning
from sensors.acquisition.blocks import AccelerationBlock, BlockMark
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

OVERTAKING = 10  # messages by which a block may have come before one that lies before it


@dataclass(frozen=True, slots=True)
class IdentificationState:
    """The numbers that windows go by; samples are read again from where they are kept."""

    units: Mapping[str, Any]
    """Unit → state of its admission."""
    boots: dict[str, Boot]
    """Unit → its present boot."""
    joined: bool
    """Whether the session is one of several units."""
    session: Mapping[str, Any] | None
    """State of the session; None where there is none."""
    marks: dict[str, BlockMark]
    """Unit → its first block that is needed."""

    @classmethod
    def of(
        cls, units: AcquisitionUnits, session: IdentifiedSession | None
    ) -> "IdentificationState":
        """Return what a running identification must not forget."""
        needed = {} if session is None else session.needed()
        known = units.by_name  # a unit of the session may have been let go
        marks = {n: known[n].mark_before(first) for n, first in needed.items() if n in known}
        return cls(
            {name: unit.admission.state() for name, unit in units.by_name.items()},
            {name: unit.boot for name, unit in units.by_name.items()},
            isinstance(session, JoinedSession),
            None if session is None else session.state(),
            {name: mark for name, mark in marks.items() if mark is not None},
        )

    def encoded(self) -> bytes:
        """Return the bytes that a snapshot holds."""
        return json.dumps(asdict(self)).encode()

    @classmethod
    def decoded(cls, encoded: bytes) -> "IdentificationState":
        """Return what `encoded` gave."""
        state = json.loads(encoded)
        return cls(
            state["units"],
            {name: Boot(*boot) for name, boot in state["boots"].items()},
            state["joined"],
            state["session"],
            {name: BlockMark(**mark) for name, mark in state["marks"].items()},
        )

    def resume(self, session: IdentifiedSession) -> None:
        """Let a new session go on with the first window that is not answered."""
        assert self.session is not None
        if isinstance(session, JoinedSession):
            session.resume_boots(self.boots)
        if self.joined == isinstance(session, JoinedSession):
            needed = {n: Beginning(m.first_sample, m.sequence) for n, m in self.marks.items()}
            session.resume(self.session, needed)


def needed_messages(past: Iterable[Message], marks: dict[str, BlockMark]) -> Iterator[Message]:
    """Yield what was recorded since the blocks with these marks, they included, in its order.

    Parameters
    ----------
    past : iterable of Message
        Of one turbine, in the order of recording.
    marks : dict
        Unit → its first block that is needed.
    """
    messages = list(past)
    blocks = {n: each for n, each in enumerate(messages) if isinstance(each, AccelerationBlock)}
    first = {
        unit: max(
            (n for n, b in blocks.items() if b.unit == unit and BlockMark.of(b) == mark),
            default=None,
        )
        for unit, mark in marks.items()
    }
    for number, message in enumerate(messages):
        if isinstance(message, AccelerationBlock):
            marked = first.get(message.unit)
            if marked is None or number < marked - OVERTAKING:
                continue
            if number >= marked or _follows(message, marks[message.unit]):
                yield message
        elif isinstance(message, SensorLayout | ScadaSample):
            yield message


def _follows(block: AccelerationBlock, mark: BlockMark) -> bool:
    """Whether a block that came before the marked one lies behind it."""
    return block.session == mark.session and (
        mark.first_sample < block.first_sample <= mark.first_sample + OVERTAKING * mark.n_samples
        and mark.start_ns < block.start_ns
    )
