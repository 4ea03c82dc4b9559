"""Ctrl-C ends a study and all its processes at once, in one line or none."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

COMMAND = [sys.executable, "-m", "pipeline", "reproduce", "--seeds", "2"]
PATIENCE = 60.0  # [s]


def children_of(pid: int) -> list[int]:
    """Processes that a process has started and that run."""
    listed = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(each) for each in listed.split()]


def runs(pid: int) -> bool:
    """Whether a process is there and has not ended."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except (FileNotFoundError, ProcessLookupError):
        return False


@pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="asks /proc for the children")
@pytest.mark.parametrize("whole_group", [True, False], ids=["terminal", "kill"])
def test_an_interrupted_study_ends_without_a_traceback(tmp_path: Path, whole_group: bool) -> None:
    study = subprocess.Popen(
        [*COMMAND, "--out", str(tmp_path / "report")],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
        # a shell's background job, as this suite may be, ignores Ctrl-C, and so do its children
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        end = time.monotonic() + PATIENCE
        while len(children_of(study.pid)) < 4 and time.monotonic() < end:  # workers, two of theirs
            time.sleep(0.05)
        started = children_of(study.pid)
        (os.killpg if whole_group else os.kill)(study.pid, signal.SIGINT)
        said, _ = study.communicate(timeout=PATIENCE)
    finally:
        if study.poll() is None:
            os.killpg(study.pid, signal.SIGKILL)
            study.communicate()
    assert len(started) >= 4
    assert study.returncode == 130
    assert "Traceback" not in said
    end = time.monotonic() + PATIENCE
    while any(map(runs, started)) and time.monotonic() < end:  # one that keeps accounts ends last
        time.sleep(0.05)
    assert not [pid for pid in started if runs(pid)]
