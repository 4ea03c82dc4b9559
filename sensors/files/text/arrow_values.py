"""Values of Arrow's columns, out of their buffers.

`to_numpy` and `pyarrow.array` load pandas where that is installed, a quarter of a second of each
`pilewatch identify`.
"""

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from sensors.arrays import BoolArray, FloatArray


def values_of(column: pa.Array) -> FloatArray:
    """Numbers of a column of doubles, NaN where it has none, (n,)."""
    values = _buffer(column, np.float64)
    if column.null_count:
        values = np.where(truths_of(column.is_valid()), values, np.nan)
    return values


def integers_of(column: pa.Array) -> NDArray[np.int64]:
    """Numbers of a column of 64-bit integers that has them all, (n,)."""
    return _buffer(column, np.int64)


def truths_of(column: pa.Array) -> BoolArray:
    """Truth values of a column that has them all, (n,)."""
    return np.asarray(_buffer(column.cast(pa.uint8()), np.uint8) == 1)


def _buffer(column: pa.Array, kind: type[Any]) -> NDArray[Any]:
    """What a column of numbers keeps, (n,)."""
    if not len(column):
        return np.empty(0, dtype=kind)
    kept = np.frombuffer(column.buffers()[1], dtype=kind)
    return kept[column.offset : column.offset + len(column)]
