"""Identification: acceleration blocks in, one modal estimate a window out."""

import json
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace

from pipeline.messages import (
    Message,
    ModalEstimate,
    QualityWarning,
    StreamEnd,
    WindowRejected,
)
from pipeline.nodes.block_admission import (
    DEFAULT_LIMITS,
    NO_LAYOUT,
    Admission,
    BlockAdmission,
    BlockMark,
    Refusal,
    window_refusal,
)
from pipeline.nodes.by_turbine import LimitedMembers, NodeByTurbine, SnapshotStore, too_many
from pipeline.nodes.limits import LimitSettings
from pipeline.nodes.node import NodeSnapshot, NodeStatistics
from pipeline.nodes.operating_state import OperationLog, rejected_estimate
from pipeline.nodes.unit_streams import (
    SILENT,
    Boot,
    JoinedSession,
    OpeningBlock,
    OpeningBlocks,
    UnitSession,
)
from pipeline.nodes.window_identification import CpuClock, CpuLimit
from pipeline.oma.data_quality.block_monitor import BlockMonitor
from pipeline.oma.data_quality.channel_swap import ChannelSwapMonitor
from pipeline.oma.settings import OmaSettings
from pipeline.oma.tracking import DIES_AFTER
from pipeline.oma.windows.windowing import Beginning
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

OVERTAKING = 10  # messages by which a block may have come before one that lies before it
LATEST_OF_A_UNIT = 8  # layouts and ends of sessions that are kept
MARKS = 10_000  # of a unit's latest blocks: where a restart reads on
SAID_AGAIN = 2  # answers that may not have reached a recording before a kill

IdentifiedSession = UnitSession | JoinedSession
WindowAnswer = ModalEstimate | WindowRejected


class _Unit:
    """What is remembered of one acquisition unit."""

    def __init__(self, lateness: float) -> None:
        self.admission = BlockAdmission()
        self.monitor = BlockMonitor(lateness)
        self.layouts: dict[str, SensorLayout] = {}  # by their ids, the latest last
        self.ends: dict[str, StreamEnd] = {}  # by session: announced, blocks still missing
        self.marks: deque[BlockMark] = deque(maxlen=MARKS)  # of the present boot
        self.beginning = Beginning()  # where the present boot was expected to begin

    @property
    def layout(self) -> SensorLayout | None:
        """The latest."""
        return next(reversed(self.layouts.values()), None)

    @property
    def boot(self) -> Boot:
        """The present one."""
        return Boot(self.admission.session or "", self.admission.boot)


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
    settings : OmaSettings
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
        self._limits = limits
        self._cpu = None if clock is None else CpuLimit(limits.cpu_seconds, clock)
        self._settings = settings
        self._compared = compared
        self._units: dict[str, _Unit] = {}
        self._names = LimitedMembers(limits.units)
        self._session: IdentifiedSession | None = None
        self._layouts: dict[str, SensorLayout] = {}  # of all units, by their ids
        self._log = OperationLog()
        self._channels = ChannelSwapMonitor()
        self._of_the_past = NodeStatistics()  # of sessions and units that are gone
        self._answers: tuple[WindowAnswer, ...] = ()  # the latest
        self._opening = OpeningBlocks()
        self._resumable: _Resumable | None = None  # session of an identification that has ended

    def handle(self, message: Message) -> Iterator[Message]:
        """The answers to a block; other messages say what they mean."""
        for answer in self._answers_to(message):
            said = self._in_context(answer) if isinstance(answer, ModalEstimate) else answer
            yield said
            if isinstance(said, WindowAnswer):
                self._keep(said)

    def _keep(self, answer: WindowAnswer) -> None:
        self._opening.answered()
        answers = (*self._answers, answer)[-DIES_AFTER - 1 :]
        before, latest = answers[:-SAID_AGAIN], answers[-SAID_AGAIN:]
        self._answers = (*map(_without_covariances, before), *latest)
        self.revision += 1

    def _answers_to(self, message: Message) -> Iterator[Message]:
        match message:
            case ScadaSample():
                self._log.note(message)
            case SensorLayout():
                self._note_layout(self._unit(message.unit), message)
            case AccelerationBlock():
                yield from self._admitted(self._unit(message.unit), message)
            case StreamEnd():
                yield from self._ended(self._unit(message.unit), message)

    def finish(self) -> Iterator[Message]:
        """What the session still has to say."""
        if self._session is not None:
            for answer in self._end_session():
                yield self._in_context(answer) if isinstance(answer, ModalEstimate) else answer

    def recall(self, answer: WindowAnswer) -> None:
        """Take up what an identification that has ended answered, so that modes keep their names
        and channels are compared with the last good window's."""
        if isinstance(answer, ModalEstimate):
            self._channels.swap_in(answer)
        if self._session is not None:
            self._session.recall(answer)

    def _unit(self, name: str) -> _Unit:
        """What is remembered of a unit; of too many, the one with the fewest messages goes."""
        leaving = self._names.heard(name)
        if leaving is not None and leaving in self._units:
            gone = self._units.pop(leaving)
            refused = NodeStatistics(rejected=gone.admission.refused)
            self._of_the_past = self._of_the_past + refused
            for layout_id in gone.layouts:
                self._layouts.pop(layout_id, None)
        if name not in self._units:
            self._units[name] = _Unit(self._settings.lateness)
        return self._units[name]

    def _note_layout(self, unit: _Unit, layout: SensorLayout) -> None:
        """The latest of each unit are kept."""
        for layouts in (unit.layouts, self._layouts):
            layouts.pop(layout.layout_id, None)
            layouts[layout.layout_id] = layout
        for oldest in list(unit.layouts)[:-LATEST_OF_A_UNIT]:
            del unit.layouts[oldest]
            self._layouts.pop(oldest, None)

    def _ended(self, unit: _Unit, end: StreamEnd) -> Iterator[Message]:
        unit.ends[end.session] = end
        for oldest in list(unit.ends)[:-LATEST_OF_A_UNIT]:
            del unit.ends[oldest]
        admission = unit.admission.note_end(end.session)
        if admission.blocks:
            yield from self._taken(unit, admission)
        yield from self._finish_if_complete()

    def _admitted(self, unit: _Unit, block: AccelerationBlock) -> Iterator[Message]:
        too_much = window_refusal(block, self._settings.window_duration, self._limits)
        if too_much is not None:
            unit.admission.refuse(too_much)
            return
        refusal = None if self._session is None else self._session.refusal(block)
        yield from self._taken(unit, unit.admission.admit(block, refusal))

    def _taken(self, unit: _Unit, admission: Admission) -> Iterator[Message]:
        if admission.begins is not None:
            unit.beginning = admission.begins
            unit.monitor.restart()
            unit.marks.clear()
            self.revision += 1
        blocks = admission.blocks
        if blocks and self._session is not None and self._session.refusal(blocks[0]) is not None:
            yield from self._end_session()
        for block in blocks:
            unit.monitor.note(block)
            unit.marks.append(BlockMark.of(block))
            yield from self._take(unit, block)

    def _take(self, unit: _Unit, block: AccelerationBlock) -> Iterator[Message]:
        boot = unit.boot
        begins = not unit.marks or unit.marks[0] == BlockMark.of(block)
        beginning = unit.beginning if begins else Beginning(block.first_sample, block.sequence)
        opening = OpeningBlock(block, boot, beginning)
        if self._session is None or not self._session.goes_on_with(block, boot):
            if self._waits(block):
                self._refuse_dropped(self._opening.wait(opening))
                return
            yield from self._changed(unit, opening)
        assert self._session is not None
        misfit = self._session.misfit(block)
        if misfit is not None:
            unit.admission.refuse(misfit)
            return
        if isinstance(self._session, UnitSession):
            self._refuse_dropped(self._opening.use(opening))
        yield from self._session.push(block, boot, beginning)
        if self._session.has_lost_time:
            unused = self._session.release()
            yield from self._end_session()
            for each in unused:
                yield from self._take(self._units[each.unit], each)
            return
        yield from self._finish_if_complete()

    def _waits(self, block: AccelerationBlock) -> bool:
        """Whether a block of another unit must wait: the layouts that join it with the unit that is
        identified travel on keys of their own and may come later."""
        return (
            isinstance(self._session, UnitSession)
            and block.unit not in self._session.newest
            and len(self._layouts_to_join(block)) < 2
            and self._opening.waiting < SILENT
        )

    def _changed(self, unit: _Unit, opening: OpeningBlock) -> Iterator[Message]:
        """Begin another session, with the blocks that waited for it; where it joins units, with
        those of the session before too, which then ends without a word."""
        before, whole = self._session, self._opening.whole
        waiting = self._opening.taken()
        own = [each for each in waiting if each.block.unit == opening.block.unit]
        of_boot = [each for each in own if each.boot == opening.boot]
        self._session = self._begun(unit, (*of_boot, opening)[0])
        joins = isinstance(self._session, JoinedSession) and isinstance(before, UnitSession)
        if before is not None and not (joins and whole):
            yield from self._finished(before)
        for each in waiting:
            known = self._units.get(each.block.unit)
            fits = self._session.goes_on_with(each.block, each.boot)
            if fits and known is not None and known.boot == each.boot:
                if self._session.misfit(each.block) is None:
                    yield from self._session.push(each.block, each.boot, each.beginning)
            elif not each.used:
                self._refuse_dropped(each)

    def _refuse_dropped(self, dropped: OpeningBlock | None) -> None:
        """Count a block that waited for layouts that did not come."""
        if dropped is not None and dropped.block.unit in self._units:
            text = "its layout, which would join it with the turbine's other unit, is not known"
            self._units[dropped.block.unit].admission.refuse(Refusal(NO_LAYOUT, text))

    def _begun(self, unit: _Unit, opening: OpeningBlock) -> IdentifiedSession:
        session, block = self._session_for(opening), opening.block
        resumable, self._resumable = self._resumable, None
        if resumable is None or resumable.boots.get(block.unit) != unit.boot:
            return session
        self._session = session
        if isinstance(session, JoinedSession):
            session.resume_boots(resumable.boots)
        if resumable.joined == isinstance(session, JoinedSession):
            session.resume(resumable.session, resumable.needed)
        for answer in self._answers:
            self.recall(answer)
        return session

    def _layouts_to_join(self, block: AccelerationBlock) -> list[SensorLayout]:
        """The latest layout of every unit, by their names; none where the block's is not known."""
        latest = {name: unit.layout for name, unit in self._units.items()}
        layouts = {name: layout for name, layout in latest.items() if layout is not None}
        return [layouts[name] for name in sorted(layouts)] if block.unit in layouts else []

    def _session_for(self, opening: OpeningBlock) -> IdentifiedSession:
        speed = self._log.rotor_speed
        layouts = self._layouts_to_join(opening.block)
        if len(layouts) > 1:
            return JoinedSession(layouts, self._settings, self._cpu, speed)
        return UnitSession(
            opening.block,
            opening.boot,
            opening.beginning,
            self._settings,
            self._layouts,
            self._cpu,
            speed,
        )

    def _finish_if_complete(self) -> Iterator[Message]:
        """Finish a session whose ends and last blocks are all here, whichever came first: they
        travel on different keys, so an end may overtake blocks that had to be fetched again."""
        if self._session is None or not any(unit.ends for unit in self._units.values()):
            return
        newest = self._session.newest
        ends = [self._units[unit].ends.get(name) for unit, (name, _) in newest.items()]
        reached = [end_ns for _, end_ns in newest.values()]
        if newest and all(
            end is not None and last >= end.time_ns for end, last in zip(ends, reached, strict=True)
        ):
            for unit, (name, _) in newest.items():
                del self._units[unit].ends[name]
            yield from self._end_session()

    def _end_session(self) -> Iterator[Message]:
        """What the session still has to say; blocks that waited for another one are refused."""
        session, self._session = self._session, None
        assert session is not None
        for each in self._opening.taken():
            if not each.used:
                self._refuse_dropped(each)
        yield from self._finished(session)

    def _finished(self, session: IdentifiedSession) -> Iterator[Message]:
        """What a session still has to say; its blocks stay counted."""
        yield from session.finish()
        counts = NodeStatistics(late=session.late, duplicate=session.duplicate)
        self._of_the_past = self._of_the_past + counts

    def _in_context(self, estimate: ModalEstimate) -> WindowAnswer:
        estimate = self._log.with_conditions(estimate)
        against = self._still_channel(estimate)
        if against is not None:
            return rejected_estimate(estimate, "constant", against)
        against = self._conflict(estimate)
        if against is not None:
            return rejected_estimate(estimate, "conflicting-blocks", against)
        if self._compared:
            swapped = self._channels.swap_in(estimate)
            if swapped is not None:
                return rejected_estimate(estimate, "swapped-channels", swapped)
        doubts = self._link_and_clock_warnings(estimate)
        return replace(estimate, warnings=estimate.warnings + doubts)

    def _spans(self, estimate: ModalEstimate) -> Iterator[tuple[str, _Unit, int, int]]:
        """Each unit whose present boot the window lies in, with its first sample and one past its
        last."""
        for origin in estimate.origins:
            unit = self._units.get(origin.unit)
            if unit is None or unit.boot != Boot(origin.session, origin.boot) or not unit.marks:
                continue
            n_samples = round(estimate.duration * unit.marks[-1].sampling_rate)
            yield origin.unit, unit, origin.first_sample, origin.first_sample + n_samples

    def _still_channel(self, estimate: ModalEstimate) -> str | None:
        """Which channel of the estimate kept one value for a while, in words."""
        for name, unit, first, end in self._spans(estimate):
            still = unit.monitor.still_channel(first, end)
            if still is None:
                continue
            channel, since = still
            names = unit.layout.channel_names if unit.layout else estimate.channels
            for each in names[channel : channel + 1]:  # a layout may not be that of the blocks
                for known_as in (each, f"{name}/{each}"):  # the latter where two units have one
                    if known_as in estimate.channels:
                        return f"{known_as} stands still from {since:.0f} s on"
        return None

    def _conflict(self, estimate: ModalEstimate) -> str | None:
        """That blocks of the window came with two contents, in words."""
        for name, unit, first, end in self._spans(estimate):
            count = sum(first <= sample < end for sample in unit.admission.conflicts)
            if count:
                return (
                    f"{count} blocks of unit {name} came twice with different values: two devices "
                    "send under one name"
                )
        return None

    def _link_and_clock_warnings(self, estimate: ModalEstimate) -> tuple[QualityWarning, ...]:
        """What link and clock of every unit did wrong; of several units, each by its name."""
        several = len(self._units) > 1
        return tuple(
            replace(warning, text=f"unit {name}: {warning.text}") if several else warning
            for name, unit, _, end in self._spans(estimate)
            for warning in unit.monitor.warnings_until(end)
        )

    @property
    def statistics(self) -> NodeStatistics:
        """Blocks that were not used, and why."""
        counts = self._of_the_past
        if self._session is not None:
            session = self._session
            counts += NodeStatistics(late=session.late, duplicate=session.duplicate)
        for unit in self._units.values():
            counts += NodeStatistics(rejected=unit.admission.refused)
        return counts

    @property
    def complaint(self) -> str:
        """Of one of the blocks that were refused: whose it was and what was wrong; "" of none."""
        for name, unit in reversed(self._units.items()):
            if unit.admission.unfit:
                return f"unit {name}: {unit.admission.complaint}"
        return ""

    @property
    def sequence_jumps(self) -> int:
        """Block numbers that jumped where no sample is missing."""
        return sum(unit.admission.sequence_jumps for unit in self._units.values())

    @property
    def units_gone(self) -> int:
        """Units that were let go because the turbine had too many."""
        return self._names.gone

    # ---- restart ------------------------------------------------------------------------------

    def snapshot(self) -> NodeSnapshot:
        """The numbers that windows go by; samples are read again from where they are kept."""
        session = self._session
        needed = {} if session is None else session.needed()
        marks = {name: _mark_before(self._units[name], first) for name, first in needed.items()}
        state = {
            "units": {name: unit.admission.state() for name, unit in self._units.items()},
            "boots": {n: [u.boot.session, u.boot.number] for n, u in self._units.items()},
            "joined": isinstance(session, JoinedSession),
            "session": None if session is None else session.state(),
            "marks": {name: asdict(mark) for name, mark in marks.items() if mark is not None},
        }
        layouts = [unit.layout for unit in self._units.values() if unit.layout is not None]
        return NodeSnapshot(json.dumps(state).encode(), (*layouts, *self._answers))

    def restore(self, snapshot: NodeSnapshot, past: Iterable[Message]) -> Iterator[Message]:
        """Go on from a snapshot, with the samples that were recorded since.

        The latest answers are given once more: they may not have reached a recording.
        """
        state = json.loads(snapshot.state)
        marks = {name: BlockMark(**mark) for name, mark in state["marks"].items()}
        for message in snapshot.messages:
            if isinstance(message, SensorLayout):
                self._note_layout(self._unit(message.unit), message)
        answers = [each for each in snapshot.messages if isinstance(each, WindowAnswer)]
        self._answers = tuple(answers)
        for name, admission in state["units"].items():
            self._unit(name).admission.resume(admission)
        if state["session"] is not None:
            self._resumable = _Resumable(
                {name: Boot(session, number) for name, (session, number) in state["boots"].items()},
                joined=bool(state["joined"]),
                session=state["session"],
                needed={n: Beginning(m.first_sample, m.sequence) for n, m in marks.items()},
            )
            for name, mark in marks.items():
                self._unit(name).admission.begin_after(mark)
        yield from answers[-SAID_AGAIN:]
        for message in refill(past, marks):
            yield from self.handle(message)


@dataclass(frozen=True, slots=True)
class _Resumable:
    """A session of an identification that has ended."""

    boots: dict[str, Boot]
    joined: bool
    session: dict[str, object]
    needed: dict[str, Beginning]


class IdentificationNode(NodeByTurbine[TurbineIdentification]):
    """The identification of any number of turbines.

    Parameters
    ----------
    settings : OmaSettings, optional
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
        """Of all turbines; what was refused is a warning too."""
        counts = super().statistics
        return counts + NodeStatistics(warnings=tuple(self._refusals(counts)))

    def _refusals(self, counts: NodeStatistics) -> Iterator[QualityWarning]:
        if counts.rejected:
            last = next(
                (
                    each.complaint.replace(":", f" of {turbine}:", 1)
                    for turbine, each in reversed(self.members.items())
                    if each.complaint
                ),
                "a unit that is gone",
            )
            yield QualityWarning(
                "unfit-blocks",
                f"{counts.rejected.total()} blocks of another rate, shape, time or sender than "
                f"their unit's were refused; the last of {last}",
            )
        jumps = sum(each.sequence_jumps for each in self.members.values())
        if jumps:
            yield QualityWarning(
                "sequence-jump", f"block numbers jumped {jumps} times where no sample is missing"
            )
        gone = sum(each.units_gone for each in self.members.values())
        if gone:
            yield too_many(f"{self._limits.units} units of a turbine", gone)


def refill(past: Iterable[Message], marks: dict[str, BlockMark]) -> Iterator[Message]:
    """What was recorded since the blocks with these marks, they included, in its order.

    Parameters
    ----------
    past : iterable of Message
        Of one turbine, in the order of recording.
    marks : dict
        Unit → its first block that is needed.
    """
    reached: set[str] = set()
    messages = list(past)
    last = {
        unit: max(
            (n for n, each in enumerate(messages) if _is_marked(each, unit, mark)), default=None
        )
        for unit, mark in marks.items()
    }
    for number, message in enumerate(messages):
        if isinstance(message, AccelerationBlock):
            marked = last.get(message.unit)
            if number == marked:
                reached.add(message.unit)
            ahead = marked is not None and marked - OVERTAKING <= number < marked
            if message.unit in reached or (ahead and _follows(message, marks[message.unit])):
                yield message
        elif isinstance(message, SensorLayout | ScadaSample):
            yield message


def _follows(block: AccelerationBlock, mark: BlockMark) -> bool:
    """Whether a block that came before the marked one lies behind it."""
    return block.session == mark.session and (
        mark.first_sample < block.first_sample <= mark.first_sample + OVERTAKING * mark.n_samples
        and mark.start_ns < block.start_ns
    )


def _is_marked(message: Message, unit: str, mark: BlockMark) -> bool:
    return (
        isinstance(message, AccelerationBlock)
        and message.unit == unit
        and BlockMark.of(message) == mark
    )


def _mark_before(unit: _Unit, needed: int) -> BlockMark | None:
    """The block that holds a sample, or the last one before it."""
    before = [mark for mark in unit.marks if mark.first_sample <= needed]
    if not before:
        return unit.marks[0] if unit.marks else None
    return max(before, key=lambda each: each.first_sample)


def _without_covariances(answer: WindowAnswer) -> WindowAnswer:
    """An estimate as far as its modes' names need it: a hundredth of its size."""
    if isinstance(answer, WindowRejected):
        return answer
    modes = tuple(
        replace(mode, covariance_factor=mode.covariance_factor[:, :0], n_block_columns=0)
        for mode in answer.modes
    )
    return replace(answer, modes=modes)
