"""What is remembered of each acquisition unit of a turbine, what that means for a window, the
blocks that came while not all units' layouts were known, and the session of an only unit."""

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from pipeline.messages import Message, ModalEstimate, QualityWarning, StreamEnd, UnitOrigin
from pipeline.nodes.by_turbine import LimitedMembers
from pipeline.oma.settings import OmaSettings
from pipeline.oma.window_identification import WindowContext, WindowIdentification
from pipeline.oma.windows.block_admission import BlockAdmission, Boot
from pipeline.oma.windows.unit_alignment import FITTED_STAMPS
from pipeline.oma.windows.unit_clock import BlockMonitor
from pipeline.oma.windows.windowing import Beginning, MissingSamples, Window
from sensors.acquisition.blocks import AccelerationBlock, BlockMark
from sensors.acquisition.layout import SensorLayout
from sensors.bounded_dict import BoundedDict

LATEST_OF_A_UNIT = 8  # layouts and ends of sessions that are kept
MARKS = 20_000  # of a unit's latest blocks at most: ten minutes of blocks of 30 ms
MARGIN = 10.0 + FITTED_STAMPS  # [s] of blocks that a clock's line is fitted to
MOST_OPENING = 64  # blocks that are kept


def read_back(settings: OmaSettings) -> float:
    """How far a restart reads back: an open window and one before it, which may not have been
    answered [s]."""
    return 2 * (settings.window_duration + settings.hop) + settings.lateness + MARGIN


class AcquisitionUnit:
    """One unit: which of its blocks are used, what is wrong with them, what it describes."""

    def __init__(self, settings: OmaSettings) -> None:
        self.admission = BlockAdmission()
        self.monitor = BlockMonitor(settings.lateness)
        self._read_back = read_back(settings)
        self.layouts = BoundedDict[str, SensorLayout](LATEST_OF_A_UNIT)  # by their ids
        self.ends = BoundedDict[str, StreamEnd](LATEST_OF_A_UNIT)
        """By session: announced, blocks still missing."""
        # of the present boot; after a window's answer as far as a restart reads back
        self.marks: deque[BlockMark] = deque(maxlen=MARKS)
        # where the present boot was expected to begin; None: with its next block, after a restart
        self.beginning: Beginning | None = Beginning()
        self._reached = Beginning()  # after the newest block of the present boot that was joined

    @property
    def layout(self) -> SensorLayout | None:
        """The latest."""
        return next(reversed(self.layouts.values()), None)

    @property
    def boot(self) -> Boot:
        """The present one."""
        return self.admission.boot

    def begin(self, beginning: Beginning) -> None:
        """Begin a boot."""
        self.beginning = beginning
        self.monitor.restart()
        self.marks.clear()
        self._reached = Beginning()

    def forget_unread(self) -> None:
        """Forget marks of blocks that a restart would not read; the last of them stays."""
        while len(self.marks) > 1:
            newest = self.marks[-1]
            needed = newest.first_sample - self._read_back * newest.sampling_rate
            if self.marks[1].first_sample > needed:
                return
            self.marks.popleft()

    def expected(self, block: AccelerationBlock) -> Beginning:
        """Where a session that begins with a block expects the unit's first one: after the newest
        that a session before it had, so that what is missing in between is reported."""
        first = self.marks[0] if self.marks else None
        if first is None or (first.sequence, first.start_ns) == (block.sequence, block.start_ns):
            return self.beginning or Beginning(block.first_sample, block.sequence)
        if 0 < self._reached.first_sample < block.first_sample:
            return self._reached
        return Beginning(block.first_sample, block.sequence)

    def note_joined(self, block: AccelerationBlock) -> None:
        """Remember that a session has a block."""
        if block.next_sample > self._reached.first_sample:
            self._reached = Beginning(block.next_sample, block.sequence + 1)

    def has_ended(self, session: str, end_ns: int) -> bool:
        """Whether the end of a session that has come so far was announced and is reached."""
        end = self.ends.get(session)
        return end is not None and end_ns >= end.time_ns

    def mark_before(self, needed: int) -> BlockMark | None:
        """Return the block that holds a sample, or the last one before it."""
        before = [mark for mark in self.marks if mark.first_sample <= needed]
        first = list(self.marks)[:1]
        return max(before or first, key=lambda each: each.first_sample, default=None)


class AcquisitionUnits:
    """The units of one turbine, so many at most.

    Parameters
    ----------
    settings : OmaSettings
        Of their windows.
    most : int
        Of more the one with the fewest messages is let go.
    """

    def __init__(self, settings: OmaSettings, most: int) -> None:
        self.by_name: dict[str, AcquisitionUnit] = {}
        self._settings = settings
        self._names = LimitedMembers(most)
        self._refused_of_gone = Counter[str]()  # blocks of units that were let go

    def named(self, name: str) -> AcquisitionUnit:
        """Return the unit that a message came from; made with its first one."""
        leaving = self._names.note(name)
        if leaving is not None and leaving in self.by_name:
            self._refused_of_gone += self.by_name.pop(leaving).admission.refused
        if name not in self.by_name:
            self.by_name[name] = AcquisitionUnit(self._settings)
        return self.by_name[name]

    def note_layout(self, layout: SensorLayout) -> None:
        """Remember a unit's layout; the latest of each unit are kept."""
        self.named(layout.unit).layouts.put(layout.layout_id, layout)

    def forget_unread(self) -> None:
        """Forget of every unit what a restart would not read."""
        for unit in self.by_name.values():
            unit.forget_unread()

    @property
    def latest_layouts(self) -> dict[str, SensorLayout]:
        """The latest of each unit that has sent one."""
        latest = {name: unit.layout for name, unit in self.by_name.items()}
        return {name: layout for name, layout in latest.items() if layout is not None}

    # ---- what they mean for a window ------------------------------------------------------------

    def still_channel(self, estimate: ModalEstimate) -> str | None:
        """Return in words which channel of the estimate kept one value for a while."""
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

    def conflict(self, estimate: ModalEstimate) -> str | None:
        """Return in words that blocks of the window came with two contents; None where none did."""
        for name, unit, first, end in self._spans(estimate):
            count = sum(first <= sample < end for sample in unit.admission.conflicts)
            if count:
                return (
                    f"{count} blocks of unit {name} came twice with different values: two devices "
                    "send under one name"
                )
        return None

    def warnings(self, estimate: ModalEstimate) -> tuple[QualityWarning, ...]:
        """What link and clock of every unit did wrong; of several units, each by its name."""
        several = len(self.by_name) > 1
        return tuple(
            replace(warning, text=f"unit {name}: {warning.text}") if several else warning
            for name, unit, _, end in self._spans(estimate)
            for warning in unit.monitor.warnings_until(end)
        )

    def _spans(self, estimate: ModalEstimate) -> Iterator[tuple[str, AcquisitionUnit, int, int]]:
        """Each unit whose present boot the window lies in, with its first sample and one past its
        last."""
        for origin in estimate.origins:
            unit = self.by_name.get(origin.unit)
            if unit is None or unit.boot != Boot(origin.session, origin.boot) or not unit.marks:
                continue
            n_samples = round(estimate.duration * unit.marks[-1].sampling_rate)
            yield origin.unit, unit, origin.first_sample, origin.first_sample + n_samples

    # ---- what they count ------------------------------------------------------------------------

    @property
    def refused(self) -> Counter[str]:
        """Blocks that were refused, by the reason's code."""
        present = (unit.admission.refused for unit in self.by_name.values())
        return sum(present, Counter(self._refused_of_gone))

    def last_refusal(self, turbine: str) -> str:
        """Return unit and turbine of a refused block and what was wrong with it; "" without one."""
        for name, unit in reversed(self.by_name.items()):
            if unit.admission.refused:
                return f"unit {name} of {turbine}: {unit.admission.last_refusal}"
        return ""

    @property
    def sequence_jumps(self) -> int:
        """Block numbers that jumped where no sample is missing."""
        return sum(unit.admission.sequence_jumps for unit in self.by_name.values())

    @property
    def gone(self) -> int:
        """Units that were let go because the turbine had too many."""
        return self._names.gone


@dataclass(frozen=True, slots=True)
class UnitBlock:
    """A block with what its unit knows of it."""

    block: AccelerationBlock
    boot: Boot
    beginning: Beginning
    """Where its unit is expected to begin if the block is the first of a session."""
    used: bool = False
    """Whether the session of one unit has it."""


class OpeningBlocks:
    """Blocks in no answered window that came while not all units' layouts were known: those of the
    one unit that is identified, and those of others, which wait."""

    def __init__(self) -> None:
        self._blocks: deque[UnitBlock] = deque()
        self.whole = True
        """Whether every block is there that the session of one unit has in no answered window."""
        self.waiting = 0
        """Blocks of other units on end."""

    def wait(self, block: UnitBlock) -> UnitBlock | None:
        """Keep another unit's block; return one that has waited too long."""
        self.waiting += 1
        return self._kept(block)

    def use(self, block: UnitBlock) -> UnitBlock | None:
        """Keep a block that the session takes; return one that has waited too long."""
        self.waiting = 0
        return self._kept(replace(block, used=True))

    def answered(self) -> None:
        """Let go of blocks of windows that are answered."""
        self._blocks = deque(each for each in self._blocks if not each.used)
        self.whole = True

    def taken(self) -> list[UnitBlock]:
        """Give all blocks away, in the order of their arrival."""
        taken, self._blocks = list(self._blocks), deque()
        self.whole, self.waiting = True, 0
        return taken

    def _kept(self, block: UnitBlock) -> UnitBlock | None:
        self._blocks.append(block)
        if len(self._blocks) <= MOST_OPENING:
            return None
        dropped = self._blocks.popleft()
        self.whole = self.whole and not dropped.used
        return None if dropped.used else dropped


class UnitSession:
    """One boot of a turbine's only unit; its windows begin where the boot is expected to begin.

    Parameters
    ----------
    first : UnitBlock
        That it begins with.
    layouts : dict
        Of the unit, by their ids.
    """

    def __init__(
        self, first: UnitBlock, layouts: dict[str, SensorLayout], context: WindowContext
    ) -> None:
        block, self._boot = first.block, first.boot
        self._unit = block.unit
        self._context = context
        self._order = context.order(first.beginning)
        self._origin = first.beginning.first_sample  # of the windows
        self.windows = WindowIdentification(
            block.turbine, block.unit, layouts, context, origins=self._origins
        )
        self._rate = block.sampling_rate
        self._newest: AccelerationBlock | None = None

    @property
    def newest(self) -> dict[str, tuple[str, int]]:
        """Session and end of the newest block by its number [ns] of every unit."""
        end_ns = 0 if self._newest is None else self._newest.end_ns
        return {self._unit: (self._boot.session, end_ns)}

    def goes_on_with(self, item: UnitBlock) -> bool:
        """Whether a block belongs to this boot."""
        return (item.block.unit, item.boot) == (self._unit, self._boot)

    def refusal(self, _: AccelerationBlock) -> QualityWarning | None:
        """Return why what runs cannot go on with a block; with its only unit's it can."""
        return None

    def layout_mismatch(self, _: AccelerationBlock) -> QualityWarning | None:
        """Return why a block is of no use, however many like it come; the only unit's never is."""
        return None

    def push(self, item: UnitBlock) -> Iterator[Message]:
        """Take a block of this boot."""
        block = item.block
        if self._newest is None or block.first_sample >= self._newest.first_sample:
            self._newest = block
        yield from self._answers(self._order.push(block))

    def finish(self) -> Iterator[Message]:
        """Answer what is left."""
        yield from self._answers(self._order.flush())
        yield from self.windows.finish()

    def needed(self) -> dict[str, int]:
        """First sample of each unit that is not in an answered window."""
        hop = self._context.settings.hop * self._rate
        first = self._origin + self.windows.shift
        return {self._unit: first + round(self.windows.next_index * hop)}

    def state(self) -> dict[str, Any]:
        """Return what a restart needs beside the samples, as JSON can say it."""
        return {"window": self.windows.next_index, "origin": self._origin + self.windows.shift}

    def resume(self, state: Mapping[str, Any], needed: Mapping[str, Beginning]) -> None:
        """Go on with the first window that is not answered."""
        self._order = self._context.order(needed[self._unit])
        self._origin = int(state.get("origin", 0))
        self.windows.begin_at(int(state["window"]))

    def _origins(self, window: Window) -> tuple[UnitOrigin, ...]:
        boot, first = self._boot, self._origin + window.first_sample
        return (UnitOrigin(self._unit, boot.session, boot.number, first),)

    def _answers(self, pieces: Iterable[AccelerationBlock | MissingSamples]) -> Iterator[Message]:
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                yield self.windows.gap(piece, self._unit, self._boot.session)
            if self._origin:
                piece = replace(piece, first_sample=piece.first_sample - self._origin)
            yield from self.windows.push(piece)
