"""A window's identification that costs too much is given up between two checkpoints.

    with working_for(left, clock):  ──►  identify … checkpoint … checkpoint ──► WorkLimitExceeded

The long loops call `checkpoint`. Without a limit around them it does nothing. The clock is given by
the caller who sets the limit; none is read here.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar


class WorkLimitExceeded(Exception):  # noqa: N818  # the name states what happened
    """The work inside `working_for` has used up its time; caught where the limit is set."""


_over: ContextVar[Callable[[], bool] | None] = ContextVar("_over", default=None)


@contextmanager
def working_for(seconds: float, clock: Callable[[], float]) -> Iterator[None]:
    """Give up what runs inside, at its next checkpoint, once it has taken longer.

    Parameters
    ----------
    seconds : float
        By that clock [s].
    clock : callable
        → CPU time of this thread [s].

    Raises
    ------
    WorkLimitExceeded
    """
    end = clock() + seconds
    token = _over.set(lambda: clock() > end)
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
