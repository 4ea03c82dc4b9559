"""What must be remembered of a running session: of one acquisition unit, or of several joined.

one unit      blocks ─► BlockOrder ─────────────────────────► WindowIdentification
several       blocks ─► BlockOrder of each ─► UnitJoiner ───► WindowIdentification
"""

from collections.abc import Iterable, Iterator, Sequence

from pipeline.messages import Message, ModalEstimate, WindowRejected
from pipeline.nodes.window_identification import WindowIdentification
from pipeline.oma.settings import OmaSettings
from pipeline.oma.windows.unit_alignment import UnitJoiner
from pipeline.oma.windows.windowing import BlockOrder, MissingSamples
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout


class UnitSession:
    """One session of a turbine's only unit."""

    def __init__(
        self,
        first: AccelerationBlock,
        settings: OmaSettings,
        layouts: dict[str, SensorLayout],
    ):
        self._unit, self._name = first.unit, first.session
        self._order = BlockOrder(settings.lateness)
        self._windows = WindowIdentification(first.turbine, first.unit, settings, layouts)
        self._newest_ns = 0

    @property
    def newest(self) -> dict[str, tuple[str, int]]:
        """Session and end of the newest block [ns] of every unit."""
        return {self._unit: (self._name, self._newest_ns)}

    def goes_on_with(self, block: AccelerationBlock) -> bool:
        """Whether a block belongs to this session."""
        return (block.unit, block.session) == (self._unit, self._name)

    def refusal(self, _: AccelerationBlock) -> str:
        """Why the session cannot go on with a block; with its only unit's it can."""
        return ""

    def misfit(self, _: AccelerationBlock) -> str:
        """Why a block is of no use, however many like it come; the only unit's never is."""
        return ""

    def push(self, block: AccelerationBlock) -> Iterator[Message]:
        self._newest_ns = max(self._newest_ns, block.end_ns)
        yield from self._answers(self._order.push(block))

    def finish(self) -> Iterator[Message]:
        yield from self._answers(self._order.flush())
        yield from self._windows.finish()

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """See `WindowIdentification.recall`."""
        self._windows.recall(answer)

    def _answers(self, pieces: Iterable[AccelerationBlock | MissingSamples]) -> Iterator[Message]:
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                yield self._windows.gap(piece, self._unit, self._name)
            yield from self._windows.push(piece)

    @property
    def late(self) -> int:
        return self._order.late

    @property
    def duplicate(self) -> int:
        return self._order.duplicate


class JoinedSession:
    """The units of a turbine, joined from the first of their blocks on.

    A unit that starts anew goes on in the same session: its channels are missing in between.
    """

    def __init__(self, layouts: Sequence[SensorLayout], settings: OmaSettings):
        self._settings = settings
        self._joiner = UnitJoiner(layouts, settings.lateness)
        self._orders: dict[str, BlockOrder] = {}
        self._late = self._duplicate = 0  # blocks of sessions of units that are over
        self.newest: dict[str, tuple[str, int]] = {}
        joined = self._joiner.layout
        self._windows = WindowIdentification(
            joined.turbine,
            joined.unit,
            settings,
            {joined.layout_id: joined},
            columns={unit: self._joiner.columns(unit) for unit in self._joiner.units},
        )

    def goes_on_with(self, block: AccelerationBlock) -> bool:
        """Whether a block belongs to this session."""
        return block.unit in self._joiner.units

    def refusal(self, block: AccelerationBlock) -> str:
        """Why a unit's block cannot be joined with the others'; "" where it can."""
        return self._joiner.refusal(block) if self.goes_on_with(block) else ""

    def misfit(self, block: AccelerationBlock) -> str:
        """Why a block is of no use, however many like it come; "" where it is of some."""
        named, own = len(self._joiner.columns(block.unit)), block.samples.shape[1]
        return "" if own == named else f"{own} channels where its unit's layout names {named}"

    def push(self, block: AccelerationBlock) -> Iterator[Message]:
        """Take a block of which `misfit` says nothing."""
        name, newest_ns = self.newest.get(block.unit, (block.session, 0))
        if block.unit not in self._orders or name != block.session:
            yield from self._close_order(block)
            self._orders[block.unit] = BlockOrder(self._settings.lateness)
            newest_ns = 0
        self.newest[block.unit] = (block.session, max(newest_ns, block.end_ns))
        yield from self._taken(block, list(self._orders[block.unit].push(block)))

    def finish(self) -> Iterator[Message]:
        for unit, order in self._orders.items():
            pieces = list(order.flush())
            blocks = [piece for piece in pieces if isinstance(piece, AccelerationBlock)]
            if blocks:
                yield from self._taken(blocks[-1], pieces)
            self._orders[unit] = BlockOrder(self._settings.lateness)
        for piece in self._joiner.finish():
            yield from self._windows.push(piece)
        yield from self._windows.finish()

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """See `WindowIdentification.recall`."""
        self._windows.recall(answer)

    def _close_order(self, following: AccelerationBlock) -> Iterator[Message]:
        """What still waits of the unit's session before this block's."""
        order = self._orders.get(following.unit)
        if order is None:
            return
        pieces = list(order.flush())
        self._late += order.late
        self._duplicate += order.duplicate
        blocks = [piece for piece in pieces if isinstance(piece, AccelerationBlock)]
        if blocks:
            yield from self._taken(blocks[-1], pieces)

    def _taken(
        self, block: AccelerationBlock, pieces: Sequence[AccelerationBlock | MissingSamples]
    ) -> Iterator[Message]:
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                yield self._windows.gap(piece, block.unit, block.session)
        for joined in self._joiner.push(block, pieces):
            yield from self._windows.push(joined)

    @property
    def late(self) -> int:
        return self._late + sum(order.late for order in self._orders.values())

    @property
    def duplicate(self) -> int:
        return self._duplicate + sum(order.duplicate for order in self._orders.values())
