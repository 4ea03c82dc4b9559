"""Lag covariances of the outputs by time blocks, and which channels serve as their references.

A window that slid by a tenth shares most of its blocks with the one before; keeping their
covariances saves a fiftieth of the work, for the decomposition is each window's own. They are
computed anew.

References are the channels that lag covariances are taken with. With all n channels every pair is
used. A few good ones (where every mode moves, with little noise) make the Hankel matrix narrower
and everything after it cheaper, and leave the noise of poor sensors out of half of each product. A
mode that no reference sees is lost. Of more than 32 channels not all can be references: the
covariances of a hundred would take gigabytes. Those are taken that together explain most of the
others.
Source: Peeters and De Roeck (1999), Reference-based stochastic subspace identification for
output-only modal analysis, Mech. Syst. Signal Process. 13.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from pipeline.oma.settings import OmaSettings, OmaSettingsError
from sensors.arrays import FloatArray

References = slice | NDArray[np.intp]  # the channels that y_t runs over, by index
ALL = slice(None)
MOST_PAIRS = 1024  # channels × references that are chosen by themselves
FEWEST_REFERENCES = 4
EXPLAINED = 1e-6  # of a channel's variance: less is left where the others know it [-]


@dataclass(frozen=True, slots=True, eq=False)
class LagCovariances:
    """Lag covariances of a window, and what each of its time blocks says.

    `blocks` R_τ^(b), (n_blocks, n_lags, n_channels, n_references), lags τ = 1..n_lags, of samples
    divided by `scales`, (n_channels,). Blocks are equally long, so their mean is the window's
    covariance.
    """

    blocks: FloatArray
    scales: FloatArray

    @property
    def mean(self) -> FloatArray:
        """R_τ, (n_lags, n_channels, n_references)."""
        return self.blocks.mean(axis=0)

    @property
    def deviations(self) -> FloatArray:
        """ΔR^(b), like `blocks`: Σ_b vec(ΔR^(b)) vec(ΔR^(b))ᵀ is the covariance of the mean.

            ΔR^(b) = (R^(b) − R) / sqrt(n_b (n_b − 1))

        Source: Reynders, Pintelon, De Roeck (2008), Uncertainty bounds on modal parameters
        obtained from stochastic subspace identification, Mech. Syst. Signal Process. 22.
        """
        n_blocks = len(self.blocks)
        return (self.blocks - self.mean) / np.sqrt(n_blocks * (n_blocks - 1))


def lag_covariances(
    samples: FloatArray,
    *,
    n_lags: int,
    block_length: int,
    references: References = ALL,
) -> LagCovariances:
    """Lag covariances of a record in consecutive time blocks, channels scaled to unit rms.

    samples        y, (n, n_channels), free of offset
    n_lags         L: lags 1..L [samples]
    block_length   m [samples]; the record holds (n − L) // m blocks, what is left over is unused
    references     channels that y_t runs over; all by default

        R_τ^(b) = 1/m Σ_{t in block b} y_{t+τ} y_tᵀ

    y_{t+τ} may lie in a later block, so that no lag is cut short and the blocks' mean is the
    covariance of the whole record. Raises ValueError for a record shorter than two blocks.
    """
    n_blocks = (len(samples) - n_lags) // block_length
    if n_blocks < 2:
        raise ValueError(f"{n_blocks} time blocks are too few for a covariance; 2 are needed")
    starts = range(0, n_blocks * block_length, block_length)
    products = np.stack(
        [
            lagged_products(samples[start : start + block_length + n_lags], n_lags, references)[1:]
            / block_length
            for start in starts
        ]
    )
    squares = np.mean(
        [np.mean(samples[start : start + block_length] ** 2, axis=0) for start in starts], axis=0
    )
    scales = np.where(squares > 0, np.sqrt(np.abs(squares)), 1.0)
    products /= np.outer(scales, scales[references])
    return LagCovariances(products, scales)


def lagged_products(samples: FloatArray, n_lags: int, references: References = ALL) -> FloatArray:
    """Σ_t y_{t+τ} y_tᵀ over all samples t but the last n_lags, (n_lags + 1, channels, references).

    By segments as long as the lags, whose cross spectra are added before one inverse transform:
    a transform of the whole block would spend itself on lags that are not used. The cost is that
    of the samples, not of samples × lags.
    """
    length, n_channels = len(samples) - n_lags, samples.shape[1]
    step = min(length, n_lags)
    n_segments = -(-length // step)
    n_fft = fft.next_fast_len(step + n_lags, real=True)
    padded = np.zeros((n_segments * step + n_lags, n_channels))
    padded[: len(samples)] = samples
    starts = range(0, n_segments * step, step)
    reaching = np.stack([padded[start : start + step + n_lags] for start in starts], axis=2)
    ahead = fft.rfft(reaching, n_fft, axis=0)  # (n_fft/2, n_channels, n_segments)
    padded[length:] = 0.0
    starting = padded[: n_segments * step, references].reshape(n_segments, step, -1)
    here = fft.rfft(starting.transpose(1, 0, 2), n_fft, axis=0)
    cross_spectra = ahead @ here.conj()
    return np.asarray(fft.irfft(cross_spectra, n_fft, axis=0, overwrite_x=True)[: n_lags + 1])


def block_hankel(covariances: FloatArray, block_rows: int) -> FloatArray:
    """Block Hankel matrix of lag covariances.

    covariances   R_τ, (n_lags, n_channels, n_references), τ = 1..n_lags, n_lags = 2p
    block_rows    p
    returns       H, ((p + 1)·n_channels, p·n_references), block (i, j) = R_{i+j+1} from i, j = 0
    """
    _, n_channels, n_references = covariances.shape
    windows = np.lib.stride_tricks.sliding_window_view(covariances, block_rows, axis=0)
    # windows: (p + 1, n_channels, n_references, p), the last axis running over j
    return np.ascontiguousarray(windows.transpose(0, 1, 3, 2)).reshape(
        (block_rows + 1) * n_channels, block_rows * n_references
    )


def references_among(channel_names: Sequence[str], settings: OmaSettings) -> References:
    """Indices of the reference channels among a record's channels.

    Raises OmaSettingsError where a name is no channel's.
    """
    wanted = settings.reference_channels
    if wanted is None:
        return ALL
    for name in wanted:
        if name not in channel_names:
            raise OmaSettingsError(
                f"[oma] reference_channels has {name!r}; the channels are "
                f"{', '.join(channel_names)}"
            )
    return np.array([list(channel_names).index(name) for name in wanted], dtype=np.intp)


def settings_for_channels(settings: OmaSettings, channel_names: Sequence[str]) -> OmaSettings:
    """The settings for a window that lacks some channels, those of a silent unit for example.

    Its references are those that are left; all channels, where none is.
    """
    if settings.reference_channels is None:
        return settings
    left = tuple(name for name in settings.reference_channels if name in channel_names)
    return replace(settings, reference_channels=left or None)


def with_bounded_references(
    samples: FloatArray, channel_names: Sequence[str], settings: OmaSettings
) -> OmaSettings:
    """The settings with as many references as the channels of a window, (n, n_channels), can have.

    The references are chosen one after the other, each so that it explains most of what the
    correlations R of all channels still hold: Σ_j R_ij² / R_ii is largest, and R_i R_iᵀ / R_ii
    is taken off. What only one channel feels, its noise, is chosen last.
    """
    n_channels = samples.shape[1]
    if settings.reference_channels is not None or n_channels**2 <= MOST_PAIRS:
        return settings  # all of them, or those that somebody has named
    scales = samples.std(axis=0)
    scaled = (samples - samples.mean(axis=0)) / np.where(scales > 0, scales, 1.0)
    left = scaled.T @ scaled / len(scaled)
    chosen: list[int] = []
    for _ in range(max(FEWEST_REFERENCES, MOST_PAIRS // n_channels)):
        power = np.diag(left)
        known = power <= EXPLAINED
        gained = np.where(known, 0.0, (left**2).sum(axis=0) / np.where(known, 1.0, power))
        best = int(np.argmax(gained))
        if not gained[best] > 0:
            break
        chosen.append(best)
        left = left - np.outer(left[best], left[best]) / power[best]
    names = tuple(channel_names[index] for index in sorted(chosen))
    return replace(settings, reference_channels=names or None)
