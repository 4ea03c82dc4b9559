"""The same warning of many windows, listed once.

The text of a warning has its window's figures ("two modes near 2.376 Hz"), so that one cause would
make a line in every window.
"""

import re
from collections.abc import Iterable, Iterator

from pipeline.messages import QualityWarning
from sensors.bounded_dict import BoundedDict

_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")


class DistinctWarnings:
    """Warnings that differ in code, in words or in a figure's first two digits; of alike the first.

    Parameters
    ----------
    warnings : iterable of QualityWarning, optional
        In the order in which they are to be read.
    most : int or None, optional
        That are kept, the latest; None: all.
    """

    def __init__(self, warnings: Iterable[QualityWarning] = (), *, most: int | None = None) -> None:
        self._first: BoundedDict[tuple[str, str], QualityWarning] = BoundedDict(most)
        self.add(warnings)

    def add(self, warnings: Iterable[QualityWarning]) -> None:
        """Enter warnings in the order in which they are to be read."""
        for warning in warnings:
            self._first.setdefault((warning.code, _NUMBER.sub(_rounded, warning.text)), warning)

    def __iter__(self) -> Iterator[QualityWarning]:
        return iter(self._first.values())


def _rounded(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2g}"
