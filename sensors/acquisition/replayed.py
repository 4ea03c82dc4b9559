"""ReplayedTower: what was recorded in order of logical time, gaps kept as gaps."""

import heapq
from collections.abc import Iterable, Iterator

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, time_apart
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

LATEST_BLOCKS = 1200  # a recorded block may come that many blocks too late: the publisher's cache
STAMP_STEP = 0.5  # of stamps against the sample count, beyond which the count is followed [s]
CONVERTER_ERROR = 0.01  # of a converter's rate, at most [-]
FARTHEST_APART = 86_400.0  # between what is recorded one after the other, by sound clocks [s]


class _Source:
    """The logical time of one unit's blocks, or of one controller's samples."""

    def __init__(self) -> None:
        self._shift = 0  # of stamps [ns]
        self._before: AccelerationBlock | None = None
        self._newest: int | None = None  # logical time [ns]

    def time_of(self, message: AccelerationBlock | ScadaSample, now: int | None) -> int:
        """Logical time [ns]: the stamp, but for steps against the sample count.

        Parameters
        ----------
        message : AccelerationBlock or ScadaSample
            The next of this source.
        now : int or None
            Logical time of the newest message of any source [ns].
        """
        stamp = message.time_ns if isinstance(message, ScadaSample) else message.start_ns
        expected = self._expected(message)
        time = stamp + self._shift
        if expected is not None:
            counted, tolerance = expected
            if abs(time - counted) > tolerance:
                self._shift += counted - time
                time = counted
        elif now is not None and abs(time - now) > FARTHEST_APART * NANOSECONDS:
            self._shift += now - time
            time = now
        elif self._newest is not None and time < self._newest and self._begins(message):
            self._shift += self._newest - time  # a boot follows the one before, whatever its clock
            time = self._newest
        self._newest = time if self._newest is None else max(self._newest, time)
        return time

    def _begins(self, message: AccelerationBlock | ScadaSample) -> bool:
        return isinstance(message, AccelerationBlock)

    def _expected(self, message: AccelerationBlock | ScadaSample) -> tuple[int, float] | None:
        """Logical time by the count of the boot, and how far a stamp may be off it [ns]."""
        if not isinstance(message, AccelerationBlock):
            return None
        before, self._before = self._before, message
        if before is None or before.session != message.session:
            return None
        since, clock = time_apart(before, message)
        behind = message.sequence < before.sequence
        tolerance = STAMP_STEP + CONVERTER_ERROR * abs(since)
        if behind and abs(clock - since) > tolerance:
            return None  # the unit has started again
        counted = before.start_ns + self._shift + round(since * NANOSECONDS)
        return counted, tolerance * NANOSECONDS


class ReplayedTower:
    """What a recording holds of the sensors and the controller, as the tower gave it.

    Parameters
    ----------
    recorded : iterable of AccelerationBlock, SensorLayout and ScadaSample
        In the order in which they were recorded; a link that was cut and restored delivers blocks
        late, so that is not yet the order of time.
    latest_blocks : int, optional
        How many messages too late one may have been recorded.

    Notes
    -----
    Iterating gives every layout when it is met and everything else, unchanged, in the order of
    logical time: of the sensor clock, but where its stamps step against the sample count, of the
    count. Nothing is filled in: blocks that were not recorded stay missing, and the sequence
    numbers show how many.
    """

    def __init__(
        self,
        recorded: Iterable[AccelerationBlock | SensorLayout | ScadaSample],
        *,
        latest_blocks: int = LATEST_BLOCKS,
    ) -> None:
        self._recorded = recorded
        self._latest_blocks = latest_blocks

    def __iter__(self) -> Iterator[AccelerationBlock | SensorLayout | ScadaSample]:
        waiting: list[tuple[int, int, AccelerationBlock | ScadaSample]] = []  # time [ns], arrival
        sources: dict[tuple[str, str], _Source] = {}
        now: int | None = None
        for arrival, message in enumerate(self._recorded):
            if isinstance(message, SensorLayout):
                yield message
                continue
            unit = message.unit if isinstance(message, AccelerationBlock) else ""
            source = sources.setdefault((message.turbine, unit), _Source())
            time_ns = source.time_of(message, now)
            now = time_ns if now is None else max(now, time_ns)
            heapq.heappush(waiting, (time_ns, arrival, message))
            if len(waiting) > self._latest_blocks:
                yield heapq.heappop(waiting)[-1]
        while waiting:
            yield heapq.heappop(waiting)[-1]


def due_time(message: AccelerationBlock | SensorLayout | ScadaSample) -> int | None:
    """When a source gives a message [ns]: a block when its last sample is taken, a SCADA sample
    when it was; a layout, which always holds, at once (None)."""
    match message:
        case AccelerationBlock():
            return message.end_ns
        case ScadaSample():
            return message.time_ns
        case _:
            return None
