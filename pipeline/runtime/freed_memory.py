"""What a node has let go of, given back to the system.

A window of samples leaves as many short-lived arrays as long-lived results; glibc's allocator keeps
the holes between them for later, and a node that runs for months grows by them. Once a minute they
go back to the system: some milliseconds. Other C libraries give back by themselves.

Source: malloc_trim(3).
"""

import ctypes
import time
from collections.abc import Callable

TRIM_PERIOD = 60.0  # between two returns [s]


class FreedMemory:
    """Gives back what this process has freed, at most once in `TRIM_PERIOD`."""

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._next = clock() + TRIM_PERIOD
        self._trim = _allocator_trim()

    def give_back(self) -> bool:
        """Give it back if it is time to; return whether it was."""
        if self._clock() < self._next:
            return False
        self._trim(0)
        self._next = self._clock() + TRIM_PERIOD
        return True


def _allocator_trim() -> Callable[[int], object]:
    """Return the allocator's own function; one that does nothing where there is none."""
    try:
        trim: Callable[[int], object] = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):  # musl, macOS; Windows
        return lambda _: None
    return trim
