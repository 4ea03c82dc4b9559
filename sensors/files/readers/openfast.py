"""OpenFAST's binary output (`.outb`) → SEP005 channels.

int16 format │ [int16 name length] │ int32 channels │ int32 steps │ two float64 of the time
│ float32 scale, offset a channel │ text │ names │ units │ [int32 times] │ samples, step by step

Source: OpenFAST, modules/nwtc-library/src/NWTC_IO.f90, subroutine WrBinFAST. `.out` is text with
tabs and needs no reader of its own.
"""

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.files.sep005 import Sep005Channel
from sensors.files.table import readable, require_file

WITH_TIME, WITHOUT_TIME, UNCOMPRESSED, LONG_NAMES = 1, 2, 3, 4  # values of the format
NAME_LENGTH = 10  # of a name or a unit, where the file does not state it [characters]


@dataclass(slots=True)
class _Bytes:
    """A file's bytes, read from front to back."""

    content: bytes
    position: int = 0

    def array(self, kind: str, count: int) -> np.ndarray[tuple[int], np.dtype[np.generic]]:
        """Return the next `count` numbers of a little-endian type.

        Raises
        ------
        EOFError
            If fewer are left.
        ValueError
            For a negative count.
        """
        size = np.dtype(kind).itemsize * count
        if count < 0:
            raise ValueError(f"a count of {count}")
        if self.position + size > len(self.content):
            raise EOFError(f"cut off: {size} bytes are needed at {self.position}")
        found = np.frombuffer(self.content, dtype=kind, count=count, offset=self.position)
        self.position += size
        return found

    def integer(self, kind: str) -> int:
        return int(self.array(kind, 1)[0])

    def text(self, length: int) -> str:
        return self.array("u1", length).tobytes().decode("latin-1").strip()


def read_outb(path: Path) -> list[Sep005Channel]:
    """Read the channels of a binary output file of OpenFAST.

    Parameters
    ----------
    path : Path
        The file.

    Returns
    -------
    list of Channel
        All channels with their names, units and times [s].

    Raises
    ------
    FileError
        If the file is missing, cut off, or not of a known format.

    Notes
    -----
    Compressed samples are 16-bit integers n: x = (n - offset) / scale.
    """
    source = _Bytes(require_file(path).read_bytes())
    with readable(path, "OpenFAST output", EOFError, ValueError, struct.error, OverflowError):
        return _channels(source)


def _channels(source: _Bytes) -> list[Sep005Channel]:
    kind = source.integer("<i2")
    if kind not in (WITH_TIME, WITHOUT_TIME, UNCOMPRESSED, LONG_NAMES):
        raise ValueError(f"its format is {kind}; 1 to 4 are known")
    length = source.integer("<i2") if kind == LONG_NAMES else NAME_LENGTH
    count, steps = source.integer("<i4"), source.integer("<i4")
    first, second = source.array("<f8", 2).astype(np.float64).tolist()
    scale, offset = np.ones(1), np.zeros(1)
    if kind != UNCOMPRESSED:
        scale = source.array("<f4", count).astype(np.float64)
        offset = source.array("<f4", count).astype(np.float64)
    if not np.isfinite(scale).all() or (scale == 0).any():
        raise ValueError("a channel's scale is zero or not finite")
    source.text(source.integer("<i4"))  # the description
    names = [source.text(length) for _ in range(count + 1)][1:]  # the first is the time
    units = [source.text(length).strip("()") for _ in range(count + 1)][1:]
    times = _times(source, kind, steps, first, second)
    samples = source.array("<f8" if kind == UNCOMPRESSED else "<i2", count * steps)
    values = (samples.reshape(steps, count).astype(np.float64) - offset) / scale
    return [
        Sep005Channel(data=column, name=name, unit_str="" if unit == "-" else unit, time=times)
        for column, name, unit in zip(values.T, names, units, strict=True)
    ]


def _times(source: _Bytes, kind: int, steps: int, first: float, second: float) -> FloatArray:
    """Return the time of each step, (steps,) [s].

    Parameters
    ----------
    first : float
        Scale of stored times; else the time of the first step [s].
    second : float
        Offset of stored times; else the interval [s].
    """
    if kind != WITH_TIME:
        return np.asarray(first + second * np.arange(steps), dtype=np.float64)
    if first == 0:
        raise ValueError("the scale of its time is zero")
    counts = source.array("<i4", steps).astype(np.float64)
    return np.asarray((counts - second) / first, dtype=np.float64)
