"""An acquisition unit that measures on whether or not it is heard.

python -m tests.benchmarks._unit RECORDING ENDPOINT SPEED LOG

Comes up, says so, and begins when a line comes on its standard input: with the moment at which the
measuring began [s, the machine's monotonic clock], or without one where it begins it, which it then
says. It publishes each block of the recording when its last sample has been taken, SPEED times
faster, and notes its number in the file LOG. What was due before it began was measured by nobody: a
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
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout


def main(recording: Path, endpoint: str, speed: float, log: Path) -> None:
    """Publish what is still to come."""
    messages = list(read_messages(recording, (SensorLayout, AccelerationBlock)))
    blocks = [each for each in messages if isinstance(each, AccelerationBlock)]
    print("up", flush=True)
    told = sys.stdin.readline().strip()
    with closing(ZenohBus(peer_of(endpoint))) as bus, log.open("a", buffering=1) as noted:
        for layout in messages:
            if isinstance(layout, SensorLayout):
                bus.publish(layout)
        began = float(told) if told else time.monotonic()
        print(repr(began), flush=True)
        due = [began + (each.end_ns - blocks[0].start_ns) / NANOSECONDS / speed for each in blocks]
        now = time.monotonic()
        for moment, block in zip(due, blocks, strict=True):
            if moment >= now:
                time.sleep(max(0.0, moment - time.monotonic()))
                bus.publish(block)
                print(block.sequence, file=noted)
        last = blocks[-1]
        bus.publish(StreamEnd(last.turbine, last.unit, last.session, last.end_ns, len(blocks)))
        sys.stdin.read()


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], float(sys.argv[3]), Path(sys.argv[4]))
