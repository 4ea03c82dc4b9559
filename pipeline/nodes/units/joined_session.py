"""Several acquisition units of a turbine, joined on one clock.

blocks ─► BlockOrder of each unit ─► UnitJoiner ─► WindowIdentification
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pipeline.messages import Message, QualityWarning, UnitOrigin
from pipeline.nodes.units.acquisition_units import UnitBlock, UnitSession
from pipeline.oma.window_identification import WindowContext, WindowIdentification
from pipeline.oma.windows.block_admission import LAYOUT, STUBBORN, UNITS, Boot
from pipeline.oma.windows.unit_alignment import UnitJoiner
from pipeline.oma.windows.unit_clock import ClockStep, clock_step, stamp_of
from pipeline.oma.windows.windowing import Beginning, BlockOrder, MissingSamples, Window
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout

LARGEST_LEAD = 3600.0  # by which a unit that starts may be apart from the others [s]
SILENT = 20  # blocks of each of the other units after which a unit counts as silent


class JoinedSession:
    """The units of a turbine, joined from the first of their blocks on.

    A unit that starts again goes on in the same session: its channels are missing in between. One
    whose stamps step is left out until they agree with the others' again. Where no unit that is
    received agrees with the joined clock, it `has_lost_time`: another session begins.
    """

    def __init__(self, layouts: Sequence[SensorLayout], context: WindowContext) -> None:
        self._settings, self._context = context.settings, context
        self._joiner = UnitJoiner(layouts, context.settings.lateness)
        self._orders: dict[str, BlockOrder] = {}
        self._boots: dict[str, Boot] = {}
        self._newest: dict[str, AccelerationBlock] = {}
        self._out: set[str] = set()  # units whose stamps do not agree with the others'
        self._agreed_from: dict[str, int] = {}  # first sample since a unit was left out
        self._disagreed: dict[str, int] = {}  # blocks of a unit on end
        self._last_push: dict[str, int] = {}  # number of the unit's last block among all
        self._n_pushed = 0
        self._unused: deque[AccelerationBlock] = deque(maxlen=STUBBORN * len(layouts))
        joined = self._joiner.layout
        self.windows = WindowIdentification(
            joined.turbine,
            joined.unit,
            {joined.layout_id: joined},
            context,
            columns={unit: self._joiner.columns(unit) for unit in self._joiner.units},
            origins=self._origins,
        )

    @property
    def newest(self) -> dict[str, tuple[str, int]]:
        """Session and end of the newest block by its number [ns] of every unit."""
        return {unit: (each.session, each.end_ns) for unit, each in self._newest.items()}

    def goes_on_with(self, item: UnitBlock) -> bool:
        """Whether a block belongs to this session."""
        return item.block.unit in self._joiner.units

    def refusal(self, block: AccelerationBlock) -> QualityWarning | None:
        """Return why a unit's block cannot be joined with the others'; None where it can."""
        if block.unit not in self._joiner.units:
            return None
        text = self._joiner.refusal(block)
        return QualityWarning(UNITS, text) if text else None

    def layout_mismatch(self, block: AccelerationBlock) -> QualityWarning | None:
        """Return why a block is of no use, however many like it come; None where it is of some."""
        named, own = len(self._joiner.columns(block.unit)), block.samples.shape[1]
        if own == named:
            return None
        return QualityWarning(LAYOUT, f"{own} channels where its unit's layout names {named}")

    def push(self, item: UnitBlock) -> Iterator[Message]:
        """Take a block that has as many channels as its unit's layout."""
        block = item.block
        self._n_pushed += 1
        self._last_push[block.unit] = self._n_pushed
        if self._boots.get(block.unit) != item.boot:
            yield from self._restarted(item)
        agrees = self._agrees(block)
        before = self._newest.get(block.unit)
        if before is None or block.first_sample >= before.first_sample:
            self._newest[block.unit] = block
        is_used = agrees and not self._joiner.is_past(block)
        self._disagreed[block.unit] = 0 if is_used else self._disagreed.get(block.unit, 0) + 1
        if not is_used:
            self._unused.append(block)
        yield from self._taken(block, list(self._orders[block.unit].push(block)))

    @property
    def has_lost_time(self) -> bool:
        """Whether no unit that is received agrees with the joined clock."""
        recent = self._n_pushed - SILENT * len(self._joiner.units)
        sending = [unit for unit, number in self._last_push.items() if number > recent]
        return all(self._disagreed.get(unit, 0) >= STUBBORN for unit in sending)

    def release(self) -> list[AccelerationBlock]:
        """Blocks that could not be used and that another session may begin with.

        The unit whose stamps are nearest to the joined clock comes first: the others' stamps are
        judged by its own.
        """
        now_ns = self._joiner.now_ns
        if now_ns is None:
            return list(self._unused)

        def apart(block: AccelerationBlock) -> int:
            return abs(self._newest[block.unit].start_ns - now_ns)

        return sorted(self._unused, key=apart)

    def finish(self) -> Iterator[Message]:
        """Answer what is left."""
        for order in self._orders.values():
            yield from self._flushed(order)
        for piece in self._joiner.finish():
            yield from self.windows.push(piece)
        yield from self.windows.finish()

    def needed(self) -> dict[str, int]:
        """First sample of each unit that is not in an answered window or fits its clock's line; of
        one that is left out, or of which nothing is joined yet, that of its newest block."""
        since = self.windows.next_index * self._settings.hop
        absent = self._absent(since)
        found = {}
        for unit, newest in self._newest.items():
            first = None if unit in absent else self._joiner.needed(unit, since)
            found[unit] = newest.first_sample if first is None else first
        return found

    def _absent(self, since: float) -> set[str]:
        """Units that are left out and have no samples in a window that is not answered."""
        return {unit for unit in self._out if not self._joiner.has(unit, since)}

    def state(self) -> dict[str, Any]:
        """Return what a restart needs beside the samples, as JSON can say it."""
        grid = self._joiner.grid
        return {
            "window": self.windows.next_index,
            "grid": None if grid is None else list(grid),
            "out": sorted(self._absent(self.windows.next_index * self._settings.hop)),
        }

    def resume(self, state: Mapping[str, Any], needed: Mapping[str, Beginning]) -> None:
        """Go on with the first window that is not answered, on the same clock."""
        for unit, beginning in needed.items():
            self._orders[unit] = self._context.order(beginning)
        self._out = set(state.get("out", ()))
        if state["grid"] is None:
            return
        origin_ns, rate, session = state["grid"]
        index = int(state["window"])
        self._joiner.resume(origin_ns, rate, session, round(index * self._settings.hop * rate))
        self.windows.begin_at(index)

    def resume_boots(self, boots: Mapping[str, Boot]) -> None:
        """Which boots of the units run."""
        self._boots = dict(boots)
        for unit in boots:
            self._orders.setdefault(unit, self._context.order(Beginning()))

    def _agrees(self, block: AccelerationBlock) -> bool:
        """Whether a block's stamp is one that the units can be joined on."""
        before = self._newest.get(block.unit)
        others = [
            each.end_ns
            for unit, each in self._newest.items()
            if unit != block.unit and unit not in self._out
        ]
        lead = (block.start_ns - max(others)) / NANOSECONDS if others else 0.0
        if before is None:
            if abs(lead) > LARGEST_LEAD:
                self._out.add(block.unit)
        elif block.first_sample >= before.first_sample:
            step = clock_step(stamp_of(before), stamp_of(block), block.sampling_rate)
            if step:
                self._out.add(block.unit)
                self.windows.note_step(block.unit, ClockStep(block.first_sample, step))
        if block.unit not in self._out:
            return True
        if not others or abs(lead) > self._settings.lateness + 2 * block.duration:
            return False
        self._out.discard(block.unit)
        self._agreed_from[block.unit] = block.first_sample
        self._joiner.restart(block.unit)
        return True

    def _restarted(self, item: UnitBlock) -> Iterator[Message]:
        """Yield what still waits of the unit's boot before this block's."""
        block = item.block
        order = self._orders.get(block.unit)
        self._boots[block.unit] = item.boot
        self._newest.pop(block.unit, None)
        self._orders[block.unit] = self._context.order(item.beginning)
        if order is not None:
            yield from self._flushed(order)
            self._agreed_from.pop(block.unit, None)
            self._joiner.restart(block.unit)
        self._out.discard(block.unit)

    def _flushed(self, order: BlockOrder) -> Iterator[Message]:
        """Take what still waits of a unit."""
        pieces = list(order.flush())
        blocks = [piece for piece in pieces if isinstance(piece, AccelerationBlock)]
        if blocks:
            yield from self._taken(blocks[-1], pieces)

    def _taken(
        self, block: AccelerationBlock, pieces: Sequence[AccelerationBlock | MissingSamples]
    ) -> Iterator[Message]:
        """Report what is missing; join what is there, but for what was sent while it was out."""
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                yield self.windows.gap(piece, block.unit, block.session)
        if block.unit in self._out:
            return
        since = self._agreed_from.get(block.unit, 0)
        agreed = [piece for piece in pieces if piece.first_sample >= since]
        for joined in self._joiner.push(block, agreed):
            yield from self.windows.push(joined)

    def _origins(self, window: Window) -> tuple[UnitOrigin, ...]:
        """Return the origins of the units that are there when the window begins."""
        beginnings = self._joiner.origins(window.first_sample)
        return tuple(
            UnitOrigin(unit, self._boots[unit].session, self._boots[unit].number, sample)
            for unit, sample in sorted(beginnings.items())
            if unit in self._boots
        )


IdentifiedSession = UnitSession | JoinedSession
