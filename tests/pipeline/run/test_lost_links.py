"""Links between the parts of one run that are lost while the parts go on."""

import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, closing, suppress
from pathlib import Path

import pytest

from pipeline.run.endpoints import meeting_point
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import block

PATIENCE = 20.0  # [s]


def cut_links(port: int) -> int:
    """Shut what this process has connected to a port; return how many links that were."""
    shut = 0
    for each in os.listdir("/proc/self/fd"):
        with suppress(OSError), socket.socket(fileno=os.dup(int(each))) as copy:
            if copy.family == socket.AF_INET and copy.getpeername()[1] == port:
                copy.shutdown(socket.SHUT_RDWR)
                shut += 1
    return shut


def sequences(inbox: Inbox, count: int) -> Iterator[int]:
    for _ in range(count):
        message = inbox.get(PATIENCE)
        assert isinstance(message, AccelerationBlock)
        yield message.sequence


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="cuts links by /proc/self/fd")
def test_nodes_of_a_run_have_one_link_each_and_it_comes_back() -> None:
    """On main before, nodes had links with each other, too, which nothing opens again: one that
    had expired on a busy machine cost a recorder all later posteriors, without a word."""
    meeting = meeting_point(ZenohSettings())
    with ExitStack() as stack:
        stack.enter_context(closing(ZenohBus(meeting.hub)))
        one, other = (stack.enter_context(closing(ZenohBus(meeting.nodes))) for _ in range(2))
        inbox = Inbox()
        other.subscribe([AccelerationBlock], inbox)
        one.publish(block(0))
        assert list(sequences(inbox, 1)) == [0]
        assert [len(each.links()) for each in (one, other)] == [1, 1]
        assert cut_links(int(meeting.endpoint.rpartition(":")[2])) == 2
        for sequence in (1, 2, 3):
            one.publish(block(sequence))
        assert list(sequences(inbox, 3)) == [1, 2, 3]
