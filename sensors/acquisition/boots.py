"""Starts of acquisition units, by their blocks' numbers: what a block's boot is."""

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

NOTABLE_CLOCK_STEP = 0.5  # of stamps against the sample count between two blocks [s]
RATE_ERROR = 0.01  # of a converter's rate, at most [-]


class BootCounter:
    """Counts the boots of one unit under one session's name, of blocks as they arrive.

    A block behind the newest one is late or comes again where its stamp fits its number; else the
    unit has started again.
    """

    def __init__(self) -> None:
        self.boot = 0
        self._newest: AccelerationBlock | None = None

    def boot_of(self, block: AccelerationBlock) -> int:
        """Starts of the unit before the one that the block is of."""
        newest = self._newest
        if newest is None:
            self._newest = block
            return self.boot
        if block.first_sample > newest.first_sample:
            self._newest = block
        elif block.sequence < newest.sequence and not _fits(newest, block):
            self.boot += 1
            self._newest = block
        return self.boot


def _fits(newest: AccelerationBlock, block: AccelerationBlock) -> bool:
    since = (block.first_sample - newest.first_sample) / newest.sampling_rate
    clock = (block.start_ns - newest.start_ns) / NANOSECONDS
    return abs(clock - since) <= NOTABLE_CLOCK_STEP + RATE_ERROR * abs(since)
