"""The spool of a unit: kept until acknowledged, whole after a power cut, never too large."""

import errno
import os
from io import FileIO
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import BlockRange, RecordedUntil
from pipeline.sources import spool as module
from pipeline.sources.spool import Spool, SpoolError, default_folder
from pipeline.transport.codec import encode
from tests.pipeline.example_messages import START_NS, block
from tests.pipeline.power_cut import power_cut


def filled(folder: Path, n_blocks: int, **limits: float) -> Spool:
    spool = Spool(folder, **limits)
    for number in range(n_blocks):
        spool.append(block(number), encode(block(number)), 0.0)
    return spool


def waiting(spool: Spool) -> list[int]:
    return [each.sequence for each in spool.waiting()]


def recorded(*ranges: tuple[int, int]) -> RecordedUntil:
    spans = tuple(BlockRange(a, b, START_NS, START_NS + 10**15) for a, b in ranges)
    return RecordedUntil("t1", "tower", "session-1", START_NS, spans)


def test_what_is_acknowledged_goes_and_the_rest_is_there_after_a_restart(tmp_path: Path) -> None:
    spool = filled(tmp_path, 10)
    assert spool.acknowledge(recorded((0, 4), (6, 7))) == 5
    assert waiting(spool) == [4, 5, 7, 8, 9]
    spool.close()
    again = Spool(tmp_path)
    (last,) = [each for each in again.waiting() if each.sequence == 9]
    read = again.read(last)
    assert read is not None
    assert encode(read) == encode(block(9))
    again.acknowledge(recorded((0, 10)))
    assert len(again) == 0
    again.close()
    assert not list(tmp_path.glob("*.blocks"))


def test_a_killed_process_leaves_every_block_that_it_kept(tmp_path: Path) -> None:
    spool = filled(tmp_path / "spool", 3)  # neither synced nor closed
    copy = tmp_path / "copy"
    copy.mkdir()
    (file,) = (tmp_path / "spool").glob("*.blocks")
    (copy / file.name).write_bytes(file.read_bytes())
    again = Spool(copy)
    assert waiting(again) == [0, 1, 2]
    last = again.last_of("t1", "tower")
    assert last is not None
    assert last.sequence == 2
    assert again.last_of("t1", "other") is None
    again.close()
    spool.close()


def test_an_acknowledgement_that_grows_frees_what_is_new_in_it(tmp_path: Path) -> None:
    spool = filled(tmp_path, 10)
    freed = [spool.acknowledge(recorded((0, end))) for end in (3, 3, 10)]
    assert freed == [3, 0, 7]
    spool.append(block(5), encode(block(5)), 0.0)  # which the shore has
    assert len(spool) == 0


def test_a_block_of_another_start_is_not_acknowledged_by_its_number(tmp_path: Path) -> None:
    spool = filled(tmp_path, 2)
    span = BlockRange(0, 2, START_NS + 10**15, START_NS + 10**16)
    later = RecordedUntil("t1", "tower", "session-1", START_NS, (span,))
    assert spool.acknowledge(later) == 0


def test_a_power_cut_costs_what_was_not_synced_and_nothing_else(tmp_path: Path) -> None:
    with power_cut(tmp_path):
        spool = filled(tmp_path / "spool", 30)
        spool.sync()
        for number in range(30, 33):
            spool.append(block(number), encode(block(number)), 0.0)
    after = Spool(tmp_path / "spool")
    assert waiting(after) == list(range(30))


def test_a_file_that_was_cut_off_gives_its_whole_records(tmp_path: Path) -> None:
    filled(tmp_path, 5).close()
    (file,) = tmp_path.glob("*.blocks")
    file.write_bytes(file.read_bytes()[:-7])
    after = Spool(tmp_path)
    assert waiting(after) == [0, 1, 2, 3]
    assert after.damaged == 1


def test_a_flipped_bit_costs_one_block_and_is_counted(tmp_path: Path) -> None:
    filled(tmp_path, 5).close()
    (file,) = tmp_path.glob("*.blocks")
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 4
    file.write_bytes(content)
    after = Spool(tmp_path)
    assert waiting(after) == [0, 1, 3, 4]
    assert after.damaged == 1


def ends_of_records(file: Path) -> list[int]:
    """Where the head of a spool's file ends, and each of its records."""
    content, ends = file.read_bytes(), [len(module.FILE_HEAD)]
    while ends[-1] < len(content):
        ends.append(ends[-1] + 8 + int.from_bytes(content[ends[-1] :][:4], "little"))
    return ends


@pytest.mark.parametrize("which", range(5))
@pytest.mark.parametrize("length", [0, 1, 1000, 2**31])
def test_behind_a_damaged_length_the_other_blocks_are_found(
    which: int, length: int, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    filled(tmp_path, 5).close()
    (file,) = tmp_path.glob("*.blocks")
    begin, end = ends_of_records(file)[which : which + 2]
    with file.open("r+b") as opened:
        opened.seek(begin)
        opened.write(length.to_bytes(4, "little"))
    after = Spool(tmp_path)
    assert waiting(after) == [each for each in range(5) if each != which]
    assert after.damaged == 1
    assert f"bytes {begin} to {end} " in caplog.text


@pytest.mark.parametrize("seed", range(30))
def test_damage_anywhere_costs_the_blocks_that_it_hit_and_these_are_counted(
    seed: int, tmp_path: Path
) -> None:
    filled(tmp_path, 12).close()
    (file,) = tmp_path.glob("*.blocks")
    draw = np.random.default_rng(seed)
    content, ends = bytearray(file.read_bytes()), ends_of_records(file)
    begin, many = int(draw.integers(len(content))), int(draw.integers(1, 3000))
    before = bytes(content)
    content[begin : begin + many] = draw.bytes(len(content[begin : begin + many]))
    file.write_bytes(content)
    spans = list(pairwise(ends))
    whole = [i for i, (a, b) in enumerate(spans) if content[a:b] == before[a:b]]
    after = Spool(tmp_path)
    assert waiting(after) == whole
    assert after.damaged == 12 - len(whole) or (not whole and after.damaged)
    after.acknowledge(recorded((0, 12)))
    assert len(after) == 0


@pytest.mark.parametrize("name", [b"pilewatch spool 2\n", bytes(18)])
def test_a_file_with_a_damaged_head_gives_its_blocks(name: bytes, tmp_path: Path) -> None:
    filled(tmp_path, 3).close()
    (file,) = tmp_path.glob("*.blocks")
    file.write_bytes(name + file.read_bytes()[len(name) :])
    assert waiting(Spool(tmp_path)) == [0, 1, 2]


def test_what_cannot_be_read_at_all_is_kept_aside_and_reported(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    filled(tmp_path, 3).close()
    (file,) = tmp_path.glob("*.blocks")
    begin = ends_of_records(file)[1]
    content = bytearray(file.read_bytes())
    for at in range(begin, len(content), 50):
        content[at] ^= 255
    file.write_bytes(content)
    spool = Spool(tmp_path)
    assert (waiting(spool), spool.damaged) == ([0], 2)
    spool.append(block(3), encode(block(3)), 0.0)
    spool.acknowledge(recorded((0, 4)))
    spool.close()
    (aside,) = tmp_path.glob("*.unreadable")
    assert aside.read_bytes() == content
    assert f"kept as {aside.name}" in caplog.text
    again = filled(tmp_path, 1)  # and its number is not used again
    assert [int(each.stem) for each in tmp_path.glob("*.blocks")] == [int(aside.stem) + 1]
    assert again.damaged == 0
    again.close()


def test_a_block_of_another_version_is_kept_aside(tmp_path: Path) -> None:
    spool = Spool(tmp_path)
    spool.append(block(0), b"\nwhat a later version writes", 0.0)
    spool.close()
    after = Spool(tmp_path)
    assert (len(after), after.damaged, len(list(tmp_path.glob("*.unreadable")))) == (0, 1, 1)


def test_files_that_are_kept_aside_have_a_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "FILE_BYTES", 1)
    spool = Spool(tmp_path)
    for number in range(module.MOST_ASIDE + 5):
        spool.append(block(number), b"\nwhat a later version writes", 0.0)
    spool.close()
    Spool(tmp_path).close()
    numbers = sorted(int(each.stem) for each in tmp_path.glob("*.unreadable"))
    assert numbers == list(range(6, module.MOST_ASIDE + 6))


def test_a_record_that_is_damaged_later_is_let_go_of(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    spool = filled(tmp_path, 3)
    spool.sync()
    (file,) = tmp_path.glob("*.blocks")
    content = bytearray(file.read_bytes())
    content[-1] ^= 1
    with file.open("r+b") as opened:
        opened.write(content)
    *_, last = spool.waiting()
    assert spool.read(last) is None
    assert (spool.damaged, waiting(spool)) == (1, [0, 1])
    assert "its checksum does not hold" in caplog.text


def test_the_oldest_go_where_the_spool_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "FILE_BYTES", 10_000)
    spool = filled(tmp_path, 200, most_megabytes=0.05)
    assert sum(path.stat().st_size for path in tmp_path.glob("*.blocks")) <= 60_000
    assert spool.dropped == 200 - len(spool) > 0
    assert waiting(spool) == list(range(spool.dropped, 200))


def test_one_process_has_a_spool(tmp_path: Path) -> None:
    first = Spool(tmp_path)
    with pytest.raises(SpoolError, match="another process sends from there"):
        Spool(tmp_path)
    first.close()
    Spool(tmp_path).close()


def test_a_spool_that_cannot_be_made_is_one_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(SpoolError, match="a folder is needed"):
        Spool(tmp_path / "file")
    with pytest.raises(SpoolError, match="holds nothing"):
        Spool(tmp_path, most_megabytes=0.0)


def test_a_source_has_a_folder_of_its_own_whose_name_has_no_secret() -> None:
    one = default_folder("mqtt://ann:secret@broker/x", {"STATE_DIRECTORY": "/var/lib/a:/b"})
    assert one.parent == Path("/var/lib/a/spool")
    assert "secret" not in str(one)
    assert one != default_folder("mqtt://broker/y", {"STATE_DIRECTORY": "/var/lib/a"})
    assert default_folder("udp://:1", {"XDG_STATE_HOME": "/s"}).parent == Path("/s/pilewatch/spool")


def test_a_block_is_read_back_before_anything_was_synced(tmp_path: Path) -> None:
    """What waits for the shore is sent from the file that is still being written."""
    spool = filled(tmp_path, 1)
    (kept,) = spool.waiting()
    read = spool.read(kept)
    assert read is not None
    assert encode(read) == encode(block(0))
    assert spool.damaged == 0


class FullDisk:
    """A file on a disk that takes so many more bytes, and perhaps no cutting off."""

    def __init__(self, file: FileIO, room: int, *, is_cut: bool = True) -> None:
        self.file, self.room, self.is_cut = file, room, is_cut

    def write(self, content: memoryview) -> int:
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        taken = self.file.write(content[: self.room])
        self.room -= taken
        return taken

    def truncate(self, size: int) -> int:
        if not self.is_cut:
            raise OSError(errno.EIO, os.strerror(errno.EIO))
        return self.file.truncate(size)

    def __getattr__(self, name: str) -> object:
        return getattr(self.file, name)


@pytest.mark.parametrize("is_cut", [True, False])
def test_a_disk_that_is_full_for_a_moment_costs_that_block_alone(
    tmp_path: Path, is_cut: bool
) -> None:
    spool = filled(tmp_path, 2)
    file = spool._file
    assert file is not None
    spool._file = FullDisk(file, 100, is_cut=is_cut)  # type: ignore[assignment]
    with pytest.raises(OSError, match="No space left"):
        spool.append(block(2), encode(block(2)), 0.0)
    if spool._file is not None:
        spool._file = file  # there is room again
    for number in (3, 4, 5):
        spool.append(block(number), encode(block(number)), 0.0)
    assert [kept and kept.sequence for kept in map(spool.read, spool.waiting())] == [0, 1, 3, 4, 5]
    spool.close()
    again = Spool(tmp_path)
    assert waiting(again) == [0, 1, 3, 4, 5]
    assert again.damaged == (not is_cut)  # half a record is seen once, and costs nothing else
    again.close()


def test_where_no_file_can_be_begun_the_next_try_begins_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "FILE_BYTES", 1)  # each block has its file
    spool = filled(tmp_path, 1)
    refusal = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def refuse(*_: object, **__: object) -> None:
        raise refusal

    for place, name in ((Path, "open"), (module, "sync_folder")):
        with monkeypatch.context() as full:
            full.setattr(place, name, refuse)
            with pytest.raises(OSError, match="No space left"):
                spool.append(block(1), encode(block(1)), 0.0)
    spool.append(block(2), encode(block(2)), 0.0)
    spool.close()
    again = Spool(tmp_path)
    assert (waiting(again), again.damaged) == ([0, 2], 0)
    again.close()
