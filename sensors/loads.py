"""Random loads on the structure: spectra, the series drawn from them, and where they act.

Every load here is white noise through a filter (`kernel`), spread over the structure in fixed
patterns (`distribution`): its series are independent of each other, its spectrum is known in
closed form, and it can be drawn without end at constant memory. Spectra are one-sided, per Hz.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.optimize import brentq

from sensors.errors import InputError
from sensors.turbine.assembly import PLANE, StructuralModel

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]

SEA_WATER_GRAVITY = 9.81  # [m/s²], in the dispersion relation


class LoadError(InputError):
    """A load that cannot be; the message names the quantity and its value."""


class RandomStream(IntEnum):
    """Each source of randomness has its own generator: adding one leaves the others' draws."""

    TOWER = 0
    BLADES = 1
    WAVES = 2
    SENSOR_NOISE = 3


def generator(seed: int, stream: RandomStream) -> np.random.Generator:
    """The generator of one source of randomness of the experiment with this seed."""
    return np.random.default_rng([seed, stream])


@dataclass(frozen=True, slots=True)
class BroadbandLoad:
    """White load in both horizontal directions, independent from node to node.

    The total over n nodes has the stated rms in each direction, so a node has rms / √n. The
    series is white; a structure that feels it as straight lines between its samples (`response`)
    feels 0.29 dB less at 12 Hz.
    """

    tower_rms: float = 50e3  # over all tower and monopile nodes, per direction [N]
    blade_rms: float = 15e3  # over the nodes of one blade, flapwise and edgewise each [N]
    highest_frequency: float = 60.0  # the rms is that of the band from 0 to here [Hz]

    def __post_init__(self) -> None:
        _require_not_negative("broadband tower_rms", self.tower_rms, "N")
        _require_not_negative("broadband blade_rms", self.blade_rms, "N")
        _require_positive("broadband highest_frequency", self.highest_frequency, "Hz")


@dataclass(frozen=True, slots=True)
class WaveBandLoad:
    """Load with the spectrum of a JONSWAP sea, coherent over the wetted nodes.

    Fore-aft and side-side are independent (a short-crested sea). Along the depth it follows the
    inertia force of linear waves of the peak period, cosh k(z + d). It stands for a sea's place in
    the spectrum, not for Morison's equation.
    """

    fore_aft_rms: float = 300e3  # total over the nodes [N]
    side_side_rms: float = 60e3  # [N]
    peak_period: float = 8.0  # Tp [s]
    peak_enhancement: float = 3.3  # γ [-], mean of the JONSWAP measurements
    highest_frequency: float = 0.6  # cut of the spectrum [Hz]

    def __post_init__(self) -> None:
        _require_not_negative("waves fore_aft_rms", self.fore_aft_rms, "N")
        _require_not_negative("waves side_side_rms", self.side_side_rms, "N")
        _require_positive("waves peak_period", self.peak_period, "s")
        if not 1.0 <= self.peak_enhancement <= 7.0:
            raise LoadError(
                f"waves peak_enhancement is {self.peak_enhancement:g}; JONSWAP's γ is 1 to 7"
            )
        if not self.highest_frequency > 1.0 / self.peak_period:
            raise LoadError(
                f"waves highest_frequency is {self.highest_frequency:g} Hz; it must lie above "
                f"the peak at {1.0 / self.peak_period:.3g} Hz"
            )


def jonswap(
    frequencies: FloatArray, *, peak_frequency: float, peak_enhancement: float
) -> FloatArray:
    """JONSWAP spectrum up to a constant factor, (n_frequencies,).

        S(f) ∝ f⁻⁵ exp(−5/4 (f/fp)⁻⁴) γ^exp(−(f/fp − 1)² / 2s²),  s = .07 up to fp, .09 above

    Source: Hasselmann et al., Deutsche Hydrographische Zeitschrift A8 No. 12 (1973).
    """
    relative = np.maximum(np.asarray(frequencies) / peak_frequency, 1e-3)  # S(0) = 0
    width = np.where(relative <= 1.0, 0.07, 0.09)
    peak = peak_enhancement ** np.exp(-((relative - 1.0) ** 2) / (2.0 * width**2))
    return relative**-5.0 * np.exp(-1.25 * relative**-4.0) * peak


def wave_number(frequency: float, depth: float) -> float:
    """k [rad/m] of a linear wave: (2πf)² = g k tanh(k d). frequency [Hz], depth d [m]."""
    deep = (2.0 * np.pi * frequency) ** 2 / SEA_WATER_GRAVITY
    shallow = 2.0 * np.pi * frequency / np.sqrt(SEA_WATER_GRAVITY * depth)

    def mismatch(k: float) -> float:
        return k * np.tanh(k * depth) - deep

    return float(brentq(mismatch, 0.0, 2.0 * max(deep, shallow), xtol=1e-14))


def wave_profile(
    elevations: FloatArray, *, mudline: float, level: float, period: float
) -> FloatArray:
    """Shares of the nodes in a wave's inertia force, (n_nodes,) [-]; they sum to 1.

    elevations   of the nodes, rising, (n_nodes,) [m]
    mudline      [m]
    level        of the water [m]
    period       of the wave [s]

    The force per metre follows the water's acceleration, cosh k(z − mudline) from the mudline to
    the water's level; each metre's goes to its two nodes like a load on a simple beam.
    """
    depth = level - mudline
    if not depth > 0:
        raise LoadError(
            f"water level is {level:g} m; waves need it above the mudline at {mudline:g} m"
        )
    k = wave_number(1.0 / period, depth)
    points, weights = np.polynomial.legendre.leggauss(200)
    z = mudline + 0.5 * depth * (points + 1.0)
    force = weights * np.cosh(k * (z - mudline)) / np.cosh(k * depth)
    hats = np.array([np.interp(z, elevations, unit) for unit in np.eye(len(elevations))])
    shares = hats @ force
    return shares / shares.sum()


@dataclass(frozen=True, slots=True, eq=False)
class RandomLoad:
    """Independent random series, each in a fixed pattern over the degrees of freedom."""

    distribution: FloatArray  # (n_dofs, n_series): forces per unit of each series [N]
    kernel: FloatArray  # filter from white noise of variance 1 to a series, (n_taps,) [-]
    sampling_rate: float  # [Hz]
    stream: RandomStream

    @property
    def n_series(self) -> int:
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

    def series(self, seed: int, chunk: int) -> Iterator[FloatArray]:
        """The load's series without end, in chunks (chunk, n_series) [-]."""
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
        """The next samples, (n_samples, n_series)."""
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

    density   one-sided spectrum at 0 … sampling_rate/2, (n + 1,), up to a constant factor
    returns   (2n,)

        h = F⁻¹ √S, under a Hann window so that its end does not ring
    """
    n_taps = 2 * (len(density) - 1)
    kernel = np.fft.fftshift(irfft(np.sqrt(density), n_taps))
    kernel *= 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n_taps) / n_taps)
    return kernel / np.linalg.norm(kernel)


WAVE_KERNEL_DURATION = 300.0  # [s]: a resolution of .007 Hz, below the width of JONSWAP's peak


def wave_kernel(load: WaveBandLoad, sampling_rate: float) -> FloatArray:
    """Filter from white noise to a series with the load's spectrum, variance 1."""
    n_taps = 2 * round(0.5 * WAVE_KERNEL_DURATION * sampling_rate)
    frequencies = np.linspace(0.0, 0.5 * sampling_rate, n_taps // 2 + 1)
    density = jonswap(
        frequencies,
        peak_frequency=1.0 / load.peak_period,
        peak_enhancement=load.peak_enhancement,
    )
    density[frequencies > load.highest_frequency] = 0.0
    return spectral_kernel(density, sampling_rate)


def random_loads(
    model: StructuralModel,
    *,
    broadband: BroadbandLoad,
    waves: WaveBandLoad,
    sampling_rate: float,
) -> tuple[RandomLoad, ...]:
    """Every load on the structure that is not switched off, as series at this rate [Hz]."""
    white = white_kernel(highest_frequency=broadband.highest_frequency, sampling_rate=sampling_rate)
    loads = []
    if broadband.tower_rms > 0:
        pattern = tower_pattern(model, broadband.tower_rms)
        loads.append(RandomLoad(pattern, white, sampling_rate, RandomStream.TOWER))
    if broadband.blade_rms > 0 and model.blade_dofs.size:
        pattern = blade_pattern(model, broadband.blade_rms)
        loads.append(RandomLoad(pattern, white, sampling_rate, RandomStream.BLADES))
    if waves.fore_aft_rms > 0 or waves.side_side_rms > 0:
        pattern = wave_pattern(model, waves)
        kernel = wave_kernel(waves, sampling_rate)
        loads.append(RandomLoad(pattern, kernel, sampling_rate, RandomStream.WAVES))
    return tuple(loads)


def tower_pattern(model: StructuralModel, rms: float) -> FloatArray:
    """A force at every tower and monopile node in each direction, independent of the others.

    rms       of the n nodes' total in one direction [N], so rms / √n each
    returns   (n_dofs, 2n): fore-aft nodes from the mudline up, then side-side ones [N]
    """
    dofs = np.concatenate([model.tower_dofs[:, plane.start] for plane in PLANE.values()])
    return _one_force_each(model, dofs, rms / np.sqrt(len(model.elevations)))


def blade_pattern(model: StructuralModel, rms: float) -> FloatArray:
    """A force at every blade node but the root, flapwise and edgewise, independent of the others.

    rms       of the total over a blade's n nodes in one direction [N], so rms / √n each
    returns   (n_dofs, 2n · n_blades) [N]
    """
    flap_and_edge = model.blade_dofs[:, :, (0, 2)]
    n_nodes = flap_and_edge.shape[1]
    return _one_force_each(model, flap_and_edge.ravel(), rms / np.sqrt(n_nodes))


def wave_pattern(model: StructuralModel, waves: WaveBandLoad) -> FloatArray:
    """Forces of the wave band on the wetted nodes, (n_dofs, 2): fore-aft, side-side [N]."""
    water = model.description.water
    if water is None:
        raise LoadError(
            f"{model.description.name} has no [water]; set the waves' fore_aft_rms and "
            "side_side_rms to 0"
        )
    profile = wave_profile(
        model.elevations,
        mudline=model.description.mudline,
        level=water.level,
        period=waves.peak_period,
    )
    pattern = np.zeros((model.n_dofs, 2))
    pattern[model.tower_dofs[:, PLANE["FA"].start], 0] = waves.fore_aft_rms * profile
    pattern[model.tower_dofs[:, PLANE["SS"].start], 1] = waves.side_side_rms * profile
    return pattern


def _one_force_each(model: StructuralModel, dofs: IntArray, rms: float) -> FloatArray:
    pattern = np.zeros((model.n_dofs, len(dofs)))
    pattern[dofs, np.arange(len(dofs))] = rms
    return pattern


def _require_positive(what: str, value: float, unit: str) -> None:
    if not value > 0:
        raise LoadError(f"{what} is {value:g} {unit}; it must be positive")


def _require_not_negative(what: str, value: float, unit: str) -> None:
    if not value >= 0:
        raise LoadError(f"{what} is {value:g} {unit}; it must be 0 or more")
