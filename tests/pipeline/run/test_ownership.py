"""Two runs never write into one folder; one that was killed is followed."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest

from pipeline.run.options import SessionOptions
from pipeline.run.ownership import LOCK, epoch_of, is_fresh, owned
from pipeline.run.run import run_session
from pipeline.sources.sources import replayed
from sensors.errors import InputError

HOLD = """
import sys, time, subprocess
from pathlib import Path
from pipeline.run.ownership import owned
with owned(Path(sys.argv[1])) as held:
    if len(sys.argv) > 2:
        subprocess.Popen([sys.executable, "-c", f"import time; time.sleep({sys.argv[2]})"],
                         pass_fds=(held.descriptor,))
    print(held.epoch, flush=True)
    time.sleep(60)
"""


def holder(out: Path, *arguments: str) -> "subprocess.Popen[str]":
    """Another process that owns the folder by now."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, str(out), *arguments], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline().strip()
    return process


def test_a_second_run_is_refused_in_one_line_that_names_the_first(tmp_path: Path) -> None:
    first = holder(tmp_path)
    (tmp_path / "session.mcap.active").write_bytes(b"what the first one is writing")
    options = SessionOptions(tmp_path, way="lock-step", rrd=False)
    with pytest.raises(InputError, match=rf"`pilewatch run`, process {first.pid} on ") as refused:
        run_session(replayed(Path("recordings/parked.mcap")), options)
    assert "\n" not in str(refused.value)
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == [LOCK, "session.mcap.active"]
    first.kill()
    first.wait()


def test_the_lock_of_a_run_that_was_killed_is_taken_over(tmp_path: Path) -> None:
    first = holder(tmp_path)
    first.send_signal(signal.SIGKILL)
    first.wait()
    with owned(tmp_path) as ownership:
        assert ownership.epoch == epoch_of(tmp_path) == 2
        assert json.loads((tmp_path / LOCK).read_text())["process"] == os.getpid()
    with owned(tmp_path) as ownership:
        assert ownership.epoch == 3


def test_node_processes_learn_from_the_lock_that_a_run_began_with_nothing(tmp_path: Path) -> None:
    assert not is_fresh(tmp_path)
    with owned(tmp_path, fresh=True):
        assert is_fresh(tmp_path)
    with owned(tmp_path):
        assert not is_fresh(tmp_path)
    (tmp_path / LOCK).write_text("[]")
    assert not is_fresh(tmp_path)


NO_PROCESS = 2**30  # more than any system numbers


@pytest.mark.parametrize(
    ("owner", "n_pauses"),
    [
        ({"process": NO_PROCESS, "host": socket.gethostname()}, 1),
        ({"process": NO_PROCESS, "host": "another"}, 0),
        ({"process": "?", "host": socket.gethostname()}, 0),
        ({"process": os.getpid(), "host": socket.gethostname()}, 0),
    ],
)
def test_the_lock_of_a_process_that_may_run_is_not_waited_for(
    owner: dict[str, object], n_pauses: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of another machine's process it is not known whether it runs."""
    pauses: list[float] = []
    with owned(tmp_path) as held:
        os.ftruncate(held.descriptor, 0)
        os.pwrite(held.descriptor, json.dumps(owner).encode(), 0)
        with monkeypatch.context() as patched:
            patched.setattr(time, "sleep", pauses.append)
            patched.setattr(time, "monotonic", lambda: float(len(pauses)))
            with pytest.raises(InputError, match="belongs to"), owned(tmp_path, patience=0.5):
                pass
    assert len(pauses) == n_pauses


def test_processes_of_a_killed_run_are_waited_for(tmp_path: Path) -> None:
    first = holder(tmp_path, "2")
    first.kill()
    first.wait()
    started = time.monotonic()
    with pytest.raises(InputError, match="belongs to"), owned(tmp_path, patience=0.2):
        pass
    with owned(tmp_path, patience=20.0):
        assert time.monotonic() - started < 10.0


def test_of_many_that_start_at_once_one_owns_the_folder(tmp_path: Path) -> None:
    started = [
        subprocess.Popen(
            [sys.executable, "-c", HOLD, str(tmp_path)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        for _ in range(6)
    ]
    deadline = time.monotonic() + 30.0
    while sum(each.poll() is None for each in started) > 1 and time.monotonic() < deadline:
        time.sleep(0.1)
    alive = [each for each in started if each.poll() is None]
    assert len(alive) == 1
    assert json.loads((tmp_path / LOCK).read_text())["process"] == alive[0].pid
    alive[0].kill()
    alive[0].wait()


def test_a_damaged_lock_is_no_obstacle(tmp_path: Path) -> None:
    (tmp_path / LOCK).write_bytes(b"\xff\x00 nonsense")
    with owned(tmp_path) as ownership:
        assert ownership.epoch == 1
