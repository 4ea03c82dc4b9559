"""Nodes in processes of their own that are started again when they die.

    running ──ended by itself──► waiting (0.25 s, 0.5 s, 1 s, … 30 s) ──► running
       │                            │ eight times in a row, or by a person's mistake
       │ asked to stop              ▼
       └──► ended               NodeFailed

No process outlives the supervisor: each process holds the end of a pipe that closes when the
supervisor is gone, whatever killed it, and stops cleanly then (`stopped_with_parent`).
"""

import logging
import os
import signal
import subprocess
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.nodes.node import Node
from pipeline.runtime.errors import NodeFailed

logger = logging.getLogger(__name__)

MISTAKE = 2  # exit code where a person has to correct something; to try again would not help
STANDARD_INPUT = 0  # file descriptor
LEAST_STOP_TIMEOUT = 0.5  # for a node to end, however late it is [s]


@dataclass(frozen=True, slots=True)
class BackOff:
    """How long to wait before a node is started again."""

    first: float = 0.25
    """First pause [s]."""
    longest: float = 30.0
    """Longest pause [s]."""
    attempts: int = 8
    """In a row, then the session fails."""
    proven: float = 60.0
    """A node that ran so long counts from zero again [s]."""

    def delay(self, failures: int) -> float:
        """Return the wait before the start that follows so many failures in a row [s]."""
        return min(self.longest, self.first * 2.0 ** (failures - 1))


class SupervisedProcess:
    """A node in a process of its own, started with a command; SIGTERM ends it cleanly.

    Parameters
    ----------
    node : type of Node
        Whose name and inputs it has.
    command : sequence of str
        Starts the process; it should stop when its standard input ends.
    back_off : BackOff, optional
        How long to wait before starting it again.
    clock : callable, optional
        → [s], never set back.
    name : str, optional
        Of the node in this process; "" for its class's.
    inherited : sequence of int, optional
        File descriptors that the process keeps open.
    """

    def __init__(
        self,
        node: type[Node],
        command: Sequence[str],
        *,
        back_off: BackOff | None = None,
        clock: Callable[[], float] = time.monotonic,
        name: str = "",
        inherited: Sequence[int] = (),
    ) -> None:
        self.name: str = name or node.name  # type: ignore[assignment]  # the class's attribute
        self.inputs: tuple[type, ...] = node.inputs  # type: ignore[assignment]
        self.restarts = 0
        self._command = command
        self._inherited = tuple(inherited)
        self._back_off = back_off or BackOff()
        self._clock = clock
        self._process: subprocess.Popen[bytes] | None = None
        self._started = 0.0  # [s]
        self._failures = 0  # in a row
        self._due: float | None = None  # when to start again [s]
        self._exit_code: int | None = None  # of a process that was asked to stop

    @property
    def pid(self) -> int | None:
        """Id of the process that runs; None while there is none."""
        return None if self._process is None else self._process.pid

    def start(self) -> None:
        """Start the command."""
        self._started = self._clock()
        self._due = None
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            start_new_session=True,
            pass_fds=self._inherited,
        )

    def check(self) -> None:
        """Start a process again that has ended by itself, when its time has come.

        Raises NodeFailed where that would not help: a person's mistake (its line is on the error
        stream), too many failures in a row, or an error while it was asked to stop.
        """
        if self._exit_code not in (None, 0, -signal.SIGTERM):  # the last: it had not started yet
            raise NodeFailed(f"node {self.name} ended with exit code {self._exit_code}")
        if self._due is not None and self._clock() >= self._due:
            self.restarts += 1
            self.start()
        code = None if self._process is None else self._process.poll()
        if code is not None:
            self._note_end(code)

    def ask_to_stop(self) -> None:
        """Send SIGTERM; it is not started again."""
        self._due = None
        if self._process is not None:
            self._process.terminate()

    def has_ended(self, within: float) -> bool:
        """Wait until its files are closed, not for longer [s]; report whether it has ended."""
        if self._process is None:
            return True
        try:
            self._exit_code = self._process.wait(max(within, LEAST_STOP_TIMEOUT))
        except subprocess.TimeoutExpired:
            return False
        self._let_go()
        return True

    def abandon(self) -> None:
        """Kill a process that was asked to stop and has not ended."""
        if self._process is None:
            return
        logger.error(
            "node %s is busy and does not stop; what it has not answered is recorded", self.name
        )
        self._process.kill()
        self._process.wait()
        self._exit_code = 0
        self._let_go()

    def _note_end(self, code: int) -> None:
        self._let_go()
        ran = self._clock() - self._started
        self._failures = 1 if ran >= self._back_off.proven else self._failures + 1
        text = f"node {self.name} ended by itself with exit code {code}"
        if code == MISTAKE or self._failures > self._back_off.attempts:
            raise NodeFailed(text)
        delay = self._back_off.delay(self._failures)
        self._due = self._clock() + delay
        logger.warning("%s after %.1f s; it is started again in %g s", text, ran, delay)

    def _let_go(self) -> None:
        """Forget a process that has ended, and the pipe that it was tied by."""
        assert self._process is not None
        if self._process.stdin is not None:
            self._process.stdin.close()
        self._process = None


def stopped_with_parent(stopping: threading.Event, descriptor: int = STANDARD_INPUT) -> None:
    """Set `stopping` when the parent, which holds the other end of a pipe, is gone.

    Parameters
    ----------
    stopping : threading.Event
        That is set.
    descriptor : int, optional
        Of the reading end. It is read without Python's buffer, whose lock a thread that still waits
        would hold when the interpreter ends.
    """

    def watch() -> None:
        while os.read(descriptor, 1):
            pass
        stopping.set()

    threading.Thread(target=watch, name="parent", daemon=True).start()
