"""White noise through a filter: series of known spectrum, drawn without end at constant memory."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from sensors.arrays import ComplexArray, FloatArray
from sensors.loads.load import RandomStream, generator


@dataclass(frozen=True, slots=True, eq=False)
class RandomLoad:
    """Independent random series, each in a fixed pattern over the degrees of freedom."""

    distribution: FloatArray
    """Distribution, (n_dofs, n_series): forces per unit of each series [N]."""

    kernel: FloatArray
    """Filter from white noise of variance 1 to a series, (n_taps,) [-]."""

    sampling_rate: float
    """Sampling rate [Hz]."""

    stream: RandomStream

    @property
    def n_series(self) -> int:
        """Number of series."""
        return self.distribution.shape[1]

    def spectrum(self, frequencies: FloatArray) -> FloatArray:
        """One-sided spectral density of each series, (n_frequencies,) [1/Hz].

        S(f) = 2/f_s |Σ_k h_k exp(−2πi f k/f_s)|²
        """
        if len(self.kernel) == 1:
            return np.full(len(frequencies), 2.0 / self.sampling_rate * self.kernel[0] ** 2)
        n_fft = next_fast_len(8 * len(self.kernel), real=True)
        grid = np.arange(n_fft // 2 + 1) * (self.sampling_rate / n_fft)
        gain = np.abs(rfft(self.kernel, n_fft))
        return 2.0 / self.sampling_rate * np.interp(frequencies, grid, gain) ** 2

    def response_spectrum(self, frequencies: FloatArray, gains: ComplexArray) -> FloatArray:
        """Spectrum of what the load makes a structure do, see `Load`: the series' are equal."""
        power = (gains.real**2 + gains.imag**2).sum(axis=-1)
        return power * self.spectrum(frequencies)[:, None]

    def series(self, seed: int, chunk: int) -> Iterator[FloatArray]:
        """Yield the load's series without end, in chunks (chunk, n_series) [-]."""
        noise = FilteredNoise(self.kernel, self.n_series, generator(seed, self.stream))
        while True:
            yield noise.advance(chunk)


class FilteredNoise:
    """White Gaussian noise through a finite filter, by FFT (overlap-save), without end."""

    def __init__(self, kernel: FloatArray, n_series: int, rng: np.random.Generator) -> None:
        self._kernel = kernel
        self._rng = rng
        self._history = rng.standard_normal((len(kernel) - 1, n_series))

    def advance(self, n_samples: int) -> FloatArray:
        """Return the next samples, (n_samples, n_series)."""
        drawn = self._rng.standard_normal((n_samples, self._history.shape[1]))
        if len(self._kernel) == 1:
            drawn *= self._kernel[0]
            return drawn
        white = np.concatenate([self._history, drawn])
        self._history = white[n_samples:]
        n_fft = next_fast_len(len(white), real=True)
        spectrum = rfft(white, n_fft, axis=0) * rfft(self._kernel, n_fft)[:, None]
        return irfft(spectrum, n_fft, axis=0)[len(self._kernel) - 1 : len(white)]


def white_kernel(*, highest_frequency: float, sampling_rate: float) -> FloatArray:
    """Kernel (1,) of white noise whose band from 0 to `highest_frequency` has variance 1."""
    return np.array([np.sqrt(sampling_rate / (2.0 * highest_frequency))])


def spectral_kernel(density: FloatArray, sampling_rate: float) -> FloatArray:
    """Symmetric filter that gives white noise the shape of a spectrum, and variance 1.

    Parameters
    ----------
    density : ndarray, shape (n + 1,)
        One-sided spectrum at 0 … sampling_rate/2, up to a constant factor.

    Returns
    -------
    ndarray, shape (2n,)

    Notes
    -----
        h = F⁻¹ √S, under a Hann window so that its end does not ring
    """
    n_taps = 2 * (len(density) - 1)
    kernel = np.fft.fftshift(irfft(np.sqrt(density), n_taps))
    kernel *= 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_taps) / n_taps)
    return kernel / np.linalg.norm(kernel)
