"""A feed that is killed again and again while it catches up: what comes twice, what never comes.

sender ──► broker, which keeps it ──► pilewatch feed, killed and started again ──► Zenoh ──► shore

The shore acknowledges what it has, as a recorder does; a block is known by its session, number and
stamp. What comes again under the same three is the same block; a sample that comes in two blocks
was published twice.
"""

import json
import random
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.messages import NodeStatus
from pipeline.recording.acknowledgement import Acknowledgements
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._feed_trials import PATIENCE, START, layout_of
from tests.sensors.feeds.broker import broker, publisher

RATE = 40.0  # of the instrument [Hz]
SAMPLES = 10  # of a message
WITHIN = 0.2  # of the first block after a start, every other time the feed is killed [s]
RECEIVING = 0.5  # the same, of the moment at which it is ready and has nothing yet


@dataclass(frozen=True, slots=True)
class KillOutcome:
    """What became of the samples of a feed that was killed."""

    kills: int
    while_catching_up: int  # kills before which some, and not all, of what waited had come
    sent: int  # samples
    lost: int  # samples that never came
    twice: int  # samples that came in more than one block
    wrong: int  # samples that are not what was sent at their time


class Shore:
    """Hears blocks and acknowledges them."""

    def __init__(self, bus: ZenohBus) -> None:
        self.blocks: dict[tuple[str, int, int], AccelerationBlock] = {}
        self._bus, self._inbox, self._acknowledgements = bus, Inbox(100_000), Acknowledgements()
        self.is_connected = False
        self.starts = 0  # feeds that said they are ready
        bus.subscribe((AccelerationBlock, NodeStatus), self._inbox)

    @property
    def heard(self) -> int:
        """Samples of different blocks."""
        return sum(len(block.samples) for block in self.blocks.values())

    def hear_until(self, holds: Callable[[], bool]) -> None:
        """Take what comes until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not holds():
            self.take(0.01)
            if time.monotonic() > deadline:
                raise TimeoutError("the feed does not what is waited for")

    def take(self, timeout: float) -> None:
        """Take what has come, and acknowledge it."""
        while (message := self._inbox.get(timeout)) is not None:
            timeout = 0.0
            if isinstance(message, AccelerationBlock):
                self.blocks[message.session, message.sequence, message.start_ns] = message
                self._acknowledgements.note(message)
            elif isinstance(message, NodeStatus):
                down = any(warning.code == "link-down" for warning in message.warnings)
                self.starts += message.state == "ready"
                self.is_connected = message.state == "running" and not down
        if self._acknowledgements.sync():
            for answer in self._acknowledgements.acknowledged(time.time_ns()):
                self._bus.publish(answer)


def killed_feed(
    folder: Path, *, kills: int, seconds: float, spooled: bool = True, numbered: bool = True
) -> KillOutcome:
    """Kill a feed that has so much measured time to catch up with [s].

    numbered  whether messages have numbers
    spooled   with its spool, as `pilewatch feed` has it; without, what was on its way at the kill
              and in no buffer of the system is lost
    """
    rng = random.Random(20)
    (folder / "layout.toml").write_text(layout_of(["ax", "ay"]))
    endpoint = free_endpoint()
    n_messages = round(seconds * RATE / SAMPLES)
    sent, caught = n_messages * SAMPLES, 0
    with (
        broker(folder) as running,
        publisher(running.port) as sender,
        closing(ZenohBus(hub(endpoint))) as bus,
    ):
        command = [sys.executable, "-m", "pipeline", "feed"]
        command += [f"mqtt://127.0.0.1:{running.port}/tower/#", "--connect", endpoint]
        command += ["--layout", str(folder / "layout.toml"), "--state", str(folder / "state")]
        command += ["--spool", str(folder / "spool")] if spooled else ["--no-keep"]
        shore = Shore(bus)
        with feed(command):
            shore.hear_until(lambda: shore.is_connected)  # the broker knows its name from now on
        bounds = np.linspace(0, n_messages, kills + 1).astype(int)
        for kill, (begin, end) in enumerate(pairwise(bounds)):
            for number in range(begin, end):
                sender.publish("tower/top", message_of(number, numbered=numbered))
            sender.settled()
            shore.starts, before = 0, len(shore.blocks)
            with feed(command):
                if kill % 2:  # while it receives
                    shore.hear_until(lambda: shore.starts > 0)
                    time.sleep(rng.uniform(0.0, RECEIVING))
                else:  # while it publishes
                    shore.hear_until(lambda n=before: len(shore.blocks) > n)  # type: ignore[misc]
                    time.sleep(rng.uniform(0.0, WITHIN))
            shore.take(0.3)
            caught += int(shore.heard < end * SAMPLES - RATE)
        with feed(command) as process:
            deadline = time.monotonic() + PATIENCE
            while shore.heard < sent and time.monotonic() < deadline:
                shore.take(0.1)
            process.terminate()
            process.wait(PATIENCE)
        shore.take(1.0)
    return outcome_of(shore, kills, caught, sent)


def message_of(number: int, *, numbered: bool) -> bytes:
    """Samples whose values are their numbers."""
    first = number * SAMPLES
    values = list(range(first, first + SAMPLES))
    content = {
        "time": START / NANOSECONDS + first / RATE,
        "rate": RATE,
        "values": {"ax": values, "ay": values},
    }
    if numbered:
        content["sequence"] = number
    return json.dumps(content).encode()


def outcome_of(shore: Shore, kills: int, caught: int, sent: int) -> KillOutcome:
    """After the last feed has ended."""
    times: Counter[int] = Counter()
    wrong = 0
    for block in shore.blocks.values():
        first = round((block.start_ns - START) / NANOSECONDS * RATE)
        numbers = np.arange(first, first + len(block.samples))
        wrong += int(np.sum((block.samples != numbers[:, None]).any(axis=1)))
        times.update(numbers.tolist())
    return KillOutcome(
        kills=kills,
        while_catching_up=caught,
        sent=sent,
        lost=sum(number not in times for number in range(sent)),
        twice=sum(count > 1 for count in times.values()),
        wrong=wrong,
    )


@contextmanager
def feed(command: list[str]) -> Iterator["subprocess.Popen[bytes]"]:
    """A feed's process; killed at the end, where it has not ended."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        yield process
    finally:
        process.kill()
        process.wait(PATIENCE)
