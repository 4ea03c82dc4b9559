"""A spectrogram that grows with a recording and keeps no more than some hundred columns.

    segment's densities ─► sum over the channels ─► largest in each band of frequency ─► a column

When there are too many columns, two neighbours become their mean.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray

MOST_COLUMNS = 240  # an even number
BANDS = 140  # of frequency, of equal ratio
LOWEST_LINE = 3  # lines below are the mean and its leakage
FEWEST_COLUMNS = 6  # that show something over time


@dataclass(slots=True)
class Spectrogram:
    """Densities over time and frequency."""

    starts_ns: list[int] = field(default_factory=list)
    """Beginning of each column [ns since 1970-01-01 UTC]."""
    edges: FloatArray = field(default_factory=lambda: np.zeros(0))
    """Of the bands, shape (BANDS + 1,) [Hz]."""
    _columns: list[FloatArray] = field(default_factory=list)
    _merged: int = 1
    """Segments of a column."""
    _waiting: list[FloatArray] = field(default_factory=list)
    _waiting_ns: int = 0

    def add(self, start_ns: int, frequencies: FloatArray, densities: FloatArray) -> None:
        """Add a segment.

        Parameters
        ----------
        start_ns : int
            Its first sample [ns since 1970-01-01 UTC].
        frequencies : ndarray, shape (n,)
            [Hz], evenly spaced; the same of every segment.
        densities : ndarray, shape (n, n_channels)
            [unit²/Hz]
        """
        if not len(self.edges):
            self.edges = np.geomspace(frequencies[LOWEST_LINE], frequencies[-1], BANDS + 1)
        if not self._waiting:
            self._waiting_ns = start_ns
        self._waiting.append(_banded(frequencies, densities.sum(axis=1), self.edges))
        if len(self._waiting) < self._merged:
            return
        self.starts_ns.append(self._waiting_ns)
        self._columns.append(np.mean(self._waiting, axis=0))
        self._waiting.clear()
        if len(self._columns) == MOST_COLUMNS:
            self._halve()

    def _halve(self) -> None:
        pairs = len(self._columns) // 2
        self._columns = [
            (self._columns[2 * i] + self._columns[2 * i + 1]) / 2 for i in range(pairs)
        ]
        self.starts_ns = self.starts_ns[: 2 * pairs : 2]
        self._merged *= 2

    def picture(self) -> tuple[NDArray[np.int64], FloatArray] | None:
        """Edges in time (n + 1,) [ns] and densities (BANDS, n) [unit²/Hz], NaN in gaps.

        None where there are too few columns.
        """
        if len(self._columns) < FEWEST_COLUMNS:
            return None
        step = int(np.median(np.diff(self.starts_ns)))
        edges, columns = [self.starts_ns[0]], []
        for start_ns, column in zip(self.starts_ns, self._columns, strict=True):
            if start_ns - edges[-1] > step // 2:  # a gap
                edges.append(start_ns)
                columns.append(np.full(BANDS, np.nan))
            edges.append(max(start_ns, edges[-1]) + step)
            columns.append(column)
        return np.array(edges), np.array(columns).T


def _banded(frequencies: FloatArray, density: FloatArray, edges: FloatArray) -> FloatArray:
    """(BANDS,) the largest density in each band; between lines where a band has none."""
    first = np.searchsorted(frequencies, edges)
    found = np.interp(np.sqrt(edges[:-1] * edges[1:]), frequencies, density)
    for band in range(BANDS):
        inside = density[first[band] : first[band + 1]]
        if len(inside):
            found[band] = max(found[band], inside.max())
    return found
