"""Gaussian series of any cross-spectrum, segment after segment, without end.

Each segment is a sum of harmonics with random amplitudes, as wind and wave generators draw them,
and would repeat itself. Two neighbours overlap by half and are mixed with cos a and sin a, a
running from 0 to 90° over the overlap: cos² + sin² = 1 keeps the variance, the sum is Gaussian,
and for lags τ shorter than the overlap T its covariance is that of the spectrum times cos(π τ/2T).
"""

from collections.abc import Callable, Iterator

import numpy as np
from scipy.fft import irfft

from sensors.arrays import ComplexArray, FloatArray
from sensors.loads.load import LoadError

OVERLAP = 600.0  # T [s]: harmonics are 1/1200 Hz apart, the lowest one is the first
Colouring = Callable[[float, ComplexArray], ComplexArray]


def harmonics(highest_frequency: float) -> FloatArray:
    """Frequencies of a segment's harmonics, from 1/(2T) up, (n_harmonics,) [Hz]."""
    return np.arange(1, max(2, int(highest_frequency * 2 * OVERLAP) + 1)) / (2 * OVERLAP)


class SegmentedNoise:
    """The series of one source of randomness, an overlap at a time.

    Parameters
    ----------
    colouring : Colouring
        Colouring, (middle of the segment [s], white harmonics (n_sources, n_harmonics)) →
        harmonics of the series, (n_series, n_harmonics). A white harmonic has E|w|² = 2: with L
        Lᴴ the one-sided cross-spectrum [unit²/Hz] at a frequency, the colouring is L w. It may
        change with time, as a sea and a wind do.
    n_sources : int
        Number of independent sources.
    n_harmonics : int
        Number of harmonics in a segment.
    sampling_rate : float
        Sampling rate [Hz].
    start : float
        Time of the first sample [s].
    """

    def __init__(
        self,
        colouring: Colouring,
        *,
        n_sources: int,
        n_harmonics: int,
        sampling_rate: float,
        start: float,
        rng: np.random.Generator,
    ) -> None:
        if 2 * n_harmonics > 2 * round(OVERLAP * sampling_rate):
            raise LoadError(
                f"a load reaches {n_harmonics / (2 * OVERLAP):g} Hz; at {sampling_rate:g} Hz its "
                f"series can hold {0.5 * sampling_rate:g} Hz"
            )
        self._colouring = colouring
        self._size = (n_sources, n_harmonics)
        self._half = round(OVERLAP * sampling_rate)
        self._start = start
        self._rng = rng

    def __iter__(self) -> Iterator[FloatArray]:
        """Yield segments of one overlap's length, (n_series, n) each."""
        angle = 0.5 * np.pi * np.arange(self._half) / self._half
        leaving, entering = np.cos(angle), np.sin(angle)
        middle = self._start
        held = self._segment(middle)
        while True:
            middle += OVERLAP
            following = self._segment(middle)
            segment = held[:, self._half :]
            segment *= leaving
            segment += following[:, : self._half] * entering
            held = following
            yield segment

    def _segment(self, middle: float) -> FloatArray:
        """(n_series, 2 · overlap)."""
        n = 2 * self._half
        drawn = self._rng.standard_normal((2, *self._size))
        coloured = self._colouring(middle, drawn[0] + 1j * drawn[1])
        moving = coloured.any(axis=1)  # a long-crested sea has nothing across
        spectrum = np.zeros((np.count_nonzero(moving), n // 2 + 1), dtype=np.complex128)
        # x = Σ √(S Δf) Re[w exp(iωt)], Δf = 1/(2T); irfft divides by n and doubles
        spectrum[:, 1 : self._size[1] + 1] = coloured[moving]
        spectrum[:, 1 : self._size[1] + 1] *= 0.5 * n * (2 * OVERLAP) ** -0.5
        if moving.all():
            return irfft(spectrum, n, axis=1)
        series = np.zeros((len(coloured), n))
        series[moving] = irfft(spectrum, n, axis=1)
        return series


def in_chunks(segments: Iterator[FloatArray], chunk: int) -> Iterator[FloatArray]:
    """Yield segments (n, n_series) of any length as chunks of one length."""
    held: list[FloatArray] = []
    count = 0
    for segment in segments:
        held.append(segment)
        count += len(segment)
        if count < chunk:
            continue
        joined = np.concatenate(held) if len(held) > 1 else segment
        for first in range(0, count - chunk + 1, chunk):
            yield joined[first : first + chunk]
        held = [joined[count // chunk * chunk :]]
        count = len(held[0])
