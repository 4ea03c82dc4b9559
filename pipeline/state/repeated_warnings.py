"""The same warning of many windows, said once.

The text of a warning has its window's figures ("two modes near 2.376 Hz"), so that one cause would
make a line in every window.
"""

import re
from collections.abc import Iterable

from pipeline.messages import QualityWarning

_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(?:\.\d+)?(?:[eE][+-]?\d+)?")


def without_repeats(warnings: Iterable[QualityWarning]) -> list[QualityWarning]:
    """Warnings that differ in code, in words or in a figure's first two digits; each as first said.

    Parameters
    ----------
    warnings : iterable of QualityWarning
        In the order in which they are to be read.
    """
    kept: dict[tuple[str, str], QualityWarning] = {}
    for warning in warnings:
        kept.setdefault((warning.code, _NUMBER.sub(_rounded, warning.text)), warning)
    return list(kept.values())


def _rounded(number: re.Match[str]) -> str:
    return f"{float(number[0]):.2g}"
