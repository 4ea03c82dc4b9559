"""How long spans of time are together, each moment counted once."""

from collections.abc import Iterable


def covered(spans: Iterable[tuple[int, int]]) -> int:
    """Return the time that lies in one of several spans or more [ns].

    Parameters
    ----------
    spans : iterable of (int, int)
        Begin and end of each [ns]; they may overlap and come in any order.
    """
    total, until = 0, None
    for begin, end in sorted(spans):
        first = begin if until is None else max(begin, until)
        total += max(0, end - first)
        until = max(first, end)
    return total
