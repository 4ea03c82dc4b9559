"""A window's identification that costs too much is given up between two checkpoints.

    with working_within(limit):  ──►  identify … checkpoint … checkpoint ──► WorkLimitExceeded

The long loops call `checkpoint`. Without a limit around them it does nothing. The clock is given by
the caller who sets the limit; none is read here.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


class WorkLimitExceeded(Exception):  # noqa: N818  # the name states what happened
    """The work inside `working_within` has used up its time; caught where the limit is set."""


_over: ContextVar[Callable[[], bool] | None] = ContextVar("_over", default=None)


CpuClock = Callable[[], float]  # → CPU time of this thread [s]


@dataclass(frozen=True, slots=True)
class CpuLimit:
    """What a window's identification may cost."""

    seconds: float
    """CPU time [s]."""
    clock: CpuClock


@contextmanager
def working_within(limit: CpuLimit | None) -> Iterator[None]:
    """Give up what runs inside, at its next checkpoint, once it has cost more; None: it may.

    Raises
    ------
    WorkLimitExceeded
    """
    if limit is None:
        yield
        return
    end = limit.clock() + limit.seconds
    token = _over.set(lambda: limit.clock() > end)
    try:
        yield
    finally:
        _over.reset(token)


def checkpoint() -> None:
    """Mark a place where work may be given up.

    Raises
    ------
    WorkLimitExceeded
        If the limit around it is exceeded.
    """
    over = _over.get()
    if over is not None and over():
        raise WorkLimitExceeded
