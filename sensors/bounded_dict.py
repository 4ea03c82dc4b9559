"""A dictionary that does not grow, for names that are untrusted."""

from collections import OrderedDict
from typing import TypeVar

K = TypeVar("K")
V = TypeVar("V")

MOST_NAMES = 1000  # topics, senders, channels of one feed that are known at a time


class BoundedDict(OrderedDict[K, V]):
    """So many entries at most: of more the one that was entered or renewed longest ago goes.

    A sender that invents names makes the longest unused ones forgotten; memory does not grow, and
    a name that is in use stays known.

    Parameters
    ----------
    most : int or None, optional
        Entries that are kept; None: all.
    """

    def __init__(self, most: int | None = MOST_NAMES) -> None:
        super().__init__()
        self._most = most

    def __setitem__(self, key: K, value: V) -> None:
        super().__setitem__(key, value)
        if self._most is not None and len(self) > self._most:
            self.popitem(last=False)

    def renewed(self, key: K) -> V | None:
        """Return the value of a key, which is used by that; None where it is not known."""
        if key in self:
            self.move_to_end(key)
        return self.get(key)

    def put(self, key: K, value: V) -> V | None:
        """Enter a value as the latest; return the one that goes for it, or None."""
        self.pop(key, None)
        full = self._most is not None and len(self) >= self._most
        leaving = self.popitem(last=False)[1] if full else None
        self[key] = value
        return leaving
