"""The same warning of many windows, said once.

The text of a warning has its window's figures ("two modes near 2.376 Hz"), so that one cause would
make a line in every window.
"""

import re
from collections.abc import Iterable

from pipeline.messages import QualityWarning

_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")
SAME_WITHIN = 0.02  # of figures in two texts that mean the same, relative [-]


def without_repeats(warnings: Iterable[QualityWarning]) -> list[QualityWarning]:
    """Warnings that differ in code, in words or by more than 2 % in a figure; each as first said.

    Parameters
    ----------
    warnings : iterable of QualityWarning
        In the order in which they are to be read.
    """
    kept: list[QualityWarning] = []
    figures: dict[tuple[str, str], list[list[float]]] = {}
    for warning in dict.fromkeys(warnings):
        said = figures.setdefault((warning.code, _NUMBER.sub("#", warning.text)), [])
        numbers = [float(each) for each in _NUMBER.findall(warning.text)]
        if not any(_alike(numbers, others) for others in said):
            said.append(numbers)
            kept.append(warning)
    return kept


def _alike(numbers: list[float], others: list[float]) -> bool:
    pairs = zip(numbers, others, strict=True)
    return all(abs(a - b) <= SAME_WITHIN * max(abs(a), abs(b)) for a, b in pairs)
