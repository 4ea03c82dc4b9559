"""IdentificationNode: acceleration blocks in, one modal estimate a window out."""

from collections.abc import Iterable, Iterator

from pipeline.messages import Message, ModalEstimate, StreamEnd, WindowRejected
from pipeline.nodes.gate import BlockGate, window_complaint
from pipeline.nodes.unit_sessions import JoinedSession, UnitSession
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout

LATEST_OF_A_UNIT = 8  # layouts and ends of sessions that are kept

Session = UnitSession | JoinedSession


class IdentificationNode:
    """Cuts each turbine's blocks into windows and identifies them.

    Answers every window with a ModalEstimate or a WindowRejected, and every gap with a StreamGap.
    Windows begin with the session's first sample. Where the layouts name several acquisition units
    of a turbine, these are joined on one clock; else a new session of the unit begins anew.
    """

    name = "identification"
    inputs: tuple[type, ...] = (SensorLayout, AccelerationBlock, StreamEnd)

    def __init__(self, settings: OmaSettings | None = None):
        self._settings = settings or OmaSettings()
        self._layouts: dict[str, SensorLayout] = {}
        self._sessions: dict[str, Session] = {}  # by turbine
        self._gates: dict[tuple[str, str], BlockGate] = {}  # by turbine and unit
        self._ends: dict[tuple[str, str, str], StreamEnd] = {}  # announced, blocks still missing
        self._late_of_ended = self._duplicate_of_ended = 0  # blocks of sessions that are over
        self._unfit_of_forgotten = 0  # blocks of units that were let go

    def handle(self, message: Message) -> Iterable[Message]:
        match message:
            case SensorLayout():
                self._note_layout(message)
            case AccelerationBlock():
                yield from self._admitted(message)
            case StreamEnd():
                self._note_end(message)
                yield from self._finish_if_complete(message.turbine)

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """Take up what an identification that has ended answered; needs the turbine's session."""
        if answer.turbine in self._sessions:
            self._sessions[answer.turbine].recall(answer)

    def forget(self, turbine: str) -> Iterator[Message]:
        """Let go of a turbine; what its session still has to say."""
        if turbine in self._sessions:
            yield from self._end_session(turbine)
        units = {unit for of, unit in self._gates if of == turbine}
        units |= {layout.unit for layout in self._layouts.values() if layout.turbine == turbine}
        units |= {unit for of, unit, _ in self._ends if of == turbine}
        for unit in units:
            self.forget_unit(turbine, unit)

    def forget_unit(self, turbine: str, unit: str) -> None:
        """Let go of a unit of a turbine; a session that it has part in goes on without it."""
        gate = self._gates.pop((turbine, unit), None)
        self._unfit_of_forgotten += 0 if gate is None else gate.unfit
        for layout_id in self._layout_ids(turbine, unit):
            del self._layouts[layout_id]
        for end in self._ends_of(turbine, unit):
            del self._ends[end]

    def _layout_ids(self, turbine: str, unit: str) -> list[str]:
        known = self._layouts.items()
        return [name for name, of in known if (of.turbine, of.unit) == (turbine, unit)]

    def _ends_of(self, turbine: str, unit: str) -> list[tuple[str, str, str]]:
        return [key for key in self._ends if key[:2] == (turbine, unit)]

    def close(self) -> None:
        """Nothing is held."""

    def _note_layout(self, layout: SensorLayout) -> None:
        """The latest of each unit are kept."""
        self._layouts.pop(layout.layout_id, None)
        self._layouts[layout.layout_id] = layout
        for oldest in self._layout_ids(layout.turbine, layout.unit)[:-LATEST_OF_A_UNIT]:
            del self._layouts[oldest]

    def _note_end(self, end: StreamEnd) -> None:
        """The latest of each unit are kept."""
        self._ends[end.turbine, end.unit, end.session] = end
        for oldest in self._ends_of(end.turbine, end.unit)[:-LATEST_OF_A_UNIT]:
            del self._ends[oldest]

    def _admitted(self, block: AccelerationBlock) -> Iterator[Message]:
        gate = self._gates.setdefault((block.turbine, block.unit), BlockGate())
        too_much = window_complaint(block, self._settings.window_duration)
        if too_much:
            gate.refuse(too_much)
            return
        session = self._sessions.get(block.turbine)
        admission = gate.admit(block, "" if session is None else session.refusal(block))
        if admission.anew and block.turbine in self._sessions:
            yield from self._end_session(block.turbine)
        for each in admission.blocks:
            yield from self._take(each)

    def _take(self, block: AccelerationBlock) -> Iterator[Message]:
        session = self._sessions.get(block.turbine)
        if session is None or not session.goes_on_with(block):
            if session is not None:
                yield from self._end_session(block.turbine)
            session = self._sessions[block.turbine] = self._new_session(block)
        misfit = session.misfit(block)
        if misfit:
            self._gates[block.turbine, block.unit].refuse(misfit)
            return
        yield from session.push(block)
        yield from self._finish_if_complete(block.turbine)

    def _new_session(self, block: AccelerationBlock) -> Session:
        units = {
            layout.unit: layout
            for layout in self._layouts.values()
            if layout.turbine == block.turbine
        }
        if len(units) > 1 and block.unit in units:
            layouts = [units[unit] for unit in sorted(units)]
            return JoinedSession(layouts, self._settings)
        return UnitSession(block, self._settings, self._layouts)

    def _finish_if_complete(self, turbine: str) -> Iterator[Message]:
        """Finish a session whose ends and last blocks are all here, whichever came first: they
        travel on different keys, so an end may overtake blocks that had to be fetched again."""
        session = self._sessions.get(turbine)
        if session is None:
            return
        ends = [self._ends.get((turbine, unit, name)) for unit, (name, _) in session.newest.items()]
        newest = [newest_ns for _, newest_ns in session.newest.values()]
        if all(
            end is not None and reached >= end.time_ns
            for end, reached in zip(ends, newest, strict=True)
        ):
            for unit, (name, _) in session.newest.items():
                del self._ends[turbine, unit, name]
            yield from self._end_session(turbine)

    def _end_session(self, turbine: str) -> Iterator[Message]:
        """What a session still has to say; its blocks stay counted."""
        session = self._sessions.pop(turbine)
        self._late_of_ended += session.late
        self._duplicate_of_ended += session.duplicate
        yield from session.finish()

    @property
    def late(self) -> int:
        """Blocks that came too late to be used."""
        return self._late_of_ended + sum(session.late for session in self._sessions.values())

    @property
    def duplicate(self) -> int:
        """Blocks that came twice."""
        return self._duplicate_of_ended + sum(
            session.duplicate for session in self._sessions.values()
        )

    @property
    def unfit(self) -> int:
        """Blocks that did not fit their unit's session and were dropped."""
        return self._unfit_of_forgotten + sum(gate.unfit for gate in self._gates.values())

    @property
    def complaint(self) -> str:
        """Of one of them: whose it was and what was wrong; "" where there are none."""
        for (turbine, unit), gate in reversed(self._gates.items()):
            if gate.unfit:
                return f"unit {unit} of {turbine}: {gate.complaint}"
        return ""
