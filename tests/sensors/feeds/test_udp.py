"""Frames over the loopback interface."""

import asyncio
import socket
import threading
from collections.abc import Callable
from contextlib import closing

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.feeds.address import parsed
from sensors.feeds.open_feed import open_feed
from sensors.feeds.payloads.frame import Frame, encoded
from sensors.feeds.payloads.frame_reader import FrameReader
from sensors.feeds.protocol import ArrivalQueue, ChannelSamples, FeedCounts, FeedError
from sensors.feeds.udp import UdpFeed, _Receiver
from sensors.files.layout_file import LayoutFile, MappedChannel

LAYOUT = LayoutFile((MappedChannel("ax", 100.0, (1.0, 0.0, 0.0)),), "t1", "top")
START = 1_700_000_000 * NANOSECONDS
RATE = 100.0


def frame(number: int, **said: object) -> bytes:
    samples = np.full((100, 1), float(number))
    key = said.pop("key", b"")
    sent = Frame(number, 1, START + number * NANOSECONDS, RATE, samples, ("ax",))
    return encoded(sent, key)  # type: ignore[arg-type]


def received(payloads: list[bytes], until: Callable[[UdpFeed], bool], query: str = "") -> UdpFeed:
    """Send datagrams to a feed, until it has counted what it should."""

    async def exchange() -> UdpFeed:
        feed = UdpFeed(parsed(f"udp://:0{query}"), ("ax",))
        running = asyncio.create_task(feed.run(ArrivalQueue()))
        await asyncio.wait_for(feed.bound.wait(), 10)
        with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
            for payload in payloads:
                sender.sendto(payload, ("127.0.0.1", feed.port))
            async with asyncio.timeout(10):
                while not until(feed):
                    await asyncio.sleep(0.01)
        running.cancel()
        return feed

    return asyncio.run(exchange())


def test_frames_that_never_come_are_counted_exactly() -> None:
    sent = [frame(number) for number in range(1000) if number % 97 != 5]
    feed = received(sent, lambda feed: feed.counts.received == len(sent))
    assert feed.counts.lost == 1000 - len(sent) == 11
    assert (feed.counts.duplicate, feed.counts.late, feed.counts.malformed) == (0, 0, 0)


def test_the_frame_behind_one_for_which_there_was_no_room_lies_behind_a_gap() -> None:
    counts, inbox = FeedCounts(), ArrivalQueue(2)
    receiver = _Receiver(FrameReader(("ax",), counts), inbox)
    for number in range(3):
        receiver.datagram_received(frame(number), "")
    taken = [inbox.get_nowait(), inbox.get_nowait()]
    for number in (3, 4):
        receiver.datagram_received(frame(number), "")
    taken += [inbox.get_nowait(), inbox.get_nowait()]
    assert counts.lost == 1
    follows = [each.follows for each in taken if isinstance(each, ChannelSamples)]
    assert follows[1:] == [True, None, True]


def test_what_is_no_frame_is_counted_and_hurts_nobody() -> None:
    nonsense = [b"", b"hello", b"PWB1" + bytes(60), frame(3)[:-4], bytes(65_000)]
    sent = [frame(0), *nonsense, frame(1), frame(1)]
    feed = received(sent, lambda feed: feed.counts.received == len(sent))
    assert feed.counts.malformed == 5
    assert feed.counts.duplicate == 1
    assert feed.counts.lost == 0


def test_with_a_key_only_signed_frames_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PILEWATCH_FEED_KEY", "of the tower")
    sent = [frame(0, key=b"of the tower"), frame(1), frame(1, key=b"guess")]
    sent.append(frame(1, key=b"of the tower"))
    feed = received(sent, lambda feed: feed.counts.received == 4)
    assert feed.counts.forged == 2
    assert feed.counts.lost == 0


def test_frames_of_one_sender_become_blocks() -> None:
    live = open_feed("udp://:0", LAYOUT, turbine="t9")
    stopping = threading.Event()
    blocks: list[AccelerationBlock] = []
    sent = False
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as sender:
        for block in live.measured(stopping):
            if isinstance(block, AccelerationBlock):
                blocks.append(block)
            elif live.counts.connected and not sent:
                sent = True
                for number in range(6):
                    sender.sendto(frame(number), ("127.0.0.1", live.port))
            elif live.counts.received == 6:
                stopping.set()
    assert [block.samples[0, 0] for block in blocks] == [0, 1, 2, 3, 4, 5]
    assert {(block.turbine, block.unit) for block in blocks} == {("t9", "top")}
    assert not live.counts.connected


def test_a_port_that_is_taken_is_one_line() -> None:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as other:
        other.bind(("127.0.0.1", 0))
        taken = other.getsockname()[1]
        live = open_feed(f"udp://:{taken}", LAYOUT)
        with pytest.raises(FeedError, match=f"UDP port {taken} of 127.0.0.1 cannot be listened on"):
            list(live.measured(threading.Event()))
