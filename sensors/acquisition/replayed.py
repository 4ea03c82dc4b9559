"""ReplayedTower: what was recorded in time order, gaps kept as gaps."""

import heapq
from collections.abc import Iterable, Iterator

from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

LATEST_BLOCKS = 1200  # a recorded block may come that many blocks too late: the publisher's cache


class ReplayedTower:
    """What a recording holds of the sensors and the controller, as the tower gave it.

    recorded        layouts, blocks and SCADA samples in the order in which they were recorded; a
                    link that was cut and mended delivers blocks late, so that is not yet the order
                    of time
    latest_blocks   how many messages too late one may have been recorded

    Iterating gives every layout when it is met and everything else, unchanged, in the order of the
    sensor clock. Nothing is filled in: blocks that were not recorded stay missing, and the
    sequence numbers tell how many.
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
        for arrival, message in enumerate(self._recorded):
            if isinstance(message, SensorLayout):
                yield message
                continue
            time_ns = message.time_ns if isinstance(message, ScadaSample) else message.start_ns
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
