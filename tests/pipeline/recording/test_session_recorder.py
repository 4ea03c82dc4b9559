"""A recording that may run for a year: parts, what is kept, what a full disk and a kill leave."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from io import BufferedWriter
from pathlib import Path

import pytest

from pipeline.messages import Message, RecordedUntil, StreamEnd, WindowRejected
from pipeline.offline.audit import recordings_of
from pipeline.recording.errors import RecordingError
from pipeline.recording.latest_messages import latest_payloads
from pipeline.recording.mcap_file import counted_in_summary
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.rotation import (
    close_leftovers,
    keep_results,
    next_part,
    parts_of,
    raw_files,
    results_of,
    session_in,
    thin,
)
from pipeline.recording.session_recorder import SYNCED_EVERY, SessionRecorder
from pipeline.recording.settings import RecordingSettings
from pipeline.recording.writer import whole_recording
from pipeline.runtime.lock_step import NodeAccount
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from tests.pipeline.example_messages import LAYOUT, START_NS, all_same, block, rejection
from tests.pipeline.power_cut import power_cut

SECOND = 10**9  # [ns]
METADATA = {"pilewatch": {"version": "0"}}


class Clock:
    """A second goes by with every reading that follows a message."""

    def __init__(self) -> None:
        self.now_ns = START_NS

    def __call__(self) -> int:
        return self.now_ns


def recorded(
    folder: Path, n_blocks: int, free: object = None, **settings: float
) -> SessionRecorder:
    """A session's recorder after a layout, a result and a block a second; closed."""
    clock = Clock()
    room = (lambda _: 10**12) if free is None else free
    recorder = SessionRecorder(
        folder / "session.mcap",
        metadata=METADATA,
        clock=clock,
        settings=RecordingSettings(**settings),
        free=room,
    )
    for message in (LAYOUT, rejection(0), *map(block, range(n_blocks))):
        recorder.handle(message)
        clock.now_ns += SECOND
    recorder.close()
    return recorder


def sequences(paths: list[Path]) -> list[int]:
    return [
        each.sequence
        for path in paths
        for each in read_messages(path, (AccelerationBlock,))
        if isinstance(each, AccelerationBlock)
    ]


def test_a_recording_goes_on_in_the_next_part_after_its_time(tmp_path):
    recorder = recorded(tmp_path, 60, rotate_after=20.0)
    parts = parts_of(tmp_path / "session.mcap")
    assert [part.name for part in parts] == [
        "session.mcap", "session.part2.mcap", "session.part3.mcap", "session.part4.mcap",
    ]  # fmt: skip
    assert sequences(parts) == list(range(60))
    assert recorder.recorded == 60
    for part in parts:
        assert read_metadata(part) == METADATA
        (layout,) = read_messages(part, (SensorLayout,))
        assert all_same([layout], [LAYOUT])


def test_a_recording_goes_on_in_the_next_part_after_its_size(tmp_path):
    recorded(tmp_path, 60, rotate_megabytes=0.02)
    parts = parts_of(tmp_path / "session.mcap")
    assert len(parts) > 3
    assert sequences(parts) == list(range(60))
    assert all(part.stat().st_size < 60_000 for part in parts)


def test_the_oldest_samples_go_first_and_results_stay(tmp_path):
    recorded(tmp_path, 60, rotate_after=10.0, keep_gigabytes=60_000e-9)
    raw = sorted(sequences([part]) for part in raw_files(tmp_path / "session.mcap"))
    kept = [sequence for part in raw for sequence in part]
    assert kept == list(range(kept[0], 60))
    assert kept[0] > 0
    first = tmp_path / "session.results.mcap"
    assert all_same(list(read_messages(first, (WindowRejected,))), [rejection(0)])
    assert sequences([first]) == []


def test_samples_go_after_as_many_days_as_they_are_kept(tmp_path):
    """Parts closed a day apart: of 30 days, those of 31.5 and 30.5 go, that of 29.5 stays."""
    recorded(tmp_path, 30, rotate_after=10.0)
    parts = parts_of(tmp_path / "session.mcap")
    for day, part in enumerate(parts):
        closed = START_NS + day * 86_400 * SECOND
        os.utime(part, ns=(closed, closed))
    now_ns = START_NS + round(31.5 * 86_400) * SECOND
    gone = thin(tmp_path / "session.mcap", RecordingSettings(keep_days=30.0), now_ns)
    assert len(parts) > 2
    assert gone == parts[:2]
    assert sorted(raw_files(tmp_path / "session.mcap")) == sorted(parts[2:])


KILLED_AT_RESULTS = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {root!r})
from pipeline.recording import rotation
kill = lambda *_, **__: os.kill(os.getpid(), signal.SIGKILL)
if {whole}:
    Path.unlink = lambda self, **_: str(self) == {part!r} and kill()  # once the results are whole
else:
    rotation.decoded = kill
rotation.keep_results(Path({part!r}))
"""


@pytest.mark.parametrize("is_whole", [True, False])
def test_a_kill_while_results_are_made_leaves_the_part_to_go_later(tmp_path, is_whole):
    path = tmp_path / "session.mcap"
    recorded(tmp_path, 30, rotate_after=10.0)
    parts = parts_of(path)
    script = KILLED_AT_RESULTS.format(
        root=str(Path(__file__).parents[3]), whole=is_whole, part=str(parts[0])
    )
    done = subprocess.run([sys.executable, "-c", script], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    left = results_of(parts[0])
    left = left if is_whole else left.with_name(f"{left.name}.active")
    assert left.exists()
    assert session_in(tmp_path)[0] == recordings_of(tmp_path) == parts

    assert list(close_leftovers(path)) == []
    assert not left.exists()
    assert thin(path, RecordingSettings(keep_gigabytes=1e-9), START_NS) == parts
    assert all_same(list(read_messages(results_of(parts[0]), (WindowRejected,))), [rejection(0)])
    assert session_in(tmp_path)[0] == [results_of(part) for part in parts]


def test_results_that_a_kill_left_are_replaced(tmp_path):
    """As they are in folders of versions that closed unfinished results as if they were whole."""
    path = tmp_path / "session.mcap"
    recorded(tmp_path, 30, rotate_after=10.0)
    first, *_ = parts = parts_of(path)
    for left in (results_of(first), results_of(first).with_name("session.results.mcap.active")):
        with whole_recording(tmp_path / "cut.mcap", metadata=METADATA):
            pass
        (tmp_path / "cut.mcap").rename(left)
    assert session_in(tmp_path)[0] == recordings_of(tmp_path) == parts
    assert thin(path, RecordingSettings(keep_gigabytes=1e-9), START_NS) == parts
    assert all_same(list(read_messages(results_of(first), (WindowRejected,))), [rejection(0)])


def test_results_that_stay_make_no_room(tmp_path):
    """Room for a part less half of its results is not there before a second part has gone."""
    path = tmp_path / "session.mcap"
    recorded(tmp_path, 60, rotate_after=10.0)
    first, second, *_ = parts_of(path)
    trial = tmp_path / "trial" / first.name
    trial.parent.mkdir()
    shutil.copy(first, trial)
    size = first.stat().st_size
    results = keep_results(trial)
    needed = size - results.stat().st_size // 2
    kept = RecordingSettings(keep_gigabytes=1.0)
    now_ns = max(part.stat().st_mtime_ns for part in parts_of(path))
    assert thin(path, kept, now_ns, needed=needed) == [first, second]


def test_a_part_that_cannot_go_counts_and_the_next_ones_go(tmp_path, caplog):
    path = tmp_path / "session.mcap"
    recorded(tmp_path, 60, rotate_after=10.0)
    first, *others = parts_of(path)
    content = bytearray(first.read_bytes())
    content[len(content) // 2] ^= 4
    oldest = first.stat().st_mtime_ns - 10 * SECOND
    first.write_bytes(content)
    os.utime(first, ns=(oldest, oldest))
    kept = RecordingSettings(keep_gigabytes=(first.stat().st_size + 10) * 1e-9)
    assert thin(path, kept, START_NS) == others
    assert raw_files(path) == [first]
    assert f"{first} is kept whole" in caplog.text


def test_without_a_word_about_keeping_nothing_is_deleted(tmp_path):
    recorder = recorded(tmp_path, 60, free=lambda _: 10**6, rotate_after=10.0)
    assert recorder.warnings[0].code == "recording-stopped"
    assert not list(tmp_path.glob("*.results.mcap"))


def test_a_disk_that_fills_up_ends_the_recording_and_not_the_session(tmp_path):
    room = iter([10**9] * 3 + [10**6] * 1000)
    recorder = recorded(tmp_path, 60, free=lambda _: next(room))
    (warning,) = recorder.warnings
    assert "1 MB are free and 100 MB are to stay so" in warning.text
    written = sequences(parts_of(tmp_path / "session.mcap"))
    assert written == list(range(len(written)))
    assert len(written) + recorder.lost == 60
    assert recorder.recorded == len(written)
    assert not list(tmp_path.glob("*.active"))


class Disk:
    """A disk with so much room, a recorder on it, and a second for each message."""

    def __init__(self, folder: Path, **settings: float) -> None:
        self.free = 10**12
        self.clock = Clock()
        self.path = folder / "session.mcap"
        self.recorder = SessionRecorder(
            self.path,
            metadata=METADATA,
            clock=self.clock,
            settings=RecordingSettings(**settings),
            free=lambda _: self.free,
        )
        self.acknowledged: set[int] = set()

    def send(self, *messages: Message) -> None:
        for message in messages:
            for said in self.recorder.handle(message):
                assert isinstance(said, RecordedUntil)
                self.acknowledged = {n for n in range(200) if said.has(n, block(n).start_ns)}
            self.clock.now_ns += SECOND

    def blocks(self, first: int, end: int) -> None:
        self.send(*map(block, range(first, end)))

    @property
    def codes(self) -> list[str]:
        return [each.code for each in self.recorder.statistics.warnings]


def test_a_recording_that_stopped_goes_on_once_there_is_room_again(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.send(LAYOUT)
    disk.blocks(0, 20)
    disk.free = 10**6
    disk.blocks(20, 40)
    assert disk.codes == ["recording-stopped"]
    disk.free = 110 * 10**6  # above what stays free, and not by enough to write for long
    disk.blocks(40, 60)
    assert disk.codes == ["recording-stopped"]
    assert "it goes on once 120 MB are free" in disk.recorder.warnings[0].text
    disk.free = 399 * 10**6
    disk.blocks(60, 100)
    assert disk.codes == ["recording-resumed"]
    disk.recorder.close()

    first, second = parts_of(disk.path)
    until, since = sequences([first]), sequences([second])
    assert until == list(range(len(until)))
    assert 20 <= len(until) <= 26
    assert since == list(range(since[0], 100))
    assert 60 <= since[0] <= 66
    assert disk.recorder.lost == since[0] - len(until)
    assert disk.recorder.recorded == len(until) + len(since)
    assert all_same(list(read_messages(second, (SensorLayout,))), [LAYOUT])
    assert disk.acknowledged <= {*until, *since}
    assert len(disk.acknowledged) > len(until) + len(since) - 15


def test_what_is_sent_again_after_a_full_disk_is_recorded_and_not_lost(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.blocks(0, 20)
    disk.free = 10**6
    disk.blocks(20, 40)
    disk.send(*map(block, range(30, 35)))  # the spool tries again, in vain
    there = disk.recorder.recorded
    assert disk.recorder.lost == 40 - there
    disk.free = 10**12
    disk.blocks(40, 50)
    disk.blocks(there, 50)  # what was not acknowledged
    disk.send(StreamEnd("t1", "tower", "session-1", START_NS + 50 * SECOND, 50))
    assert disk.recorder.lost == 0
    assert "no block is missing" in disk.recorder.warnings[0].text
    disk.recorder.close()
    assert sorted(sequences(parts_of(disk.path))) == list(range(50))
    assert disk.acknowledged == {*range(50)}


def test_results_of_the_time_in_which_recording_had_stopped_are_recorded(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.blocks(0, 10)
    disk.free = 10**6
    disk.blocks(10, 20)
    assert disk.codes == ["recording-stopped"]
    disk.send(rejection(0), rejection(1), rejection(1))
    disk.free = 10**12
    disk.blocks(20, 30)
    disk.send(rejection(1))
    disk.recorder.close()
    found = [m for part in parts_of(disk.path) for m in read_messages(part, (WindowRejected,))]
    assert all_same(found, [rejection(0), rejection(1)])


def test_a_disk_without_room_is_looked_at_every_few_seconds_and_leaves_no_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = Disk(tmp_path)
    disk.blocks(0, 10)
    disk.free = 10**6
    disk.blocks(10, 20)

    def refused(path: Path, active: Path) -> BufferedWriter:
        raise RecordingError(f"cannot record to {active}: Read-only file system")

    monkeypatch.setattr("pipeline.recording.writer._created", refused)
    disk.free = 10**12
    disk.blocks(20, 40)
    assert "does not go on: cannot record" in disk.recorder.warnings[0].text
    monkeypatch.undo()
    disk.blocks(40, 60)
    assert disk.codes == ["recording-resumed"]
    disk.recorder.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "session.mcap",
        "session.part2.mcap",
    ]


def removed(active: Path) -> None:
    active.unlink()


def moved(active: Path) -> None:
    active.rename(active.with_name("elsewhere.mcap"))


def replaced(active: Path) -> None:
    active.unlink()
    active.write_bytes(b"of another program")


@pytest.mark.parametrize("gone", [removed, moved, replaced])
def test_a_file_that_goes_under_its_recorder_is_noticed_and_its_blocks_not_acknowledged(
    tmp_path: Path, gone: Callable[[Path], None]
) -> None:
    disk = Disk(tmp_path)
    disk.send(LAYOUT)
    disk.blocks(0, 20)
    acknowledged = {*disk.acknowledged}
    gone(tmp_path / "session.mcap.active")
    disk.blocks(20, 30)
    first, *_ = disk.recorder.statistics.warnings
    assert first.code == "recording-stopped"  # which is an alarm
    assert "session.mcap has stopped: its file was removed or moved" in first.text
    disk.blocks(30, 60)
    disk.recorder.close()

    there = {n for path in tmp_path.glob("session*.mcap") for n in sequences([path])}
    assert {*range(22, 60)} <= there
    assert disk.acknowledged - acknowledged <= there
    assert disk.recorder.lost == 60 - len(there)
    assert disk.recorder.recorded == len(there)
    if gone is moved:
        left = sequences([tmp_path / "elsewhere.mcap"])
        assert left == list(range(len(left)))
        assert {*left} | there == {*range(60)}
    if gone is replaced:
        assert (tmp_path / "session.mcap.active").read_bytes() == b"of another program"


def test_what_is_sent_again_after_a_file_has_gone_is_recorded(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.blocks(0, 20)
    acknowledged = {*disk.acknowledged}
    (tmp_path / "session.mcap.active").unlink()
    disk.blocks(20, 30)
    disk.send(*(block(n) for n in range(30) if n not in acknowledged))
    disk.send(StreamEnd("t1", "tower", "session-1", START_NS + 30 * SECOND, 30))
    disk.recorder.close()
    assert {*sequences([disk.path])} == {*range(30)} - acknowledged
    assert disk.acknowledged == {*range(30)}
    assert disk.recorder.lost == len(acknowledged)


def test_the_alarm_of_a_file_that_went_ends_with_the_next_part(tmp_path: Path) -> None:
    disk = Disk(tmp_path, rotate_after=30.0)
    disk.blocks(0, 10)
    (tmp_path / "session.mcap.active").unlink()
    disk.blocks(10, 30)
    assert disk.codes == ["recording-stopped", "recording-resumed"]
    disk.blocks(30, 60)
    assert disk.codes == ["recording-resumed"]
    disk.recorder.close()


@pytest.mark.parametrize("rotates", [False, True])
def test_a_file_that_is_gone_when_it_is_finished_is_lost(tmp_path: Path, rotates: bool) -> None:
    disk = Disk(tmp_path)
    disk.blocks(0, 10)
    removed(tmp_path / "session.mcap.active")
    if rotates:
        disk.clock.now_ns += 3600 * SECOND
        disk.blocks(10, 11)
    disk.recorder.close()
    assert "its file was removed or moved" in disk.recorder.warnings[0].text
    assert disk.recorder.lost == 10 + rotates
    assert disk.recorder.recorded == 0


def test_retention_relieves_a_full_disk_where_it_may(tmp_path):
    def free(_: Path) -> int:
        used = sum(part.stat().st_size for part in raw_files(tmp_path / "session.mcap"))
        return 100_060_000 - used

    recorder = recorded(tmp_path, 120, free=free, rotate_after=10.0, keep_days=3650.0)
    assert recorder.warnings == ()
    assert recorder.lost == 0
    assert sequences([recorder.path])[-1] == 119


def pictures(folder: Path) -> list[str]:
    """Three days of pictures, the last one in writing; the names of those that are there."""
    for day in range(3):
        path = folder / f"session-2026-01-0{day + 1}.rrd"
        path.write_bytes(bytes(50_000))
        begun = START_NS + day * 86_400 * SECOND
        os.utime(path, ns=(begun, begun))
    return sorted(path.name for path in folder.glob("*.rrd"))


def test_pictures_of_past_days_go_before_any_sample(tmp_path):
    assert len(pictures(tmp_path)) == 3

    def free(_: Path) -> int:
        return 100_000_000 - 30_000 + 50_000 * (3 - len(list(tmp_path.glob("*.rrd"))))

    recorder = recorded(tmp_path, 60, free=free, rotate_after=10.0, keep_days=3650.0)
    assert sorted(path.name for path in tmp_path.glob("*.rrd")) == [
        "session-2026-01-02.rrd",
        "session-2026-01-03.rrd",
    ]
    assert sequences(parts_of(tmp_path / "session.mcap")) == list(range(60))
    assert recorder.warnings == ()


def test_pictures_of_past_days_go_by_age_but_never_those_in_writing(tmp_path):
    pictures(tmp_path)
    now_ns = START_NS + 100 * 86_400 * SECOND
    assert thin(tmp_path / "session.mcap", RecordingSettings(keep_days=30.0), now_ns) == []
    assert [path.name for path in tmp_path.glob("*.rrd")] == ["session-2026-01-03.rrd"]
    pictures(tmp_path)
    thin(tmp_path / "session.mcap", RecordingSettings(), now_ns, needed=10**9)
    assert len(list(tmp_path.glob("*.rrd"))) == 3  # nobody has said that anything may go


FILL = """
import resource, signal, sys
from pathlib import Path
sys.path.insert(0, {root!r})
from tests.pipeline.recording.test_session_recorder import recorded
sys.dont_write_bytecode = True  # a module cut at the limit would stay so
resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))
recorder = recorded(Path({folder!r}), 200)
print(recorder.lost)
"""


def test_a_file_that_the_system_lets_grow_no_further_is_still_whole(tmp_path):
    root = str(Path(__file__).parents[3])
    done = subprocess.run(
        [sys.executable, "-c", FILL.format(root=root, folder=str(tmp_path))],
        capture_output=True, text=True, timeout=60, check=True,
    )  # fmt: skip
    assert "has stopped: File too large" in done.stderr
    first = sequences([tmp_path / "session.mcap"])
    assert first == list(range(len(first)))
    assert len(first) > 10
    written = sequences(parts_of(tmp_path / "session.mcap"))  # each file may grow as far
    assert written == sorted({*written})
    assert len(written) + int(done.stdout) == 200
    assert not list(tmp_path.glob("*.active"))


KILLED = """
import os, signal, sys
from pathlib import Path
sys.path.insert(0, {root!r})
from tests.pipeline.recording import test_session_recorder as session
session.SessionRecorder.close = lambda self: os.kill(os.getpid(), signal.SIGKILL)
session.recorded(Path({folder!r}), 30)
"""


def test_a_killed_recorder_is_followed_by_one_that_goes_on(tmp_path):
    root = str(Path(__file__).parents[3])
    script = KILLED.format(root=root, folder=str(tmp_path))
    done = subprocess.run([sys.executable, "-c", script], timeout=60, check=False)
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "session.mcap.active").exists()
    recorder = recorded(tmp_path, 30)
    assert recorder.path.name == "session.part2.mcap"
    assert recorder.recorded == len(sequences(parts_of(tmp_path / "session.mcap")))
    left = sequences([tmp_path / "session.mcap"])
    assert left == list(range(len(left)))
    assert len(left) >= 28  # two seconds of samples at most are gone
    assert not list(tmp_path.glob("*.active"))


def test_what_is_no_recording_is_left_alone(tmp_path):
    (tmp_path / "session.mcap.active").write_bytes(b"cut")
    recorder = recorded(tmp_path, 3)
    assert recorder.path.name == "session.part2.mcap"
    assert (tmp_path / "session.mcap.active").read_bytes() == b"cut"
    assert next_part(tmp_path / "session.mcap") == 3


def test_settings_that_make_no_sense_are_named():
    with pytest.raises(RecordingError, match=r"\[recording\] rotate_after is -1"):
        RecordingSettings(rotate_after=-1.0)


def test_a_recorder_that_is_started_again_records_nothing_twice(tmp_path):
    """Killed after 60 s, it gets what the publishers still have, what it had lost among it."""
    path = tmp_path / "session.mcap"
    first = SessionRecorder(path, metadata=METADATA, clock=Clock())
    for message in (LAYOUT, rejection(0), *map(block, range(60))):
        first.handle(message)
    first._recorder._writer.flush()
    for message in map(block, range(60, 63)):  # in the chunk that the kill takes
        first.handle(message)
    first._recorder._file.flush()
    second = SessionRecorder(path, metadata=METADATA, clock=Clock())
    for message in (LAYOUT, rejection(0), rejection(1), *map(block, range(30, 70))):
        second.handle(message)
    second.close()
    parts = parts_of(path)
    assert len(parts) == 2
    assert second.recorded == len(sequences(parts)) == 70
    assert sequences(parts) == list(range(70))
    assert second.duplicate == 30
    for part, expected in zip(parts, ([rejection(0)], [rejection(1)]), strict=True):
        assert all_same(list(read_messages(part, (WindowRejected,))), expected)
        assert all_same(list(read_messages(part, (SensorLayout,))), [LAYOUT])


def test_what_finished_parts_say_they_hold_is_what_can_be_read(tmp_path):
    recorded(tmp_path, 60, rotate_after=20.0)
    path = tmp_path / "session.mcap"
    for part in parts_of(path):
        assert counted_in_summary(part, AccelerationBlock) == len(sequences([part])) > 0
    again = SessionRecorder(path, metadata=METADATA, clock=Clock())
    again.handle(block(60))
    assert again.recorded == 61
    again.close()
    assert again.recorded == 61


def test_a_block_that_a_stranger_replays_is_counted_and_not_recorded(tmp_path):
    recorder = SessionRecorder(tmp_path / "session.mcap", metadata=METADATA, clock=Clock())
    for sequence in (*range(20), *range(5, 15), 20):
        recorder.handle(block(sequence))
    recorder.close()
    assert sequences([recorder.path]) == list(range(21))
    assert recorder.duplicate == 10


def test_a_next_part_that_cannot_be_begun_ends_the_recording_and_not_the_session(
    tmp_path, monkeypatch
):
    def refused(path: Path, active: Path) -> BufferedWriter:
        if "part2" in path.name:
            raise RecordingError(f"cannot record to {active}: No space left on device")
        return active.open("xb")

    monkeypatch.setattr("pipeline.recording.writer._created", refused)
    recorder = recorded(tmp_path, 60, rotate_after=30.0)
    (warning,) = recorder.warnings
    assert warning.text.endswith("No space left on device")
    written = sequences([tmp_path / "session.mcap"])
    assert written == list(range(len(written)))
    assert 20 < len(written) == recorder.recorded == 60 - recorder.lost


def test_the_scenario_says_how_much_of_the_disk_stays_free(tmp_path: Path) -> None:
    for name, free_megabytes in (("kept", 2.0), ("used", 0.5)):
        (tmp_path / name).mkdir()
        recorder = recorded(
            tmp_path / name, 60, free=lambda _: 10**6, free_megabytes=free_megabytes
        )
        stopped = "recording-stopped" in [warning.code for warning in recorder.warnings]
        assert stopped == (name == "kept")


def test_what_is_recorded_is_what_arrived_byte_by_byte(tmp_path: Path) -> None:
    recorder = SessionRecorder(tmp_path / "session.mcap", metadata=METADATA, clock=Clock())
    of_a_later_version = encode(block(0)) + b"\xfa\x7f\x03new"  # field 2047, unknown today
    account = NodeAccount(recorder, "t1", Clock())
    list(account.handle(block(0), of_a_later_version))
    list(account.handle(block(0), of_a_later_version))
    recorder.close()
    (payload,) = latest_payloads([tmp_path / "session.mcap"])
    assert payload == of_a_later_version
    assert recorder.duplicate == 1


# ---- what a power cut costs --------------------------------------------------------------------


def running(folder: Path, clock: Clock) -> SessionRecorder:
    return SessionRecorder(
        folder / "session.mcap", metadata=METADATA, clock=clock, free=lambda _: 10**12
    )


@pytest.mark.parametrize("rotate_after", [3600.0, 7.0])
def test_a_power_cut_costs_nothing_that_was_acknowledged_and_a_second_of_the_rest(
    tmp_path: Path, rotate_after: float
) -> None:
    clock, acknowledged = Clock(), set()
    with power_cut(tmp_path):
        recorder = SessionRecorder(
            tmp_path / "session.mcap",
            metadata=METADATA,
            clock=clock,
            settings=RecordingSettings(rotate_after=rotate_after),
            free=lambda _: 10**12,
        )
        for number in range(40):
            for said in recorder.handle(block(number)):
                assert isinstance(said, RecordedUntil)
                acknowledged = {n for n in range(40) if said.has(n, block(n).start_ns)}
            clock.now_ns += SECOND // 2
    after = running(tmp_path, clock)
    on_disk = {*sequences(parts_of(after._path))}
    assert acknowledged <= on_disk
    assert len(acknowledged) >= 40 - 12  # two a second, acknowledged every five seconds


def test_a_recorder_that_begins_again_acknowledges_what_it_has_already(tmp_path: Path) -> None:
    clock = Clock()
    running(tmp_path, clock).close()
    first = running(tmp_path, clock)
    first.handle(block(0))
    first.close()
    again = running(tmp_path, clock)
    clock.now_ns += 6 * SECOND
    (said,) = again.handle(block(0))
    assert isinstance(said, RecordedUntil)
    assert said.ranges[-1].end == 1
    assert again.duplicate == 1


def test_the_end_of_a_stream_is_acknowledged_at_once(tmp_path: Path) -> None:
    recorder = running(tmp_path, Clock())
    assert recorder.handle(block(0)) == ()
    end = StreamEnd("t1", "tower", "session-1", START_NS + SECOND, 1)
    (said,) = recorder.handle(end)
    assert isinstance(said, RecordedUntil)


def test_a_disk_that_refuses_to_sync_acknowledges_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    recorder = running(tmp_path, clock)
    clock.now_ns += 2 * SECOND

    def refused(_: int) -> None:
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", refused)
    assert recorder.handle(block(0)) == ()
    assert recorder.warnings[0].code == "recording-stopped"
    assert recorder.handle(block(1)) == ()


@pytest.mark.parametrize("live", [True, False])
def test_a_live_units_clock_is_checked_on_arrival_and_a_replayed_ones_is_not(
    tmp_path: Path, live: bool
) -> None:
    clock = Clock()
    recorder = SessionRecorder(tmp_path / "a.mcap", metadata=METADATA, clock=clock, live=live)
    clock.now_ns -= 7200 * SECOND  # the blocks are stamped two hours later
    for number in range(10):
        recorder.handle(block(number))
        clock.now_ns += SECOND
    recorder.close()
    codes = [each.code for each in recorder.statistics.warnings]
    assert codes == (["clock-off"] if live else [])


def test_a_power_cut_costs_a_second_at_most() -> None:
    assert SYNCED_EVERY <= 1.0  # as docs/pages/operating.md and the acknowledgements have it
