"""How far a feed was published, on its way to disk."""

import os
import threading
from pathlib import Path

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.feeds.assembly.assembler import Assembler
from sensors.feeds.live import LiveFeed
from sensors.feeds.position import FeedPosition
from sensors.feeds.protocol import ChannelSamples
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.sensors.feeds.scripted import ScriptedFeed, measured_until


def test_a_position_is_whole_on_disk_before_it_takes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, synced = tmp_path / "position.json", []
    monkeypatch.setattr(
        os, "fsync", lambda file: synced.append((os.fstat(file).st_size, path.exists()))
    )
    position = FeedPosition(path)
    position.published(0, NANOSECONDS, 1e8)
    position.save()
    assert synced == [(path.stat().st_size, False)]
    assert FeedPosition(path).resumed_ns == NANOSECONDS


def piece(second: int) -> ChannelSamples:
    return ChannelSamples("t", ("ax",), np.zeros((10, 1)), second * NANOSECONDS, 10.0)


def published(position: FeedPosition, seconds: range) -> None:
    for second in seconds:
        begin, end = second * NANOSECONDS, (second + 1) * NANOSECONDS
        position.publishing(begin, end, 1e8)
        position.published(begin, end, 1e8)


def test_a_kill_between_two_savings_costs_no_block(tmp_path: Path) -> None:
    position = FeedPosition(tmp_path / "position.json", clock=lambda: 0.0)
    published(position, range(5, 55))
    assert not (tmp_path / "position.json").exists()
    assert FeedPosition(tmp_path / "position.json").resumed_ns == 55 * NANOSECONDS


def test_a_feed_that_stops_leaves_its_position_on_disk(tmp_path: Path) -> None:
    """With the numbers of the records, which the mark beside it has not."""
    path = tmp_path / "position.json"
    position = FeedPosition(path, clock=lambda: 0.0)
    position.received("station", 7, 55 * NANOSECONDS)
    published(position, range(5, 56))
    assert measured_until(LiveFeed(ScriptedFeed([]), None, position), lambda: True) == []
    assert FeedPosition(path).sequences == {"station": 7}


def test_after_a_power_cut_the_newer_one_of_file_and_mark_holds(tmp_path: Path) -> None:
    path = tmp_path / "position.json"
    position = FeedPosition(path, clock=lambda: 0.0)
    published(position, range(10))
    mark = path.with_suffix(".mark").read_bytes()
    published(position, range(10, 20))
    position.save()
    for left in (mark, b"", mark[:-1], b"\1" * len(mark)):
        path.with_suffix(".mark").write_bytes(left)
        assert FeedPosition(path).resumed_ns == 20 * NANOSECONDS


def test_a_block_that_a_kill_left_in_the_spool_is_published(tmp_path: Path) -> None:
    path = tmp_path / "position.json"
    position = FeedPosition(path, clock=lambda: 0.0)
    published(position, range(10))
    position.publishing(10 * NANOSECONDS, 11 * NANOSECONDS, 1e8)

    for kept, published_until in ((9, 10), (10, 11), (11, 10)):  # the spool's last block
        again = FeedPosition(path)
        again.has_published(kept * NANOSECONDS, (kept + 1) * NANOSECONDS)
        assert again.published_ns == published_until * NANOSECONDS
        assert (again.unpublished(piece(10)) is None) == (kept == 10)


def test_what_was_received_before_is_known_however_long_ago_and_another_clock_is_none(
    tmp_path: Path,
) -> None:
    position = FeedPosition(tmp_path / "position.json", clock=lambda: 0.0)
    published(position, range(5000, 6000))
    published(position, range(1000, 3000))  # the clock was set back

    def again(second: int, *, received_before: bool) -> bool:
        resumed = FeedPosition(tmp_path / "position.json")
        return resumed.unpublished(piece(second), received_before=received_before) is not None

    assert not again(1000, received_before=True)
    assert again(1000, received_before=False)
    assert again(5, received_before=True)
    assert again(5000, received_before=True)


def test_a_block_is_marked_before_it_goes_out(tmp_path: Path) -> None:
    """Killed while it is published, it may be in the spool: the next process has to ask."""
    position = FeedPosition(tmp_path / "position.json", clock=lambda: 0.0)
    channel = MappedChannel("ax", 100.0, (1.0, 0.0, 0.0))
    feed = ScriptedFeed([piece(second) for second in range(100, 110)])
    live = LiveFeed(feed, Assembler(LayoutFile((channel,), "t1", "top"), feed.counts), position)
    for each in live.measured(threading.Event()):
        if isinstance(each, AccelerationBlock):
            break
    again = FeedPosition(tmp_path / "position.json")
    assert again.resumed_ns < each.end_ns
    again.has_published(each.start_ns, each.end_ns)
    assert again.published_ns == each.end_ns
