"""Which blocks may enter a running session: a unit's clock runs on, its channels stay.

    block fits the last one taken ──► taken
    it does not ──► held; dropped when the next one fits again
                    five on end that fit each other: the unit has begun anew ──► all are taken

A forged or broken block has no other effect than its count; a unit that has restarted without
saying so, or was away for more than a day, is followed after five blocks.
"""

from dataclasses import dataclass

from sensors.blocks import NANOSECONDS, AccelerationBlock

STUBBORN = 5  # blocks on end that fit each other and not the session
FARTHEST = 86_400.0  # from one block to the next of a session [s]
MOST_SAMPLES = (
    10**8
)  # that may be missing in between: a day at 1 kHz; what joins units lays them out
CLOCK_STEP = 3600.0  # largest of a unit's clock against its sample count [s]


@dataclass(frozen=True, slots=True)
class Admission:
    """What the gate lets through."""

    blocks: tuple[AccelerationBlock, ...]
    anew: bool = False  # they begin a session of their own, whatever their names


class BlockGate:
    """Watches the blocks of one unit."""

    def __init__(self) -> None:
        self.unfit = 0  # blocks that were dropped
        self._last: AccelerationBlock | None = None
        self._held: list[AccelerationBlock] = []

    def admit(self, block: AccelerationBlock) -> Admission:
        """Take a block as it arrives."""
        if self._last is None or fits(self._last, block):
            self.unfit += len(self._held)
            self._held.clear()
            self._last = block
            return Admission((block,))
        if self._held and not fits(self._held[-1], block):
            self.unfit += len(self._held)
            self._held.clear()
        self._held.append(block)
        if len(self._held) < STUBBORN:
            return Admission(())
        blocks, self._held, self._last = tuple(self._held), [], block
        return Admission(blocks, anew=True)


def fits(last: AccelerationBlock, block: AccelerationBlock) -> bool:
    """Whether one unit may have sent both. A new session may have other channels and rate."""
    if block.session != last.session:
        between = abs(block.start_ns - last.end_ns) / NANOSECONDS
        return between <= FARTHEST and between * block.sampling_rate <= MOST_SAMPLES
    rate = last.sampling_rate
    if (block.sampling_rate, block.samples.shape[1]) != (rate, last.samples.shape[1]):
        return False
    since = (block.first_sample - last.first_sample) / rate
    clock = (block.start_ns - last.start_ns) / NANOSECONDS
    few = max(abs(since), abs(clock)) * rate <= MOST_SAMPLES
    return few and abs(since) <= FARTHEST and abs(clock - since) <= CLOCK_STEP
