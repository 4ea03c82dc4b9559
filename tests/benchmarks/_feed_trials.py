"""Live instruments under load and with their links cut: what was sent, heard and told.

sender ──► [broker, UDP or server] ──► pilewatch feed, a process of its own ──► Zenoh ──► heard
"""

import resource
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from pipeline.messages import NodeStatus
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.feeds.payloads.frame import Frame, encoded
from tests.sensors.feeds.broker import Publisher, broker, free_port, publisher
from tests.sensors.feeds.seedlink_server import records, seedlink_server

PATIENCE = 120.0  # for what another process does [s]
START = 1_700_000_000 * NANOSECONDS
CHANNELS = 8  # each on a topic of its own
RATE = 1000.0  # of an instrument under load [Hz]
LOGGER_RATE = 100.0  # of one that sends miniSEED [Hz]


@dataclass(frozen=True, slots=True)
class FeedOutcome:
    """What became of a feed's messages."""

    sent: int  # messages
    received: int  # messages, as the feed says
    told_lost: int  # messages, as the feed says
    samples_sent: int  # of one channel
    samples_heard: int  # that came over Zenoh with every channel, the right ones
    samples_wrong: int  # that came and are not what was sent
    gaps: int  # in the blocks that came
    late: int
    duplicate: int
    connections_lost: int  # times that a status said the link was down
    cpu: float  # of the feed's process, starting included [s]
    exit_code: int


class Listener:
    """Hears what one feed publishes."""

    def __init__(self, process: "subprocess.Popen[bytes]", inbox: Inbox) -> None:
        self.process = process
        self.blocks: list[AccelerationBlock] = []
        self.status: NodeStatus | None = None  # the last
        self.times_down = 0
        self._inbox = inbox
        self._known: set[tuple[str, int, int]] = set()
        self._down = True

    def take(self, timeout: float = 0.0) -> None:
        """Take in what has come."""
        while (message := self._inbox.get(timeout)) is not None:
            timeout = 0.0
            if isinstance(message, AccelerationBlock):
                known = (message.session, message.sequence, message.start_ns)
                if known not in self._known:  # nothing acknowledges: the spool sends one again
                    self.blocks.append(message)
                self._known.add(known)
            elif isinstance(message, NodeStatus):
                self.status = message
                down = any(doubt.code == "link-down" for doubt in message.warnings)
                self.times_down += down and not self._down
                self._down = down

    def wait_for(self, holds: Callable[[NodeStatus], bool], patience: float = PATIENCE) -> bool:
        """Hear on until a status fulfils a condition; whether one did."""
        deadline = time.monotonic() + patience
        while not (self.status and self.status.state == "running" and holds(self.status)):
            self.take(0.1)
            if self.process.poll() is not None or time.monotonic() > deadline:
                return False
        return True

    @property
    def is_connected(self) -> bool:
        """Whether the last status said so."""
        return not self._down


@contextmanager
def listening(
    folder: Path, address: str, layout: str, *, remembers: bool = False
) -> Iterator[Listener]:
    """`pilewatch feed` as a process of its own, connected to its instrument; ended by SIGTERM.

    remembers   keeps position and messages on disk (--state), with a spool in the same folder
    """
    (folder / "layout.toml").write_text(layout)
    endpoint, inbox = free_endpoint(), Inbox()
    command = [sys.executable, "-m", "pipeline", "feed", address, "--connect", endpoint]
    command += ["--layout", str(folder / "layout.toml"), "--spool", str(folder / "spool")]
    command += ["--state", str(folder / "state")] if remembers else []
    with closing(ZenohBus(hub(endpoint))) as bus:
        bus.subscribe((AccelerationBlock, NodeStatus), inbox)
        process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        listener = Listener(process, inbox)
        try:
            if not listener.wait_for(lambda _: listener.is_connected):
                raise TimeoutError(f"{address} was not connected")
            yield listener
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait(PATIENCE)
            deadline = time.monotonic() + PATIENCE
            while time.monotonic() < deadline:
                listener.take(0.2)
                if listener.status and listener.status.state == "stopped":
                    break


def layout_of(names: Sequence[str], **said: object) -> str:
    """A layout file of channels along x and y in turn."""
    lines = ['turbine = "t1"', 'unit = "top"']
    for number, name in enumerate(names):
        axis = "[1, 0, 0]" if number % 2 == 0 else "[0, 1, 0]"
        lines += ["[[channels]]", f'name = "{name}"', "elevation = 100.0", f"direction = {axis}"]
        lines += [f"{key} = {value!r}" for key, value in said.items()]
    return "\n".join(lines) + "\n"


class Load:
    """Frames of eight channels, `per_second` in all, each sample told apart from every other."""

    def __init__(self, per_second: float, seconds: float) -> None:
        self.size = round(RATE * CHANNELS / per_second)  # samples in a frame
        self.frames = int(seconds * RATE) // self.size  # of each channel
        self.period = self.size / RATE

    @property
    def names(self) -> list[str]:
        """Of the channels."""
        return [f"a{channel}" for channel in range(CHANNELS)]

    def frame(self, channel: int, number: int) -> bytes:
        """One channel's frame of that number."""
        first = number * self.size
        samples = value(channel, np.arange(first, first + self.size))[:, None]
        start_ns = START + round(first / RATE * NANOSECONDS)
        return encoded(Frame(number, 1, start_ns, RATE, samples, (f"a{channel}",)))

    def paced(self, begin: int = 0, end: int | None = None) -> Iterator[int]:
        """Numbers of frames, each when it is due; never sooner."""
        started = time.monotonic()
        for number in range(begin, self.frames if end is None else end):
            due = started + (number - begin + 1) * self.period
            time.sleep(max(0.0, due - time.monotonic()))
            yield number


def value(channel: int, index: np.ndarray) -> np.ndarray:
    """What a channel measures in the sample of that number; exact in float32."""
    return (index % 100_000) + channel / 16


def outcome_of(
    listener: Listener, *, sent: int, samples: int, rate: float, scale: float = 1.0
) -> FeedOutcome:
    """After the feed has ended."""
    right = wrong = 0
    for block in listener.blocks:
        first = round((block.start_ns - START) / NANOSECONDS * rate)
        index = np.arange(first, first + len(block.samples))
        channels = range(block.samples.shape[1])
        expected = np.array([value(channel, index) for channel in channels]).T / scale
        whole = ~np.isnan(block.samples).any(axis=1)
        same = np.isclose(block.samples, expected, rtol=1e-6).all(axis=1)
        right += int(np.sum(whole & same))
        wrong += int(np.sum(whole & ~same))
    firsts = [
        (each.first_sample, each.first_sample + len(each.samples)) for each in listener.blocks
    ]
    gaps = sum(b[0] != a[1] for a, b in pairwise(firsts))
    status = listener.status
    assert status is not None
    return FeedOutcome(
        sent=sent,
        received=status.received[0].count,
        told_lost=status.lost,
        samples_sent=samples,
        samples_heard=right,
        samples_wrong=wrong,
        gaps=gaps,
        late=status.late,
        duplicate=status.duplicate,
        connections_lost=listener.times_down,
        cpu=resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime,
        exit_code=listener.process.returncode,
    )


def mqtt_load(
    folder: Path, *, per_second: float, seconds: float, qos: int = 1, remembers: bool = False
) -> FeedOutcome:
    """So many frames a second through a broker."""
    load = Load(per_second, seconds)
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    with broker(folder) as running, publisher(running.port) as sender:
        address = f"mqtt://127.0.0.1:{running.port}/#?qos={qos}"
        with listening(folder, address, layout_of(load.names), remembers=remembers) as listener:
            for number in load.paced():
                send_all(load, sender, number, qos)
                listener.take()
            sent = load.frames * CHANNELS
            listener.wait_for(lambda status: status.received[0].count + status.lost >= sent)
        outcome = outcome_of(listener, sent=sent, samples=load.frames * load.size, rate=RATE)
    return with_cpu_since(outcome, used)


def mqtt_cut(
    folder: Path, *, per_second: float, seconds: float, away: float, qos: int, client: str = ""
) -> FeedOutcome:
    """The broker is killed in the middle and comes back; the instrument measures on.

    client   the broker is stopped instead, and keeps what it has to give to the feed of this name
    """
    load = Load(per_second, seconds)
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    middle, missed = load.frames // 3, int(away / load.period)
    lines = ("persistence true", f"persistence_location {folder}/") if client else ()
    with broker(folder, *lines) as dying, publisher(dying.port) as sender:
        named = f"&client={client}" if client else ""
        address = f"mqtt://127.0.0.1:{dying.port}/#?qos={qos}{named}"
        with listening(folder, address, layout_of(load.names)) as listener:
            for number in load.paced(0, middle):
                send_all(load, sender, number, qos)
                listener.take()
            sender.settled()
            listener.wait_for(lambda status: status.received[0].count >= middle * CHANNELS)
            if client:
                dying.stop()
            else:
                dying.kill()
            for number in load.paced(middle, middle + missed):
                if qos:  # the instrument keeps what it cannot send
                    send_all(load, sender, number, qos)
                listener.take()
            dying.start()
            listener.wait_for(lambda _: listener.is_connected)
            for number in load.paced(middle + missed):
                send_all(load, sender, number, qos)
                listener.take()
            sent = load.frames * CHANNELS
            listener.wait_for(lambda status: status.received[0].count + status.lost >= sent)
        outcome = outcome_of(listener, sent=sent, samples=load.frames * load.size, rate=RATE)
    return with_cpu_since(outcome, used)


def send_all(load: Load, sender: Publisher, number: int, qos: int) -> None:
    """The frames of one number, of every channel."""
    for channel in range(CHANNELS):
        sender.publish(f"tower/a{channel}", load.frame(channel, number), qos=qos)


def udp_drops(folder: Path, *, per_second: float, seconds: float, share: float) -> FeedOutcome:
    """A share of the datagrams never comes; all of the first and the last do."""
    load = Load(per_second, seconds)
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    port = free_port()
    rng = np.random.default_rng(23)
    sent = 0
    with (
        closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender,
        listening(folder, f"udp://:{port}", layout_of(load.names)) as listener,
    ):
        for number in load.paced():
            for channel in range(CHANNELS):
                if 0 < number < load.frames - 1 and rng.random() < share:
                    continue
                sender.sendto(load.frame(channel, number), ("127.0.0.1", port))
                sent += 1
            listener.take()
        listener.wait_for(lambda status: status.received[0].count >= sent, patience=5.0)
    outcome = outcome_of(listener, sent=sent, samples=load.frames * load.size, rate=RATE)
    return with_cpu_since(outcome, used)


def seedlink_cut(folder: Path, *, seconds: float, cuts: int) -> FeedOutcome:
    """A data logger whose link is cut several times while it measures on."""
    names = ["XX.TWR.00.HNX", "XX.TWR.00.HNY"]
    used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    n_samples = int(seconds * LOGGER_RATE)
    scale = 16.0  # counts are whole numbers
    index = np.arange(n_samples)
    of_each = [
        records(name, np.round(value(i, index) * scale), start_ns=START, sampling_rate=LOGGER_RATE)
        for i, name in enumerate(names)
    ]
    packets = [record for pair in zip(*of_each, strict=True) for record in pair]
    bounds = np.linspace(0, len(packets), cuts + 2).astype(int)
    with seedlink_server() as server:
        address = f"seedlink://127.0.0.1:{server.port}/XX.TWR"
        layout = layout_of(names, unit="m/s²", sensitivity=scale)
        with listening(folder, address, layout) as listener:
            for number, (begin, end) in enumerate(pairwise(bounds)):
                half = (begin + end) // 2
                server.add(packets[begin:half])
                listener.wait_for(lambda status, n=half: status.received[0].count >= n)  # type: ignore[misc]
                if number < cuts:
                    server.stop()
                    server.add(packets[half:end])  # while nobody is connected
                    listener.wait_for(lambda _: not listener.is_connected, patience=5.0)
                    server.start()
                else:
                    server.add(packets[half:end])
                listener.wait_for(lambda status, n=end: status.received[0].count >= n)  # type: ignore[misc]
        outcome = outcome_of(listener, sent=len(packets), samples=n_samples, rate=LOGGER_RATE)
    return with_cpu_since(outcome, used)


def with_cpu_since(outcome: FeedOutcome, used: float) -> FeedOutcome:
    """With the CPU time of this feed alone."""
    return replace(outcome, cpu=outcome.cpu - used)
