"""Nodes that are killed are started again; nodes whose parent is killed do not stay."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.runtime.errors import NodeFailed
from pipeline.runtime.flow_control import Quiet
from pipeline.runtime.supervisor import BackOff, SupervisedProcess, stopped_with_parent
from tests.pipeline.example_messages import status
from tests.pipeline.runtime.test_runner import Listener

SLEEPS = [sys.executable, "-c", "import time; time.sleep(60)"]
PATIENCE = 30.0  # for what another process does [s]


def eventually(condition: Callable[[], bool]) -> bool:
    """Whether it becomes so."""
    deadline = time.monotonic() + PATIENCE
    while not (so := condition()) and time.monotonic() < deadline:
        time.sleep(0.01)
    return so


class Clock:
    now = 0.0  # [s]

    def __call__(self) -> float:
        return self.now


def has_ended(process: SupervisedProcess) -> Callable[[], bool]:
    def ended() -> bool:
        process.check()
        return process.pid is None

    return ended


def test_a_killed_node_is_started_again_after_its_back_off() -> None:
    clock = Clock()
    process = SupervisedProcess(Listener, SLEEPS, back_off=BackOff(first=0.5), clock=clock)
    process.start()
    for failures, delay in ((1, 0.5), (2, 1.0), (3, 2.0)):
        assert process.pid is not None
        os.kill(process.pid, signal.SIGKILL)
        assert eventually(has_ended(process))
        clock.now += delay - 0.01
        process.check()
        assert process.pid is None
        clock.now += 0.02
        process.check()
        assert process.pid is not None
        assert process.restarts == failures
    process.abandon()
    process.check()


def test_a_node_that_never_lives_long_fails_the_session() -> None:
    process = SupervisedProcess(
        Listener, [sys.executable, "-c", "raise SystemExit(3)"], back_off=BackOff(0.0, attempts=2)
    )
    process.start()
    with pytest.raises(NodeFailed, match="node listener ended by itself with exit code 3"):
        eventually(lambda: process.check() is not None)
    assert process.restarts == 2


def test_what_a_person_must_mend_is_not_tried_again() -> None:
    process = SupervisedProcess(Listener, [sys.executable, "-c", "raise SystemExit(2)"])
    process.start()
    with pytest.raises(NodeFailed, match="exit code 2"):
        eventually(lambda: process.check() is not None)
    assert process.restarts == 0


TOLD = """
import signal, threading
from pathlib import Path
from pipeline.runtime.supervisor import stopped_with_parent
stopping = threading.Event()
stopped_with_parent(stopping)
signal.signal(signal.SIGTERM, lambda *_: stopping.set())
(Path({up!r}) / "up").touch()
stopping.wait(60)
"""
PARENT = """
import sys, time
from pipeline.runtime.supervisor import SupervisedProcess
from tests.pipeline.runtime.test_runner import Listener
process = SupervisedProcess(Listener, [sys.executable, "-c", {child!r}])
process.start()
print(process.pid, flush=True)
time.sleep(60)
"""
CHILD = """
import threading
from pathlib import Path
from pipeline.runtime.supervisor import stopped_with_parent
stopping = threading.Event()
stopped_with_parent(stopping)
stopping.wait(60)
Path({told!r}).write_text("closed")
"""


def test_nodes_close_their_files_when_their_parent_is_killed(tmp_path: Path) -> None:
    told = tmp_path / "told"
    script = PARENT.format(child=CHILD.format(told=str(told)))
    parent = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    parent.kill()
    parent.wait()
    parent.stdout.close()
    assert eventually(lambda: told.exists() and told.read_text() == "closed")
    assert eventually(lambda: not Path(f"/proc/{child}").exists() or "Z" in _state(child))


def _state(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return "Z"


def test_a_pipe_that_closes_is_a_parent_that_has_gone() -> None:
    reading, writing = os.pipe()
    stopping = threading.Event()
    stopped_with_parent(stopping, reading)
    assert not stopping.is_set()
    os.close(writing)
    assert stopping.wait(PATIENCE)
    os.close(reading)


def test_a_child_that_is_told_to_stop_ends_without_an_error(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    process = SupervisedProcess(Listener, [sys.executable, "-c", TOLD.format(up=str(tmp_path))])
    process.start()
    assert eventually(lambda: (tmp_path / "up").exists())
    process.ask_to_stop()
    assert process.has_ended(PATIENCE)
    process.check()
    assert not caplog.records  # it did not have to be killed


def test_a_node_is_quiet_after_saying_the_same_for_seconds() -> None:
    quiet = Quiet()
    for others in range(Quiet.ENOUGH - 1):  # it goes on hearing how the other nodes are
        quiet.note(status("recorder", received={"AccelerationBlock": 2, "NodeStatus": others}))
    assert not quiet.of_all(["recorder"])
    quiet.note(status("recorder", received={"AccelerationBlock": 2}))
    assert quiet.of_all(["recorder"])
    assert not quiet.of_all(["recorder", "updating"])
    quiet.note(status("recorder", received={"AccelerationBlock": 3}))
    assert not quiet.of_all(["recorder"])


def test_the_pipe_to_a_node_that_has_ended_is_closed() -> None:
    """A session that starts nodes again and again would run out of file descriptors."""
    process = SupervisedProcess(Listener, SLEEPS, back_off=BackOff(first=0.0))
    process.start()
    killed = process._process
    assert killed is not None
    assert killed.stdin is not None
    killed.kill()
    assert eventually(has_ended(process))
    assert killed.stdin.closed
    process.abandon()
