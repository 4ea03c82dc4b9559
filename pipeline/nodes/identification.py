"""Identification: acceleration blocks in, one modal estimate a window out.

block ─► which blocks are used ─► a session of the turbine's units ─► windows ─► answers
         `BlockAdmission`         `units/acquisition_units`, `joined_session`    `_in_context`
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace

from pipeline.messages import (
    Message,
    ModalEstimate,
    QualityWarning,
    StreamEnd,
    WindowRejected,
    rejected_estimate,
    without_covariances,
)
from pipeline.nodes.by_turbine import NodeByTurbine, SnapshotStore, too_many
from pipeline.nodes.node import NodeSnapshot, NodeStatistics
from pipeline.nodes.operating_state import OperationLog
from pipeline.nodes.units.acquisition_units import (
    AcquisitionUnit,
    AcquisitionUnits,
    OpeningBlocks,
    UnitBlock,
    UnitSession,
)
from pipeline.nodes.units.joined_session import SILENT, IdentifiedSession, JoinedSession
from pipeline.nodes.units.resuming import IdentificationState, needed_messages
from pipeline.oma.settings import OmaSettings
from pipeline.oma.tracking import DIES_AFTER, ChannelSwapMonitor
from pipeline.oma.window_identification import WindowContext
from pipeline.oma.windows.block_admission import (
    DEFAULT_LIMITS,
    NO_LAYOUT,
    Admission,
    LimitSettings,
    window_refusal,
)
from pipeline.oma.work_limit import CpuClock, CpuLimit
from sensors.acquisition.blocks import AccelerationBlock, BlockMark
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

REPEATED_ANSWERS = 2  # that may not have reached a recording before a kill

WindowAnswer = ModalEstimate | WindowRejected


class TurbineIdentification:
    """Cuts one turbine's blocks into windows and identifies them.

    Answers every window with a ModalEstimate or a WindowRejected, and every gap with a StreamGap.
    Windows begin with a boot's first sample. Where the layouts name several acquisition units,
    these are joined on one clock; else a new boot of the unit begins another session.

    Every estimate carries the state, yaw and water level of its window by SCADA. What the link and
    the clock did wrong is reported with the next estimate; a window in which two channels have
    changed place is rejected.

    Parameters
    ----------
    compared : bool
        False: a caller that has all windows compares each one's channels with the window's before.
    limits : LimitSettings, optional
        What its units may cost.
    clock : callable, optional
        → CPU time of this thread [s]; None: a window may cost what it does.
    """

    def __init__(
        self,
        settings: OmaSettings,
        *,
        compared: bool = True,
        limits: LimitSettings = DEFAULT_LIMITS,
        clock: CpuClock | None = None,
    ) -> None:
        self.revision = 0
        self.units = AcquisitionUnits(settings, limits.units)
        self._limits = limits
        self._settings = settings
        self._compared = compared
        self._session: IdentifiedSession | None = None
        self._log = OperationLog()
        cpu = None if clock is None else CpuLimit(limits.cpu_seconds, clock)
        self._context = WindowContext(settings, self._log.rotor_speed, cpu)
        self._channels = ChannelSwapMonitor()
        self._answers: tuple[WindowAnswer, ...] = ()  # the latest
        self._opening = OpeningBlocks()
        self._resumable: IdentificationState | None = None  # of an identification that has ended

    def handle(self, message: Message) -> Iterator[Message]:
        """Yield the answers to a block or an announced end; layouts and SCADA are remembered."""
        for answer in map(self._in_context, self._answers_to(message)):
            yield answer
            if isinstance(answer, WindowAnswer):
                self._opening.answered()
                self._answers = _latest(self._answers, answer)
                self.units.forget_unread()
                self.revision += 1

    def finish(self) -> Iterator[Message]:
        """Yield the last answers of the session."""
        if self._session is not None:
            yield from map(self._in_context, self._end_session())

    def _answers_to(self, message: Message) -> Iterator[Message]:
        match message:
            case ScadaSample():
                self._log.note(message)
            case SensorLayout():
                self.units.note_layout(message)
            case AccelerationBlock():
                yield from self._admitted(self.units.named(message.unit), message)
            case StreamEnd():
                yield from self._ended(self.units.named(message.unit), message)

    def _admitted(self, unit: AcquisitionUnit, block: AccelerationBlock) -> Iterator[Message]:
        too_much = window_refusal(block, self._settings.window_duration, self._limits)
        if too_much is not None:
            unit.admission.refuse(too_much)
            return
        refusal = None if self._session is None else self._session.refusal(block)
        yield from self._take_all(unit, unit.admission.admit(block, refusal))

    def _take_all(self, unit: AcquisitionUnit, admission: Admission) -> Iterator[Message]:
        blocks = admission.blocks
        if admission.begins is not None:
            unit.begin(admission.begins)
            self.revision += 1
        if blocks and self._session is not None and self._session.refusal(blocks[0]) is not None:
            yield from self._end_session()
        for block in blocks:
            unit.monitor.note(block)
            unit.marks.append(BlockMark.of(block))
            yield from self._take(unit, block)

    def _take(self, unit: AcquisitionUnit, block: AccelerationBlock) -> Iterator[Message]:
        item = UnitBlock(block, unit.boot, unit.expected(block))
        if self._session is None or not self._session.goes_on_with(item):
            if self._waits(block):
                self._refuse_dropped(self._opening.wait(item))
                return
            yield from self._change_session(unit, item)
        assert self._session is not None
        mismatch = self._session.layout_mismatch(block)
        if mismatch is not None:
            unit.admission.refuse(mismatch)
            return
        if isinstance(self._session, UnitSession):
            self._refuse_dropped(self._opening.use(item))
            yield from self._session.push(item)
        else:
            yield from self._session.push(item)
            unit.note_joined(block)
            if self._session.has_lost_time:
                yield from self._begin_again(self._session.release())
                return
        yield from self._end_if_complete()

    def _begin_again(self, unused: Sequence[AccelerationBlock]) -> Iterator[Message]:
        """End the session; begin another one with the blocks that it could not use."""
        yield from self._end_session()
        for each in unused:
            if each.unit in self.units.by_name:
                yield from self._take(self.units.by_name[each.unit], each)

    def _waits(self, block: AccelerationBlock) -> bool:
        """Whether a block of another unit must wait: the layouts that join it with the unit that is
        identified travel on keys of their own and may come later. One without a layout never takes
        the place of one with a layout."""
        session = self._session
        if not isinstance(session, UnitSession) or block.unit in session.newest:
            return False
        layouts = self.units.latest_layouts
        if block.unit not in layouts and session.newest.keys() <= layouts.keys():
            return True
        return len(self._layouts_to_join(block)) < 2 and self._opening.waiting < SILENT

    def _refuse_dropped(self, dropped: UnitBlock | None) -> None:
        """Count a block that waited for layouts that did not come."""
        if dropped is not None and dropped.block.unit in self.units.by_name:
            text = "its layout, which would join it with the turbine's other unit, is not known"
            self.units.by_name[dropped.block.unit].admission.refuse(QualityWarning(NO_LAYOUT, text))

    def _change_session(self, unit: AcquisitionUnit, item: UnitBlock) -> Iterator[Message]:
        """Begin another session, with the blocks that waited for it; where it joins units, with
        those of the session before too, which then ends without an answer."""
        before, whole = self._session, self._opening.whole
        waiting = self._opening.taken()
        own = [each for each in waiting if each.block.unit == item.block.unit]
        of_boot = [each for each in own if each.boot == item.boot]
        self._session = self._new_session(unit, (*of_boot, item)[0])
        joins = isinstance(self._session, JoinedSession) and isinstance(before, UnitSession)
        if before is not None and not (joins and whole):
            yield from before.finish()
        for each in waiting:
            known = self.units.by_name.get(each.block.unit)
            fits = self._session.goes_on_with(each)
            if fits and known is not None and known.boot == each.boot:
                if self._session.layout_mismatch(each.block) is None:
                    yield from self._session.push(each)
            elif not each.used:
                self._refuse_dropped(each)

    def _new_session(self, unit: AcquisitionUnit, first: UnitBlock) -> IdentifiedSession:
        """Return the session that begins with a block, or goes on with it after a restart."""
        layouts = self._layouts_to_join(first.block)
        session: IdentifiedSession = (
            JoinedSession(layouts, self._context)
            if len(layouts) > 1
            else UnitSession(first, unit.layouts, self._context)
        )
        resumable, self._resumable = self._resumable, None
        if resumable is not None and resumable.boots.get(first.block.unit) == unit.boot:
            resumable.resume(session)
            for answer in self._answers:
                if isinstance(answer, ModalEstimate):
                    self._channels.swap_in(answer)
                session.windows.recall(answer)
        return session

    def _layouts_to_join(self, block: AccelerationBlock) -> list[SensorLayout]:
        """The latest layout of every unit, by their names; none where the block's is not known."""
        layouts = self.units.latest_layouts
        return [layouts[name] for name in sorted(layouts)] if block.unit in layouts else []

    def _ended(self, unit: AcquisitionUnit, end: StreamEnd) -> Iterator[Message]:
        unit.ends[end.session] = end
        yield from self._take_all(unit, unit.admission.note_end(end.session))
        yield from self._end_if_complete()

    def _end_if_complete(self) -> Iterator[Message]:
        """End a session whose ends and last blocks are all here, whichever came first: they
        travel on different keys, so an end may overtake blocks that had to be fetched again."""
        units = self.units.by_name
        if self._session is None or not any(unit.ends for unit in units.values()):
            return
        newest = self._session.newest
        if not newest.keys() <= units.keys():  # one was let go: its end is not known
            return
        if newest and all(units[unit].has_ended(*reached) for unit, reached in newest.items()):
            for unit, (name, _) in newest.items():
                del units[unit].ends[name]
            yield from self._end_session()

    def _end_session(self) -> Iterator[Message]:
        """Yield the session's last answers; blocks that waited for another one are refused."""
        session, self._session = self._session, None
        assert session is not None
        for each in self._opening.taken():
            if not each.used:
                self._refuse_dropped(each)
        yield from session.finish()

    def _in_context(self, answer: Message) -> Message:
        """An estimate with its window's conditions and warnings, or why it is none; other answers
        as they are."""
        if not isinstance(answer, ModalEstimate):
            return answer
        estimate = self._log.with_conditions(answer)
        still = self.units.still_channel(estimate)
        if still is not None:
            return rejected_estimate(estimate, "constant", still)
        conflict = self.units.conflict(estimate)
        if conflict is not None:
            return rejected_estimate(estimate, "conflicting-blocks", conflict)
        swapped = self._channels.swap_in(estimate) if self._compared else None
        if swapped is not None:
            return rejected_estimate(estimate, "swapped-channels", swapped)
        return replace(estimate, warnings=estimate.warnings + self.units.warnings(estimate))

    @property
    def statistics(self) -> NodeStatistics:
        """Blocks that were not used, and why."""
        unused = self._context.unused
        return NodeStatistics(
            late=unused["late"], duplicate=unused["duplicate"], rejected=self.units.refused
        )

    def snapshot(self) -> NodeSnapshot:
        """The numbers that windows go by; samples are read again from where they are kept."""
        state = IdentificationState.of(self.units, self._session)
        layouts = self.units.latest_layouts.values()
        return NodeSnapshot(state.encoded(), (*layouts, *self._answers))

    def restore(self, snapshot: NodeSnapshot, past: Iterable[Message]) -> Iterator[Message]:
        """Go on from a snapshot, with the samples that were recorded since.

        The latest answers are given once more: they may not have reached a recording.
        """
        state = IdentificationState.decoded(snapshot.state)
        for message in snapshot.messages:
            if isinstance(message, SensorLayout):
                self.units.note_layout(message)
        self._answers = tuple(each for each in snapshot.messages if isinstance(each, WindowAnswer))
        for name, admission in state.units.items():
            self.units.named(name).admission.resume(admission)
            self.units.named(name).beginning = None
        if state.session is not None:
            self._resumable = state
            for name, mark in state.marks.items():
                self.units.named(name).admission.begin_after(mark)
                self.units.named(name).monitor.resume(mark.session, mark.sequence)
        yield from self._answers[-REPEATED_ANSWERS:]
        for message in needed_messages(past, state.marks):
            yield from self.handle(message)


class IdentificationNode(NodeByTurbine[TurbineIdentification]):
    """The identification of any number of turbines.

    Parameters
    ----------
    compared : bool
        See `TurbineIdentification`.
    limits : LimitSettings, optional
        What a unit and a turbine may cost.
    store : SnapshotStore, optional
        Where it goes on from; None: it begins with nothing seen.
    past : sequence of Message
        What was recorded last, in the order of recording.
    clock : callable, optional
        See `TurbineIdentification`.
    """

    name = "identification"
    inputs = (SensorLayout, AccelerationBlock, StreamEnd, ScadaSample)

    def __init__(
        self,
        settings: OmaSettings | None = None,
        *,
        compared: bool = True,
        limits: LimitSettings = DEFAULT_LIMITS,
        store: SnapshotStore | None = None,
        past: Sequence[Message] = (),
        clock: CpuClock | None = None,
    ) -> None:
        chosen = settings or OmaSettings()
        super().__init__(
            lambda _: TurbineIdentification(chosen, compared=compared, limits=limits, clock=clock),
            store=store,
            past=past,
            most_turbines=limits.turbines,
        )
        self._limits = limits

    @property
    def statistics(self) -> NodeStatistics:
        """Counts and warnings of all turbines; what was refused is a warning too."""
        counts = super().statistics
        return counts + NodeStatistics(warnings=tuple(self._refusals(counts)))

    def _refusals(self, counts: NodeStatistics) -> Iterator[QualityWarning]:
        if counts.rejected:
            latest_first = reversed(self.members.items())
            refusals = (each.units.last_refusal(turbine) for turbine, each in latest_first)
            last = next(filter(None, refusals), "a unit that is gone")
            yield QualityWarning(
                "unfit-blocks",
                f"{counts.rejected.total()} blocks of another rate, shape, time or sender than "
                f"their unit's were refused; the last of {last}",
            )
        jumps = sum(each.units.sequence_jumps for each in self.members.values())
        if jumps:
            yield QualityWarning(
                "sequence-jump", f"block numbers jumped {jumps} times where no sample is missing"
            )
        gone = sum(each.units.gone for each in self.members.values())
        if gone:
            yield too_many(f"{self._limits.units} units of a turbine", gone)


def _latest(answers: tuple[WindowAnswer, ...], answer: WindowAnswer) -> tuple[WindowAnswer, ...]:
    """The latest answers, as many as modes' names need; those to be repeated are whole, of the
    others' covariances, a hundred times their size, nothing is needed."""
    latest = (*answers, answer)[-DIES_AFTER - 1 :]
    named, repeated = latest[:-REPEATED_ANSWERS], latest[-REPEATED_ANSWERS:]
    slim = (without_covariances(e) if isinstance(e, ModalEstimate) else e for e in named)
    return (*slim, *repeated)
