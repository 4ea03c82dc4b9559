"""Delivery from a unit's disk to the shore's: cuts, restarts and power cuts on either side."""

import os
import threading
from collections.abc import Sequence
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

from pipeline.messages import Message, RecordedUntil
from pipeline.recording.latest_messages import readable_messages
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.recording.settings import RecordingSettings
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.sources.publisher import SENT_AGAIN_AFTER, TENDED_EVERY, DurablePublisher
from pipeline.sources.spool import Spool
from pipeline.streams import key_of
from pipeline.transport.bus import Delivery, Inbox
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.example_messages import START_NS, block
from tests.pipeline.power_cut import Disk, power_cut

TICK = 0.25  # [s]
HALF_HOUR, TWO_HOURS = 1800, 7200  # blocks, by day and at night; the benchmark has the whole day


class Link:
    """A bus between a unit and the shore's recorder; what it cannot carry is lost."""

    def __init__(self) -> None:
        self.is_up = True
        self.recorder: SessionRecorder | None = None
        self.acknowledged: set[int] = set()
        self._inboxes: list[Inbox] = []

    def publish(self, message: Message, payload: bytes | None = None) -> None:
        if not self.is_up or self.recorder is None:
            return
        for answer in self.recorder.handle(message):
            assert isinstance(answer, RecordedUntil)
            for each in answer.ranges:
                self.acknowledged.update(range(each.first, each.end))
            for inbox in self._inboxes:
                inbox.put(Delivery(RecordedUntil, key_of(answer), encode(answer)))

    def subscribe(self, types: Sequence[type], inbox: Inbox, *, key: str | None = None) -> None:  # type: ignore[return]
        self._inboxes.append(inbox)

    def forget_unit(self) -> None:
        self._inboxes.clear()

    def close(self) -> None:
        """Nothing is held."""


class Trial:
    """A unit that publishes a block a second, and a shore; time is counted, nothing sleeps."""

    def __init__(self, folder: Path) -> None:
        self.now = 0.0
        self.link = Link()
        self.unit_folder, self.shore_folder = folder / "unit", folder / "shore"
        for each in (self.unit_folder, self.shore_folder):
            each.mkdir()
        self.published: dict[int, float] = {}  # block → when
        self.unit_cuts: list[float] = []
        self.start_unit()
        self.start_shore()

    def clock_ns(self) -> int:
        return START_NS + round(self.now * NANOSECONDS)

    def start_unit(self) -> None:
        self.link.forget_unit()
        self.publisher = DurablePublisher(  # type: ignore[call-overload]
            self.link, Spool(self.unit_folder / "spool"), clock=lambda: self.now
        )
        for spooled in self.publisher._spool.waiting():
            self.publisher._listen(*spooled.session[:2])

    def start_shore(self) -> None:
        self.link.recorder = SessionRecorder(
            self.shore_folder / "session.mcap",
            metadata={},
            clock=self.clock_ns,
            settings=RecordingSettings(rotate_after=300.0),
            free=lambda _: 10**12,
        )

    def run(self, seconds: float, *, speed: int = 1) -> None:
        """Publish a block a second, `speed` of them at once."""
        for _ in range(round(seconds / TICK / speed)):
            for _ in range(speed):
                self.now += TICK
                number = int(self.now)
                if number not in self.published:
                    self.published[number] = self.now
                    self.publisher.publish(block_of(number))
            self.publisher.tend()

    def cut_power(self, disks: dict[str, Disk], side: str) -> None:
        """Of the unit or the shore; it starts again at once."""
        if side == "unit":
            self.unit_cuts.append(self.now)
            self._let_go_of_spool()
            disks[side].cut()
            self.start_unit()
        else:
            assert self.link.recorder is not None
            if self.link.recorder._recorder is not None:
                self.link.recorder._recorder.abandon()
            disks[side].cut()
            self.start_shore()

    def cut_power_everywhere(self, disk: Disk) -> None:
        """Of the unit and the shore at once; both start again."""
        self.unit_cuts.append(self.now)
        self._let_go_of_spool()
        assert self.link.recorder is not None
        assert self.link.recorder._recorder is not None
        self.link.recorder._recorder.abandon()
        disk.cut()
        self.start_unit()
        self.start_shore()

    def _let_go_of_spool(self) -> None:
        spool = self.publisher._spool
        if spool._file is not None:
            spool._file.close()
        os.close(spool._lock)

    def restart_unit(self) -> None:
        self.publisher._spool.close()
        self.start_unit()

    def recorded(self) -> set[int]:
        files = [*self.shore_folder.glob("*.mcap"), *self.shore_folder.glob(f"*{ACTIVE_SUFFIX}")]
        found = set()
        for file in files:
            for message in readable_messages(file):
                if isinstance(message, AccelerationBlock):
                    found.add(message.sequence)
        return found


_BLOCKS: dict[int, AccelerationBlock] = {}


def block_of(number: int) -> AccelerationBlock:
    return _BLOCKS.setdefault(number, block(number))


def test_a_block_over_a_link_that_holds_is_sent_once(tmp_path: Path) -> None:
    trial = Trial(tmp_path)
    trial.run(60.0)
    assert trial.publisher.sent_again == 0
    assert len(trial.publisher._spool) <= 8


def test_a_block_a_second_is_synced_as_it_is_published(tmp_path: Path) -> None:
    """No other thread has to wake for it."""
    trial = Trial(tmp_path)
    trial.link.is_up = False
    with power_cut(tmp_path) as disk:
        for number in range(1, 6):
            trial.now = float(number)
            trial.publisher.publish(block_of(number))
        trial._let_go_of_spool()
        disk.cut()
    assert [each.sequence for each in Spool(tmp_path / "unit" / "spool").waiting()] == [
        *range(1, 6)
    ]


def test_blocks_that_follow_fast_are_synced_within_a_second(tmp_path: Path) -> None:
    """Nothing is published after them."""
    synced = threading.Event()

    def sync(descriptor: int) -> None:
        if os.readlink(f"/proc/self/fd/{descriptor}").endswith(".blocks"):
            synced.set()

    spool = Spool(tmp_path / "spool")
    with patch("os.fsync", sync), DurablePublisher(Link(), spool) as publisher:  # type: ignore[arg-type]
        for number in range(2):
            synced.clear()
            publisher.publish(block_of(number))
        assert synced.wait(TENDED_EVERY - 1.0)


def test_a_disk_that_takes_no_more_is_a_warning_until_it_does(tmp_path: Path) -> None:
    trial = Trial(tmp_path)
    spool = trial.publisher._spool
    for number in (1, 2):
        trial.now = float(number)
        with patch.object(spool, "append", side_effect=OSError(28, "No space left on device")):
            trial.publisher.publish(block_of(number))
        (warning,) = trial.publisher.warnings
        assert warning.text.endswith("takes no more: No space left on device")
    trial.now = 3.0
    trial.publisher.publish(block_of(3))
    assert not trial.publisher.warnings


def test_after_a_cut_everything_is_sent_again(tmp_path: Path) -> None:
    trial = Trial(tmp_path)
    trial.run(30.0)
    trial.link.is_up = False
    trial.run(600.0)
    tried = trial.publisher.sent_again
    assert tried <= 600.0 / SENT_AGAIN_AFTER + 1  # one now and then: the link may be dear
    trial.link.is_up = True
    trial.run(60.0)
    assert len(trial.publisher._spool) <= 8
    assert set(trial.published) - trial.recorded() <= set(list(trial.published)[-8:])


def test_a_unit_that_was_killed_sends_again_what_was_not_acknowledged(tmp_path: Path) -> None:
    trial = Trial(tmp_path)
    trial.link.is_up = False
    trial.run(100.0)
    trial.restart_unit()
    trial.link.is_up = True
    trial.run(30.0)
    assert set(range(1, 100)) <= trial.recorded()


@pytest.mark.parametrize("cut", [HALF_HOUR, pytest.param(TWO_HOURS, marks=pytest.mark.nightly)])
def test_a_day_without_a_link_and_a_power_cut_on_either_side_lose_nothing(
    cut: int, tmp_path: Path
) -> None:
    """A day at speed; blocks are small."""
    trial = Trial(tmp_path)
    with power_cut(tmp_path) as disk:
        trial.run(20.0)
        trial.link.is_up = False
        trial.run(cut, speed=40)
        trial.publisher.tend()
        trial.cut_power_everywhere(disk)
        trial.link.is_up = True
        trial.run(60.0 + cut / 40)
    missing = set(trial.published) - trial.recorded()
    assert not trial.link.acknowledged & missing
    late = {n for n, when in trial.published.items() if trial.now - when < 2.0}
    unsynced = {n for n, when in trial.published.items() if 0 <= trial.unit_cuts[0] - when <= 1.0}
    assert missing <= late | unsynced


@pytest.mark.parametrize("seed", range(12))
def test_acknowledged_blocks_are_on_disk_whatever_happens(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    trial = Trial(tmp_path)
    with power_cut(tmp_path / "unit") as unit, power_cut(tmp_path / "shore") as shore:
        disks = {"unit": unit, "shore": shore}

        def both(descriptor: int) -> None:
            unit.sync(descriptor)
            shore.sync(descriptor)

        with patch("os.fsync", both):
            for _ in range(8):
                trial.run(float(rng.integers(1, 60)) + TICK * float(rng.integers(0, 4)))
                match rng.integers(0, 5):
                    case 0:
                        trial.link.is_up = not trial.link.is_up
                    case 1:
                        trial.restart_unit()
                    case 2:
                        trial.cut_power(disks, "unit")
                    case 3:
                        trial.cut_power(disks, "shore")
                    case _:
                        trial.link.is_up = True
            trial.link.is_up = True
            trial.run(40.0)
            missing = set(trial.published) - trial.recorded()
            late = {n for n, when in trial.published.items() if trial.now - when < 2.0}
            unsynced = {
                n
                for n, when in trial.published.items()
                if any(0 <= cut - when <= 1.0 for cut in trial.unit_cuts)
            }
            assert not trial.link.acknowledged & missing
            assert missing <= late | unsynced, sorted(missing - late - unsynced)
