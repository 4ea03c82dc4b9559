"""IdentificationNode: acceleration blocks in, one modal estimate a window out."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Generic, Protocol, TypeVar

from pipeline.messages import (
    Message,
    ModalEstimate,
    QualityWarning,
    StreamEnd,
    WindowRejected,
)
from pipeline.nodes.block_admission import BlockAdmission, window_complaint
from pipeline.nodes.by_turbine import MOST_TURBINES, MOST_UNITS, LimitedMembers, told_of_gone
from pipeline.nodes.operating_state import OperationLog, rejected_estimate
from pipeline.nodes.unit_streams import JoinedSession, UnitSession
from pipeline.oma.data_quality.block_monitor import BlockMonitor
from pipeline.oma.data_quality.channel_swap import ChannelSwapMonitor
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

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
        self._gates: dict[tuple[str, str], BlockAdmission] = {}  # by turbine and unit
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
        gate = self._gates.setdefault((block.turbine, block.unit), BlockAdmission())
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


class Accounted(Protocol):
    """What every identification tells of the blocks that it was given."""

    @property
    def late(self) -> int: ...

    @property
    def duplicate(self) -> int: ...

    def close(self) -> None: ...


Inner = TypeVar("Inner", bound=Accounted)


class Coat(Generic[Inner]):
    """Holds the inner node; whoever wears it writes `handle`."""

    def __init__(self, inner: Inner) -> None:
        self._inner = inner

    def close(self) -> None:
        """Close the inner node."""
        self._inner.close()

    @property
    def late(self) -> int:
        """Blocks that came when their window was over, by the inner node's account."""
        return self._inner.late

    @property
    def duplicate(self) -> int:
        """Blocks that came twice, by the inner node's account."""
        return self._inner.duplicate


class IdentificationInContext(Coat[IdentificationNode]):
    """The identification with what it knows of operation, clock, link and wiring.

    Every estimate carries the state, yaw and water level of its window by SCADA. What the link and
    the clock did wrong is told with the next estimate; a window in which two channels have changed
    place is rejected.

    compared   False: whoever has all windows compares each one's channels with the window's before
    """

    name = "identification"
    inputs: tuple[type, ...] = (*IdentificationNode.inputs, ScadaSample)

    def __init__(self, settings: OmaSettings | None = None, *, compared: bool = True) -> None:
        self._compared = compared
        self._settings = settings or OmaSettings()
        super().__init__(IdentificationNode(self._settings))
        self._log = OperationLog()
        self._blocks: dict[str, dict[str, BlockMonitor]] = {}  # by turbine and unit
        self._layouts: dict[tuple[str, str], SensorLayout] = {}  # by turbine and unit
        self._channels: dict[str, ChannelSwapMonitor] = {}
        self._turbines = LimitedMembers(MOST_TURBINES)
        self._units: dict[str, LimitedMembers] = {}  # by turbine
        self._units_gone = 0  # that were let go because their turbine had too many

    def handle(self, message: Message) -> Iterator[Message]:
        yield from self._make_room(message)
        if isinstance(message, ScadaSample):
            self._log.note(message)
            return
        if isinstance(message, AccelerationBlock):
            units = self._blocks.setdefault(message.turbine, {})
            units.setdefault(message.unit, BlockMonitor(self._settings.lateness)).note(message)
        if isinstance(message, SensorLayout):
            self._layouts[message.turbine, message.unit] = message
        yield from self._answers(self._inner.handle(message))

    def _answers(self, inner: Iterable[Message]) -> Iterator[Message]:
        for answer in inner:
            yield self._in_context(answer) if isinstance(answer, ModalEstimate) else answer

    def _make_room(self, message: Message) -> Iterator[Message]:
        """Let go of a turbine, or of a unit of one, where there are too many with this one."""
        leaving = self._turbines.heard(message.turbine)
        if leaving is not None:
            yield from self._answers(self._inner.forget(leaving))
            self._log.forget(leaving)
            self._blocks.pop(leaving, None)
            self._channels.pop(leaving, None)
            self._units.pop(leaving, None)
            for key in [key for key in self._layouts if key[0] == leaving]:
                del self._layouts[key]
        if isinstance(message, (AccelerationBlock, SensorLayout, StreamEnd)):
            units = self._units.setdefault(message.turbine, LimitedMembers(MOST_UNITS))
            silent = units.heard(message.unit)
            if silent is not None:
                self._units_gone += 1
                self._inner.forget_unit(message.turbine, silent)
                self._blocks.get(message.turbine, {}).pop(silent, None)
                self._layouts.pop((message.turbine, silent), None)

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """Take up what an identification that has ended answered, so that modes keep their names
        and channels are compared with the last good window's."""
        if isinstance(answer, ModalEstimate):
            self._channels.setdefault(answer.turbine, ChannelSwapMonitor()).swap_in(answer)
        self._inner.recall(answer)

    def _in_context(self, estimate: ModalEstimate) -> ModalEstimate | WindowRejected:
        estimate = self._log.with_conditions(estimate)
        still = self._still_channel(estimate)
        if still is not None:
            return rejected_estimate(estimate, "constant", still)
        if self._compared:
            watch = self._channels.setdefault(estimate.turbine, ChannelSwapMonitor())
            swapped = watch.swap_in(estimate)
            if swapped is not None:
                return rejected_estimate(estimate, "swapped-channels", swapped)
        doubts = self._link_and_clock_doubts(estimate)
        return replace(estimate, warnings=estimate.warnings + doubts)

    def _still_channel(self, estimate: ModalEstimate) -> str | None:
        """Which channel of the estimate kept one value for a while, in words."""
        for unit, watch in self._blocks[estimate.turbine].items():
            still = watch.still_channel(estimate.start_ns, estimate.end_ns)
            if still is None:
                continue
            channel, since = still
            layout = self._layouts.get((estimate.turbine, unit))
            names = layout.channel_names if layout else estimate.channels
            for name in names[channel : channel + 1]:  # a layout may not be that of the blocks
                for known_as in (name, f"{unit}/{name}"):  # the latter where two units have one
                    if known_as in estimate.channels:
                        return f"{known_as} stands still from {since:.0f} s on"
        return None

    def _link_and_clock_doubts(self, estimate: ModalEstimate) -> tuple[QualityWarning, ...]:
        """What link and clock of every unit did wrong; of several units, each by its name."""
        units = self._blocks[estimate.turbine]
        return tuple(
            replace(doubt, text=f"unit {unit}: {doubt.text}") if len(units) > 1 else doubt
            for unit, watch in units.items()
            for doubt in watch.warnings_until(estimate.end_ns)
        )

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """What the node says in its status beside its counts."""
        said = []
        if self._inner.unfit:
            said.append(
                QualityWarning(
                    "unfit-blocks",
                    f"{self._inner.unfit} blocks of another rate, shape or time than their "
                    f"session's were dropped; the last of {self._inner.complaint}",
                )
            )
        gone = self._turbines.gone + self._units_gone
        limits = f"{MOST_TURBINES} turbines and {MOST_UNITS} units of a turbine"
        return (*said, *told_of_gone(gone, limits))
