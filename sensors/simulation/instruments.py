"""What instruments make of accelerations.

Anti-alias decimation, axes as they were mounted, noise, drift, and the counts of a converter.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.layout import FORE_AFT, SIDE_SIDE, SensorLayout
from sensors.arrays import FloatArray
from sensors.errors import InputError

CONVERTER_PASS_BAND = (
    0.45  # end of the pass band over the output rate, as in delta-sigma converters [-]
)
CONVERTER_STOP_BAND = 0.5  # begin of the stop band over the output rate: nothing folds back [-]
ATTENUATION = 80.0  # of the stop band [dB]; the pass band's ripple is then 1e-4


class Decimator:
    """Linear-phase anti-alias filter and decimation of a stream, its delay compensated.

    Output sample m belongs to the same instant as input sample m · factor. Outputs lag the inputs
    by the filter's half length; what lies before the first input counts as zero.
    """

    def __init__(self, factor: int, n_channels: int) -> None:
        self._factor = factor
        self._taps = anti_alias_taps(factor)
        self.delay = len(self._taps) // 2  # of the outputs [inputs]
        self._pending = np.zeros((self.delay, n_channels))

    def advance(self, samples: FloatArray) -> FloatArray:
        """Outputs that these inputs complete.

        Parameters
        ----------
        samples : ndarray, shape (n_in, n_channels)

        Returns
        -------
        ndarray, shape (n_out, n_channels)
            n_out n_in / factor on average.
        """
        from scipy.signal import fftconvolve  # 75 MB that only a simulation needs

        pending = np.concatenate([self._pending, samples])
        n_out = max(0, (len(pending) - len(self._taps)) // self._factor + 1)
        self._pending = pending[n_out * self._factor :].copy()
        if n_out == 0:
            return np.empty((0, pending.shape[1]))
        filtered = fftconvolve(pending.T, self._taps[None, :], mode="valid", axes=1)
        return np.ascontiguousarray(filtered[:, :: self._factor].T)

    def gain(self, frequencies: FloatArray, input_rate: float) -> FloatArray:
        """Amplitude gain before folding, (n_frequencies,) [-]; the phase is zero."""
        lags = np.arange(-self.delay, self.delay + 1) / input_rate
        return np.cos(2.0 * np.pi * np.multiply.outer(frequencies, lags)) @ self._taps


def anti_alias_taps(factor: int) -> FloatArray:
    """Symmetric low-pass (Kaiser window) for decimation by `factor`, (odd,) [-].

    Flat to PASS_BAND and empty beyond STOP_BAND, both over the output rate.
    """
    from scipy.signal import firwin, kaiserord  # 75 MB that only a simulation needs

    if factor == 1:
        return np.ones(1)
    nyquist = factor / 2.0  # of the input, over the output rate
    n_taps, beta = kaiserord(ATTENUATION, (CONVERTER_STOP_BAND - CONVERTER_PASS_BAND) / nyquist)
    half = n_taps // 2
    cutoff = 0.5 * (CONVERTER_PASS_BAND + CONVERTER_STOP_BAND) / nyquist
    return firwin(2 * half + 1, cutoff, window=("kaiser", beta))


def quantise(samples: FloatArray, step: float) -> NDArray[np.float32]:
    """Samples as the converter counts them: the nearest multiple of its step.

    Parameters
    ----------
    samples : ndarray
        Any shape [m/s²].
    step : float
        Step of the converter [m/s²], 0 for none; a power of two is exact in float32.
    """
    if step == 0.0:
        return samples.astype(np.float32)
    return (np.round(samples / step) * step).astype(np.float32)


class InstrumentError(InputError):
    """An instrument that cannot be; the message names the setting and its value."""


@dataclass(frozen=True, slots=True)
class Instruments:
    """How the accelerometers differ from perfect ones; coupling is the layout's."""

    noise_density: float = 0.0
    """Density of white noise, one-sided, beside any share of the rms [m/s²/√Hz]."""

    full_scale: float = 0.0
    """End of the converter's range, ± [m/s²]; 0: without end."""

    drift_per_hour: float = 0.0
    """Drift per hour of the offset, up in even channels, down in odd ones [m/s²]."""

    misalignment: tuple[float, ...] = ()
    """Misalignment of each channel, from x towards y [deg]; (): none."""

    def __post_init__(self) -> None:
        for name in ("noise_density", "full_scale"):
            if not getattr(self, name) >= 0:
                raise InstrumentError(
                    f"instruments {name} is {getattr(self, name):g}; it must be 0 or more"
                )

    def noise_deviation(self, sampling_rate: float) -> float:
        """Standard deviation of the noise [m/s²]: the density times √(half the sampling rate)."""
        return float(self.noise_density * np.sqrt(0.5 * sampling_rate))

    def drift(self, times: FloatArray, n_channels: int) -> FloatArray:
        """Offset at times since the first sample [s], (n_times, n_channels) [m/s²]."""
        signs = np.where(np.arange(n_channels) % 2 == 0, 1.0, -1.0)
        return np.multiply.outer(times / 3600.0 * self.drift_per_hour, signs)

    def limited(self, samples: FloatArray) -> FloatArray:
        """Return what the converter's range leaves."""
        if self.full_scale == 0.0:
            return samples
        return np.clip(samples, -self.full_scale, self.full_scale)


class MountedAxes:
    """The accelerometers' axes as they are.

    Fixed to the tower, off by a mounting error, while fore-aft and side-side follow the nacelle.

    Parameters
    ----------
    layout : SensorLayout
        Layout as it is believed to be.
    misalignment : tuple[float, ...], optional
        Misalignment of each channel [deg]; empty: none.
    """

    def __init__(self, layout: SensorLayout, misalignment: tuple[float, ...] = ()) -> None:
        if misalignment and len(misalignment) != len(layout.channels):
            raise InstrumentError(
                f"instruments misalignment has {len(misalignment)} values; layout "
                f"{layout.layout_id} has {len(layout.channels)} channels"
            )
        x, y, z = layout.directions.T
        if np.any(np.abs(z) > 1e-6):
            raise InstrumentError(
                f"layout {layout.layout_id} has an axis that is not horizontal; "
                "it cannot be turned by yaw or misalignment"
            )
        self._azimuths = np.arctan2(y, x) + np.radians(misalignment or 0.0)
        self.in_nacelle = replace(
            layout,
            channels=tuple(
                replace(channel, name=f"{channel.name}{suffix}", direction=direction)
                for suffix, direction in ((" x", FORE_AFT), (" y", SIDE_SIDE))
                for channel in layout.channels
            ),
        )

    def readings(self, in_nacelle: FloatArray, yaw: FloatArray) -> FloatArray:
        """Return what the axes read, (n, n_channels) [m/s²].

        Parameters
        ----------
        in_nacelle : ndarray, shape (n, 2 n_channels)
            Readings of the layout `in_nacelle` [m/s²].
        yaw : ndarray, shape (n,)
            Yaw of the nacelle [deg].

        Returns
        -------
        ndarray, shape (n, n_channels)
            In [m/s²].
        """
        along, across = np.split(in_nacelle, 2, axis=1)
        angle = self._azimuths - np.radians(yaw)[:, None]
        return np.cos(angle) * along + np.sin(angle) * across

    def variances(self, in_nacelle: FloatArray, yaw: float) -> FloatArray:
        """Return variances of the readings where x and y are independent, (n_channels,) [(m/s²)²].

        Parameters
        ----------
        in_nacelle : ndarray, shape (2 n_channels,)
            Variances of the layout `in_nacelle`; yaw [deg].

        Returns
        -------
        ndarray, shape (n_channels,)
            In [(m/s²)²].
        """
        along, across = np.split(in_nacelle, 2)
        angle = self._azimuths - np.radians(yaw)
        return np.cos(angle) ** 2 * along + np.sin(angle) ** 2 * across
