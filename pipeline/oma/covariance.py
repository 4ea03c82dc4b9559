"""Lag covariances of the outputs by time blocks, and the block Hankel matrix made of them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class LagCovariances:
    """Lag covariances of a window, and what each of its time blocks says.

    `blocks` R_τ^(b), (n_blocks, n_lags, n_channels, n_references), lags τ = 1..n_lags. Blocks are
    equally long, so their mean is the window's covariance.
    """

    blocks: FloatArray

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
    samples: FloatArray, *, n_lags: int, n_blocks: int, references: slice = slice(None)
) -> LagCovariances:
    """Lag covariances of a record in n_blocks consecutive time blocks.

    samples      y, (n, n_channels)
    n_lags       L: lags 1..L [samples]
    references   channels that y_t runs over; all by default

        R_τ^(b) = 1/m Σ_{t in block b} y_{t+τ} y_tᵀ,   b = 1..n_b,  m = (n − L) // n_b

    y_{t+τ} may lie in a later block, so that no lag is cut short and the blocks' mean is the
    covariance of the whole record. The first (n − L) mod n_b samples are only read as nothing;
    ValueError when a block would be empty.
    """
    block_length = (len(samples) - n_lags) // n_blocks
    if block_length < 1:
        raise ValueError(
            f"{len(samples)} samples are too few for {n_blocks} blocks and {n_lags} lags"
        )
    first = len(samples) - n_lags - block_length * n_blocks
    starts = first + block_length * np.arange(n_blocks)
    return LagCovariances(
        np.stack(
            [
                block_covariances(
                    samples[start : start + block_length + n_lags],
                    n_lags=n_lags,
                    references=references,
                )
                for start in starts
            ]
        )
    )


def block_covariances(
    samples: FloatArray, *, n_lags: int, references: slice = slice(None)
) -> FloatArray:
    """R_τ of one time block, τ = 1..n_lags: (n_lags, n_channels, n_references).

    samples   (m + n_lags, n_channels): the block's m samples and the n_lags that follow it

    By FFT: the cost is that of the samples, not of samples × lags.
    """
    length = len(samples) - n_lags
    n_fft = fft.next_fast_len(len(samples) + 1, real=True)
    ahead = fft.rfft(samples, n_fft, axis=0)
    here = fft.rfft(samples[:length, references], n_fft, axis=0)
    cross_spectra = ahead[:, :, None] * here.conj()[:, None, :]
    return np.asarray(fft.irfft(cross_spectra, n_fft, axis=0)[1 : n_lags + 1]) / length


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
