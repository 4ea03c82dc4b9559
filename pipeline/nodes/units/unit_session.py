"""One boot of a turbine's only acquisition unit.

blocks ─► BlockOrder ─► WindowIdentification
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from pipeline.messages import Message, ModalEstimate, UnitOrigin, WindowRejected
from pipeline.nodes.units.acquisition_units import Boot
from pipeline.nodes.units.block_admission import Refusal
from pipeline.nodes.window_identification import (
    CpuLimit,
    RotorSpeed,
    WindowIdentification,
    unknown_speed,
)
from pipeline.oma.settings import OmaSettings
from pipeline.oma.windows.windowing import Beginning, BlockOrder, MissingSamples, Window
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout


class UnitSession:
    """One boot of a turbine's only unit; its windows begin where the boot is expected to begin."""

    def __init__(
        self,
        first: AccelerationBlock,
        boot: Boot,
        beginning: Beginning,
        settings: OmaSettings,
        layouts: dict[str, SensorLayout],
        limit: CpuLimit | None = None,
        rotor_speed: RotorSpeed = unknown_speed,
    ):
        self._unit, self._boot = first.unit, boot
        self._settings = settings
        self._order = BlockOrder(settings.lateness, beginning)
        self._origin = beginning.first_sample  # of the windows
        self._windows = WindowIdentification(
            first.turbine,
            first.unit,
            settings,
            layouts,
            origins=self._origins,
            rotor_speed=rotor_speed,
            limit=limit,
        )
        self._rate = first.sampling_rate
        self._newest: AccelerationBlock | None = None

    @property
    def newest(self) -> dict[str, tuple[str, int]]:
        """Session and end of the newest block by its number [ns] of every unit."""
        end_ns = 0 if self._newest is None else self._newest.end_ns
        return {self._unit: (self._boot.session, end_ns)}

    def goes_on_with(self, block: AccelerationBlock, boot: Boot) -> bool:
        """Whether a block belongs to this boot."""
        return (block.unit, boot) == (self._unit, self._boot)

    def refusal(self, _: AccelerationBlock) -> Refusal | None:
        """Why what runs cannot go on with a block; with its only unit's it can."""
        return None

    def misfit(self, _: AccelerationBlock) -> Refusal | None:
        """Why a block is of no use, however many like it come; the only unit's never is."""
        return None

    def push(self, block: AccelerationBlock, _: Boot, __: Beginning) -> Iterator[Message]:
        """Take a block of this boot."""
        if self._newest is None or block.first_sample >= self._newest.first_sample:
            self._newest = block
        yield from self._answers(self._order.push(block))

    def finish(self) -> Iterator[Message]:
        """Answer what is left."""
        yield from self._answers(self._order.flush())
        yield from self._windows.finish()

    def release(self) -> list[AccelerationBlock]:
        """Blocks that what follows may use: none."""
        return []

    @property
    def has_lost_time(self) -> bool:
        """Whether the units' stamps have left the clock that they are joined on; one has none."""
        return False

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """See `WindowIdentification.recall`."""
        self._windows.recall(answer)

    def needed(self) -> dict[str, int]:
        """First sample of each unit that is not in an answered window."""
        hop = self._settings.hop * self._rate
        return {self._unit: self._origin + round(self._windows.next_index * hop)}

    def state(self) -> dict[str, Any]:
        """What a restart needs beside the samples, as JSON can say it."""
        return {"window": self._windows.next_index, "origin": self._origin}

    def resume(self, state: Mapping[str, Any], needed: Mapping[str, Beginning]) -> None:
        """Go on with the first window that is not answered."""
        self._order = BlockOrder(self._settings.lateness, needed[self._unit])
        self._origin = int(state.get("origin", 0))
        self._windows.begin_at(int(state["window"]))

    def _origins(self, window: Window) -> tuple[UnitOrigin, ...]:
        boot, first = self._boot, self._origin + window.first_sample
        return (UnitOrigin(self._unit, boot.session, boot.number, first),)

    def _answers(self, pieces: Iterable[AccelerationBlock | MissingSamples]) -> Iterator[Message]:
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                yield self._windows.gap(piece, self._unit, self._boot.session)
            if self._origin:
                piece = replace(piece, first_sample=piece.first_sample - self._origin)
            yield from self._windows.push(piece)

    @property
    def late(self) -> int:
        """Blocks that came too late."""
        return self._order.late

    @property
    def duplicate(self) -> int:
        """Blocks that came twice."""
        return self._order.duplicate
