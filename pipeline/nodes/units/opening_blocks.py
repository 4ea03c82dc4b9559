"""Blocks that a session may begin with: those that came while not all units' layouts were known."""

from collections import deque
from dataclasses import dataclass, replace

from pipeline.nodes.units.acquisition_units import Boot
from pipeline.oma.windows.windowing import Beginning
from sensors.acquisition.blocks import AccelerationBlock

MOST_OPENING = 64  # blocks that are kept


@dataclass(frozen=True, slots=True)
class OpeningBlock:
    """A block that a session may begin with."""

    block: AccelerationBlock
    boot: Boot
    beginning: Beginning
    """Where its unit is expected to begin if it is the first."""
    used: bool = False
    """Whether the session of one unit has it."""


class OpeningBlocks:
    """Blocks in no answered window that came while not all units' layouts were known: those of the
    one unit that is identified, and those of others, which wait."""

    def __init__(self) -> None:
        self._blocks: deque[OpeningBlock] = deque()
        self.whole = True
        """Whether every block is there that the session of one unit has in no answered window."""
        self.waiting = 0
        """Blocks of other units on end."""

    def wait(self, block: OpeningBlock) -> OpeningBlock | None:
        """Keep another unit's block; return one that has waited too long."""
        self.waiting += 1
        return self._kept(block)

    def use(self, block: OpeningBlock) -> OpeningBlock | None:
        """Keep a block that the session takes; return one that has waited too long."""
        self.waiting = 0
        return self._kept(replace(block, used=True))

    def answered(self) -> None:
        """Let go of blocks of windows that are answered."""
        self._blocks = deque(each for each in self._blocks if not each.used)
        self.whole = True

    def taken(self) -> list[OpeningBlock]:
        """Give all blocks away, in the order of their arrival."""
        taken, self._blocks = list(self._blocks), deque()
        self.whole, self.waiting = True, 0
        return taken

    def _kept(self, block: OpeningBlock) -> OpeningBlock | None:
        self._blocks.append(block)
        if len(self._blocks) <= MOST_OPENING:
            return None
        dropped = self._blocks.popleft()
        self.whole = self.whole and not dropped.used
        return None if dropped.used else dropped
