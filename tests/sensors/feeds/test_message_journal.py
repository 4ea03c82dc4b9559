"""Confirmed messages stay on disk until their samples are published."""

import os
from pathlib import Path

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.message_journal import MessageJournal
from sensors.feeds.position import FeedPosition
from sensors.feeds.protocol import ChannelSamples


class Clock:
    """Seconds that a test sets."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def journal(folder: Path, clock: Clock | None = None) -> tuple[MessageJournal, FeedPosition]:
    position = FeedPosition(folder / "feed.json")
    made = MessageJournal(
        folder / "feed.messages",
        position,
        lambda topic: topic == "names",
        clock or Clock(),
    )
    return made, position


def piece(second: int) -> ChannelSamples:
    return ChannelSamples("t", ("ax",), np.zeros((10, 1)), second * NANOSECONDS, 10.0)


def test_what_is_published_goes_and_what_is_not_comes_back_in_order(tmp_path: Path) -> None:
    clock = Clock()
    kept, position = journal(tmp_path, clock)
    assert kept.resumed() == ([], [])
    for second in range(60):
        clock.now = float(second)
        kept.keep("t", b"%d" % second)
        kept.taken(piece(second))
        kept.taken(None)
        if second < 50:
            position.published(second * NANOSECONDS, (second + 1) * NANOSECONDS, 1e8)
    kept.close()

    again, _ = journal(tmp_path)
    _, messages = again.resumed()
    numbers = [int(payload) for _, payload in messages]
    assert numbers == list(range(numbers[0], 60))
    assert 40 < numbers[0] <= 50
    assert again.resumed()[1] == messages  # and after another kill at once


def test_names_survive_all_files_and_are_told_apart_from_messages(tmp_path: Path) -> None:
    clock = Clock()
    kept, position = journal(tmp_path, clock)
    kept.resumed()
    kept.keep("names", b"old")
    kept.keep("names", b"new")
    kept.taken(None)
    kept.taken(None)
    for second in range(20):
        clock.now = 3.0 * second
        kept.keep("t", b"%d" % second)
        kept.taken(piece(second))
        kept.taken(None)
        position.published(second * NANOSECONDS, (second + 1) * NANOSECONDS, 1e8)

    descriptions, messages = journal(tmp_path)[0].resumed()
    assert set(descriptions) == {("names", b"new")}
    assert all(topic == "t" for topic, _ in messages)


def test_a_message_that_is_not_taken_yet_is_kept_however_old(tmp_path: Path) -> None:
    clock = Clock()
    kept, position = journal(tmp_path, clock)
    kept.resumed()
    for second in range(20):
        clock.now = 3.0 * second
        kept.keep("t", b"%d" % second)
    position.published(0, 100 * NANOSECONDS, 1e8)  # of another source of samples

    _, messages = journal(tmp_path)[0].resumed()
    assert len(messages) == 20


@pytest.mark.parametrize("damage", [b"", b"\0", b"\0\1\2\3\4\0\1\0\0\0\1xy"])
def test_a_record_that_is_cut_off_or_damaged_ends_the_file_and_nothing_else(
    damage: bytes, tmp_path: Path
) -> None:
    kept, _ = journal(tmp_path)
    kept.resumed()
    kept.keep("t", b"1")
    with (tmp_path / "feed.messages").open("ab") as file:
        file.write(damage)

    assert journal(tmp_path)[0].resumed() == ([], [("t", b"1")])


def test_a_damaged_record_costs_its_message_and_a_damaged_length_the_rest_with_a_word(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kept, _ = journal(tmp_path)
    kept.resumed()
    for second in range(5):
        kept.keep("t", b"message %d" % second)
    kept.close()
    file = tmp_path / "feed.messages"
    content = file.read_bytes()
    size = len(content) // 5

    def resumed(at: int, byte: int) -> list[bytes]:
        for each in tmp_path.iterdir():
            each.unlink()
        file.write_bytes(content[:at] + bytes([byte]) + content[at + 1 :])
        return [payload[-1:] for _, payload in journal(tmp_path)[0].resumed()[1]]

    assert resumed(2 * size - 1, 0) == [b"0", b"2", b"3", b"4"]
    assert f"{file}, byte {size}: its checksum does not hold" in caplog.text
    assert resumed(2 * size + 7, 255) == [b"0", b"1"]  # its length
    assert f"{file}: {3 * size} bytes from byte {2 * size} on cannot be read" in caplog.text


def test_a_folder_that_cannot_be_written_costs_the_journal_alone(tmp_path: Path) -> None:
    (tmp_path / "state").write_text("a file where the folder belongs")
    kept, _ = journal(tmp_path / "state")
    assert kept.resumed() == ([], [])
    kept.keep("t", b"1")


@pytest.mark.parametrize("n_lost", [1, 4])
def test_a_disk_that_takes_half_a_record_costs_no_other_message(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, n_lost: int
) -> None:
    kept, _ = journal(tmp_path)
    kept.resumed()
    write = os.write
    kept.keep("t", b"before")
    with monkeypatch.context() as full:
        full.setattr(os, "write", lambda file, data: write(file, data[: len(data) // 2]))
        for _ in range(n_lost):
            kept.keep("t", b"lost")
    kept.keep("t", b"behind")
    kept.close()
    _, messages = journal(tmp_path)[0].resumed()
    assert [payload for _, payload in messages] == [b"before", b"behind"]


def test_what_a_broker_sends_again_after_a_kill_is_known(tmp_path: Path) -> None:
    kept, _ = journal(tmp_path)
    kept.resumed()
    kept.keep("t", b"1")
    assert kept.has("t", b"1")
    again, _ = journal(tmp_path)
    again.resumed()
    assert again.has("t", b"1")
    assert not again.has("t", b"2")
    assert not again.has("u", b"1")


def test_a_kill_while_the_files_are_begun_brings_no_message_twice(tmp_path: Path) -> None:
    kept, _ = journal(tmp_path)
    kept.resumed()
    for number in range(3):
        kept.keep("t", b"%d" % number)
    left = (tmp_path / "feed.messages").read_bytes()
    journal(tmp_path)[0].resumed()
    (tmp_path / "feed.messages").write_bytes(left)  # the older file has them already

    _, messages = journal(tmp_path)[0].resumed()
    assert [payload for _, payload in messages] == [b"0", b"1", b"2"]


def test_what_two_kills_left_unpublished_is_all_there_after_a_third(tmp_path: Path) -> None:
    clock = Clock()
    kept, _ = journal(tmp_path, clock)
    kept.resumed()
    kept.keep("t", b"0")
    clock.now = 3.0
    kept.keep("t", b"1")  # a new file: the older one has the first
    for number in (2, 3):
        kept, _ = journal(tmp_path)
        kept.resumed()
        kept.keep("t", b"%d" % number)
    _, messages = journal(tmp_path)[0].resumed()
    assert [payload for _, payload in messages] == [b"0", b"1", b"2", b"3"]


@pytest.mark.parametrize(("published", "kept"), [(0.85, [0, 1, 2]), (0.9, [1, 2])])
def test_a_message_is_kept_until_its_last_sample_is_published(
    tmp_path: Path, published: float, kept: list[int]
) -> None:
    """Ten samples at 10 Hz: the last is .9 s behind the first. A new file begins after seconds."""
    clock = Clock()
    journalled, position = journal(tmp_path, clock)
    for number in range(3):
        clock.now = 3.0 * number
        if number == 2:
            position.published(100 * NANOSECONDS, round((100 + published) * NANOSECONDS), 1e8)
        journalled.keep("t", b"%d" % number)
        journalled.taken(piece(100 + number))
        journalled.taken(None)
    journalled.close()
    again, _ = journal(tmp_path)
    assert [int(payload) for _, payload in again.resumed()[1]] == kept
