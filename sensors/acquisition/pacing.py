"""How fast recorded or simulated time goes by: real time, n times faster, or at once.

The schedule is absolute: what is late is followed by what is due, so delays do not add up. The
clock is an argument; nothing here reads one by itself.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Protocol, TypeVar

from sensors.acquisition.blocks import NANOSECONDS
from sensors.errors import InputError

LONGEST_PAUSE = 3600.0  # of sensor time that is waited for; more is a clock that was set [s]

_T = TypeVar("_T")


class Clock(Protocol):
    """What pacing needs of a clock."""

    def now(self) -> float:
        """Time since any fixed moment [s]; never set back."""
        ...

    def wait(self, seconds: float) -> None:
        """Return after that time, or earlier when an end is requested."""
        ...


class Pace:
    """Lets sensor time go by `speed` times as fast as the clock, from the first time given.

    Parameters
    ----------
    speed : float
        1: real time; n: n times faster; infinity: no waiting [-].
    clock : Clock
        That waits.

    Raises
    ------
    InputError
        For a speed that is not positive.
    """

    def __init__(self, speed: float, clock: Clock) -> None:
        if not speed > 0:
            raise InputError(
                f"speed is {speed:g}; 1 is real time, 10 ten times faster, inf as fast as possible"
            )
        self._speed = speed
        self._clock = clock
        self._origin: tuple[int, float] | None = None  # sensor time [ns], clock [s]
        self._last_ns: int | None = None  # sensor time waited for last

    def wait_until(self, time_ns: int) -> None:
        """Return when this sensor time has come; at once where it has passed already, or lies more
        than LONGEST_PAUSE from the one before: a new schedule begins there."""
        if math.isinf(self._speed):
            return
        last_ns, self._last_ns = self._last_ns, time_ns
        leap = last_ns is not None and abs(time_ns - last_ns) > LONGEST_PAUSE * NANOSECONDS
        if self._origin is None or leap:
            self._origin = (time_ns, self._clock.now())
        first_ns, started = self._origin
        due = started + (time_ns - first_ns) / NANOSECONDS / self._speed
        remaining = due - self._clock.now()
        if remaining > 0:
            self._clock.wait(remaining)


def paced(
    messages: Iterable[_T], *, pace: Pace, time_of: Callable[[_T], int | None]
) -> Iterator[_T]:
    """Yield the messages in their order, each when its sensor time has come.

    Parameters
    ----------
    messages : iterable
        Of any type.
    pace : Pace
        Waits until a sensor time.
    time_of : callable
        Message → sensor time at which it is due [ns], e.g. the end of a block; None: at once.
    """
    for message in messages:
        time_ns = time_of(message)
        if time_ns is not None:
            pace.wait_until(time_ns)
        yield message
