"""What a report keeps of the samples while it reads them: averaged spectra and channel statistics.

    AccelerationBlock ─► ChannelRecord ─► spectra (Welch), rms, largest value, missing samples

Memory is one segment of samples a unit and rate, however long the recording.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import Message, StabilisationDiagram
from pipeline.viewer.pictures.spectrum import SEGMENT, power_spectral_densities
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.arrays import FloatArray

SHORTEST_SEGMENT = 10.0  # of a recording shorter than one segment [s]
FLAT_SHARE = 1e-6  # of the largest channel's deviation; below it a channel measures nothing [-]
MOST_COLUMNS = 240  # of a spectrogram; an even number
BANDS = 140  # of frequency, of equal ratio
LOWEST_LINE = 3  # lines below are the mean and its leakage
FEWEST_COLUMNS = 6  # that show something over time
SAME_RATE = 1e-3  # by which rates that are found from stamps differ between files [-]


@dataclass(slots=True)
class Spectrogram:
    """Densities over time and frequency, summed over the channels; the largest in each band.

    It grows with a recording and keeps no more than some hundred columns: when there are too many,
    two neighbours become their mean.
    """

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
            [Hz], evenly spaced by the same step in every segment.
        densities : ndarray, shape (n, n_channels)
            [unit²/Hz]
        """
        if not len(self.edges) or frequencies[-1] > (1 + SAME_RATE) * self.edges[-1]:
            self._widen(np.geomspace(frequencies[LOWEST_LINE], frequencies[-1], BANDS + 1))
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

    def _widen(self, edges: FloatArray) -> None:
        """Take other bands, as a higher rate does: the columns so far have none at its top."""
        if self._columns or self._waiting:
            centres = np.sqrt(edges[:-1] * edges[1:])
            places = np.searchsorted(self.edges, centres, side="right") - 1
            known = places < BANDS
            for columns in (self._columns, self._waiting):
                columns[:] = [
                    np.where(known, column[np.minimum(places, BANDS - 1)], np.nan)
                    for column in columns
                ]
        self.edges = edges

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
    """(BANDS,) the largest density in each band; between lines where a band has none.

    NaN of a band above the highest frequency.
    """
    first = np.searchsorted(frequencies, edges)
    centres = np.sqrt(edges[:-1] * edges[1:])
    found = np.interp(centres, frequencies, density, right=np.nan)
    for band in range(BANDS):
        inside = density[first[band] : first[band + 1]]
        if len(inside):
            found[band] = np.fmax(found[band], inside.max())
    return found


@dataclass(frozen=True, slots=True)
class ChannelStatistics:
    """Samples of one channel over the whole recording."""

    deviation: float
    """Standard deviation [unit of the channel]; NaN without samples."""
    largest: float
    """Largest departure from the mean [unit of the channel]; NaN without samples."""
    missing: float
    """Share of the samples that are NaN or infinite [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class RateSpectra:
    """Averaged spectra of what one unit sampled at one rate."""

    sampling_rate: float
    """[Hz]"""
    frequencies: FloatArray
    """Shape (n,) [Hz]."""
    densities: FloatArray
    """One-sided, shape (n, n_channels) [unit²/Hz]."""


@dataclass(slots=True)
class _Segments:
    """Welch's segments of what one unit sampled at one rate."""

    sampling_rate: float
    n_segments: int = 0
    densities: FloatArray | None = None
    """Sum over the segments."""
    waiting: list[NDArray[np.float32]] = field(default_factory=list)
    """Samples of the next segment."""

    def push(self, samples: NDArray[np.float32], end_ns: int, spectrogram: Spectrogram) -> None:
        self.waiting.append(samples)
        length = round(SEGMENT * self.sampling_rate)
        if sum(map(len, self.waiting)) < length:
            return
        joined = np.concatenate(self.waiting)
        frequencies, densities = power_spectral_densities(joined[:length], self.sampling_rate)
        start_ns = end_ns - round(len(joined) / self.sampling_rate * NANOSECONDS)
        spectrogram.add(start_ns, frequencies, densities.astype(np.float64))
        before = 0.0 if self.densities is None else self.densities
        self.densities = before + densities.astype(np.float64)
        self.n_segments += 1
        self.waiting = [joined[length // 2 :]]

    def spectra(self) -> RateSpectra | None:
        if self.densities is not None:
            length = round(SEGMENT * self.sampling_rate)
            frequencies = np.arange(len(self.densities)) * self.sampling_rate / length
            return RateSpectra(self.sampling_rate, frequencies, self.densities / self.n_segments)
        if sum(map(len, self.waiting)) < SHORTEST_SEGMENT * self.sampling_rate:
            return None
        frequencies, densities = power_spectral_densities(
            np.concatenate(self.waiting), self.sampling_rate
        )
        return RateSpectra(self.sampling_rate, frequencies, densities.astype(np.float64))


@dataclass(slots=True)
class ChannelRecord:
    """One unit's samples, block by block."""

    spectrogram: Spectrogram = field(default_factory=Spectrogram)
    """Of the segments of all rates over time."""
    _rates: list[_Segments] = field(default_factory=list)
    _current: _Segments | None = None
    """Of the block before."""
    _expected: tuple[str, int] = ("", -1)
    """Session and first sample of a block that goes on behind it."""
    _count: int = 0
    _finite: FloatArray = field(default_factory=lambda: np.zeros(0))
    _sums: FloatArray = field(default_factory=lambda: np.zeros(0))
    _squares: FloatArray = field(default_factory=lambda: np.zeros(0))
    _low: FloatArray = field(default_factory=lambda: np.zeros(0))
    _high: FloatArray = field(default_factory=lambda: np.zeros(0))

    def push(self, block: AccelerationBlock) -> None:
        """Add a block; a segment that a gap, a missing sample or another rate cuts is left out."""
        samples = block.samples
        if not len(self._finite):
            self._begin(samples.shape[1])
        if samples.shape[1] != len(self._finite):
            return  # another layout: its channels are others
        self._add_statistics(samples.astype(np.float64))
        before, self._current = self._current, self._segments_at(block.sampling_rate)
        is_whole = bool(np.isfinite(samples).all())
        goes_on = self._expected == (block.session, block.first_sample)
        if before is not self._current or not goes_on or not is_whole:
            self._current.waiting.clear()
        self._expected = (block.session, block.first_sample + len(samples))
        if is_whole:
            self._current.push(samples, block.end_ns, self.spectrogram)

    def spectra(self) -> tuple[RateSpectra, ...]:
        """Return the spectra of each rate of which a short segment, at least, is whole."""
        found = [each.spectra() for each in sorted(self._rates, key=lambda at: at.sampling_rate)]
        return tuple(each for each in found if each is not None)

    @property
    def sampling_rates(self) -> tuple[float, ...]:
        """The rates of its blocks, rising [Hz]."""
        return tuple(sorted(each.sampling_rate for each in self._rates))

    @property
    def n_segments(self) -> int:
        """Segments in the spectra."""
        return sum(each.n_segments for each in self._rates)

    def _segments_at(self, rate: float) -> _Segments:
        for each in self._rates:
            if abs(rate - each.sampling_rate) <= SAME_RATE * each.sampling_rate:
                return each
        self._rates.append(_Segments(rate))
        return self._rates[-1]

    def statistics(self) -> tuple[ChannelStatistics, ...]:
        """Statistics of each channel, in order."""
        with np.errstate(invalid="ignore", divide="ignore"):
            means = self._sums / self._finite
            deviations = np.sqrt(np.maximum(self._squares / self._finite - means**2, 0.0))
        largest = np.maximum(self._high - means, means - self._low)
        missing = 1.0 - self._finite / max(self._count, 1)
        rows = zip(deviations.tolist(), largest.tolist(), missing.tolist(), strict=True)
        return tuple(ChannelStatistics(*row) for row in rows)

    def _begin(self, n_channels: int) -> None:
        self._finite, self._sums, self._squares = (np.zeros(n_channels) for _ in range(3))
        self._low, self._high = np.full(n_channels, np.inf), np.full(n_channels, -np.inf)

    def _add_statistics(self, samples: FloatArray) -> None:
        finite = np.isfinite(samples)
        known = np.where(finite, samples, 0.0)
        self._count += len(samples)
        self._finite += finite.sum(axis=0)
        self._sums += known.sum(axis=0)
        self._squares += np.square(known).sum(axis=0)
        self._low = np.minimum(self._low, np.where(finite, samples, np.inf).min(axis=0))
        self._high = np.maximum(self._high, np.where(finite, samples, -np.inf).max(axis=0))


@dataclass(slots=True)
class SignalRecord:
    """What one turbine's units measured, and the last window's stabilisation diagram."""

    samples: dict[str, ChannelRecord] = field(default_factory=dict)
    """Spectra and statistics by acquisition unit."""
    stabilisation: StabilisationDiagram | None = None
    """Of the last identified window."""

    def fold(self, message: Message) -> None:
        """Take one message of the turbine into account."""
        if isinstance(message, AccelerationBlock):
            if message.unit not in self.samples:
                self.samples[message.unit] = ChannelRecord()
            self.samples[message.unit].push(message)
        elif isinstance(message, StabilisationDiagram) and (
            self.stabilisation is None or message.end_ns >= self.stabilisation.end_ns
        ):
            self.stabilisation = message
