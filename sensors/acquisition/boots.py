"""Starts of acquisition units, by their blocks' numbers: what a block's boot is."""

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, time_apart
from sensors.bounded_dict import BoundedDict

NOTABLE_CLOCK_STEP = 0.5  # of stamps against the sample count between two blocks [s]
RATE_ERROR = 0.01  # of a converter's rate, at most [-]
ENOUGH_TO_START = 5  # blocks on end with numbers that came before and stamps that are new
MOST_EARLIER = 8  # whose newest blocks are remembered


class BootCounter:
    """Counts the boots of one unit under one session's name, of blocks as they arrive.

    A block whose number and stamp follow those of an earlier boot, and not those of the present
    one, is of the earlier: it was sent again, or two devices send under one name. One behind the
    newest of the present boot is late or comes again where its stamp fits its number, or its number
    is nearer to the newest one's than to 0; else the unit has started again. So it has where blocks
    on end bring numbers once more that came before, under stamps that do not fit.
    """

    def __init__(self) -> None:
        self.boot = 0
        self.also = 0
        """Blocks just before the last that are found, with it, to be of the new boot."""
        self._newest = BoundedDict[int, AccelerationBlock](MOST_EARLIER)  # by boot
        self._on_end: list[AccelerationBlock] = []  # that may have started a boot

    def unused_before(self, block: AccelerationBlock) -> int:
        """Return how many numbers a unit passed over before a block without missing a sample."""
        newest = self._newest.get(self.boot)
        if newest is None or not _follows(newest, block):
            return 0
        return max(0, block.sequence - newest.sequence - 1)

    def boot_of(self, block: AccelerationBlock, *, repeats: bool) -> int:
        """Starts of the unit before the one that the block is of.

        Parameters
        ----------
        repeats : bool
            Whether a block of that number has come in the present boot.
        """
        self.also = 0
        newest = self._newest.get(self.boot)
        if newest is None:
            self._newest[self.boot] = block
            return self.boot
        fits = _fits(newest, block)
        earlier = None if fits else self._earlier(block)
        if earlier is not None:
            return earlier
        if block.first_sample > newest.first_sample:
            self._newest[self.boot] = block
            self._on_end.clear()
        elif fits:
            self._on_end.clear()
        elif 2 * block.sequence < newest.sequence:
            self._start([block])
        elif repeats:
            self._follow(block)
        return self.boot

    def boot_at(self, sequence: int, time_ns: int) -> int:
        """Which boot's block of that number begins at that time; the present one where none does.

        Parameters
        ----------
        time_ns : int
            By the unit's clock [ns].
        """

        def begins_then(boot: int) -> bool:
            newest = self._newest[boot]
            due = (sequence - newest.sequence) * newest.duration
            return abs((time_ns - newest.start_ns) / NANOSECONDS - due) <= NOTABLE_CLOCK_STEP

        latest_first = reversed(self._newest)
        return next((boot for boot in latest_first if begins_then(boot)), self.boot)

    def _earlier(self, block: AccelerationBlock) -> int | None:
        """The latest boot before the present one that a block fits, and follows if it follows the
        present one by its number."""
        either = _follows(self._newest[self.boot], block)
        others = [(boot, newest) for boot, newest in self._newest.items() if boot != self.boot]
        for boot, newest in reversed(others):
            if _fits(newest, block) and (_follows(newest, block) or not either):
                if block.first_sample > newest.first_sample:
                    self._newest[boot] = block
                return boot
        return None

    def _follow(self, block: AccelerationBlock) -> None:
        last = self._on_end[-1] if self._on_end else None
        if last is not None and not (block.sequence == last.sequence + 1 and _fits(last, block)):
            self._on_end.clear()
        self._on_end.append(block)
        if len(self._on_end) == ENOUGH_TO_START:
            self._start(list(self._on_end))

    def _start(self, blocks: list[AccelerationBlock]) -> None:
        self.boot += 1
        self.also = len(blocks) - 1
        self._newest[self.boot] = blocks[-1]
        self._on_end.clear()


def _follows(newest: AccelerationBlock, block: AccelerationBlock) -> bool:
    return block.first_sample == newest.next_sample


def _fits(newest: AccelerationBlock, block: AccelerationBlock) -> bool:
    since, clock = time_apart(newest, block)
    return abs(clock - since) <= NOTABLE_CLOCK_STEP + RATE_ERROR * abs(since)
