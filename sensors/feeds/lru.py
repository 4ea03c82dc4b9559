"""What is known by name, where the names are untrusted."""

from collections.abc import Iterable
from typing import Generic, TypeVar

V = TypeVar("V")

MOST_NAMES = 1000  # topics, senders, channels of one feed that are known at a time


class LruCache(Generic[V]):
    """Values by name, of the names used last.

    A sender that invents names makes the longest unused ones forgotten; memory does not grow, and
    a name that is in use stays known.
    """

    def __init__(self, most: int = MOST_NAMES) -> None:
        self._values: dict[str, V] = {}  # the one used last stands last
        self._most = most

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def get(self, name: str) -> V | None:
        """Return the value of a name, which is used by that; None where it is not known."""
        if name not in self._values:
            return None
        value = self._values[name] = self._values.pop(name)
        return value

    def put(self, name: str, value: V) -> V | None:
        """Know a name by this value; what is forgotten for it, if anything."""
        self._values.pop(name, None)
        self._values[name] = value
        if len(self._values) <= self._most:
            return None
        return self._values.pop(next(iter(self._values)))

    def values(self) -> Iterable[V]:
        """Values of all names that are known."""
        return self._values.values()
