"""An acquisition unit that measures on whether or not it is heard.

python -m tests.benchmarks._unit RECORDING ENDPOINT BEGAN SPEED LOG

Begins when a line comes on its standard input. Publishes each block of the recording when its last
sample has been taken, SPEED times faster, counted from the moment BEGAN [s, the machine's monotonic
clock], and notes its number in the file LOG. What was due before it began was measured by nobody: a
unit that is killed leaves a gap. It ends with a StreamEnd when the recording does, and stays until
its standard input ends, for what is asked of it again.
"""

import sys
import time
from contextlib import closing
from pathlib import Path

from pipeline.messages import StreamEnd
from pipeline.recording.reader import read_messages
from pipeline.transport.zenoh_bus import ZenohBus, peer_of
from sensors.blocks import NANOSECONDS, AccelerationBlock
from sensors.layout import SensorLayout


def main(recording: Path, endpoint: str, began: float, speed: float, log: Path) -> None:
    """Publish what is still to come."""
    messages = list(read_messages(recording, (SensorLayout, AccelerationBlock)))
    blocks = [each for each in messages if isinstance(each, AccelerationBlock)]
    first_ns = blocks[0].start_ns
    sys.stdin.readline()
    with closing(ZenohBus(peer_of(endpoint))) as bus, log.open("a", buffering=1) as noted:
        for layout in messages:
            if isinstance(layout, SensorLayout):
                bus.publish(layout)
        for block in blocks:
            due = began + (block.end_ns - first_ns) / NANOSECONDS / speed
            if due < time.monotonic() - 0.5 / speed:
                continue
            time.sleep(max(0.0, due - time.monotonic()))
            bus.publish(block)
            print(block.sequence, file=noted)
        last = blocks[-1]
        bus.publish(StreamEnd(last.turbine, last.unit, last.session, last.end_ns, len(blocks)))
        sys.stdin.read()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], float(sys.argv[3]), float(sys.argv[4]), Path(sys.argv[5]))
