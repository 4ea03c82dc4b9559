"""The same identification from a stream: each sample is worked on once, however windows overlap.

    samples ─► decimation ─► time blocks ─► lag covariances of each block, in a ring
                                                    │ the blocks of a window, when it is complete
                                                    ▼
                                            one decomposition, as for an array

A window's result equals that of `identify` on the window's own samples: the filter's and the
lags' first samples are taken from inside the window, never from before it.
"""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.bands import Band
from pipeline.oma.covariance import BlockCovariances, LagCovariances, block_covariances, joined
from pipeline.oma.preprocessing import decimated

FloatArray = NDArray[np.float64]


class StreamingDecimator:
    """`preprocessing.decimated` for samples that come piece by piece."""

    def __init__(self, decimation: int):
        self._decimation = decimation
        self._held: FloatArray | None = None  # samples that further outputs still need

    def push(self, samples: FloatArray) -> FloatArray:
        """The outputs that these samples complete, (n_out, n_channels)."""
        held = samples if self._held is None else np.concatenate([self._held, samples])
        outputs = decimated(held, self._decimation)
        self._held = held[len(outputs) * self._decimation :]  # stays on the grid of outputs
        return outputs


class CovarianceRing:
    """Lag covariances of the newest time blocks of one band of a stream."""

    def __init__(self, band: Band, *, block_length: int, n_blocks: int):
        """block_length in samples of the band; n_blocks are kept, older ones are dropped."""
        self.band = band
        self._n_lags = 2 * band.block_rows
        self._block_length = block_length
        self._decimator = StreamingDecimator(band.decimation)
        self._held: FloatArray | None = None  # band samples from the next block's first on
        self._blocks: deque[BlockCovariances] = deque(maxlen=n_blocks)
        self.n_complete = 0  # blocks since the start, dropped ones counted

    def push(self, samples: FloatArray) -> None:
        """Take samples at the full rate, (n, n_channels)."""
        new = self._decimator.push(samples)
        self._held = new if self._held is None else np.concatenate([self._held, new])
        while len(self._held) >= self._block_length + self._n_lags:
            piece = self._held[: self._block_length + self._n_lags]
            self._blocks.append(block_covariances(piece, n_lags=self._n_lags))
            self._held = self._held[self._block_length :]
            self.n_complete += 1

    def covariances(self, first_block: int, n_blocks: int, offset: FloatArray) -> LagCovariances:
        """Of a window: n_blocks from a block counted since the start, offset (n_channels,) off.

        Raises IndexError when a block is not complete yet or no longer kept.
        """
        oldest = self.n_complete - len(self._blocks)
        if first_block < oldest or first_block + n_blocks > self.n_complete:
            raise IndexError(
                f"blocks {first_block} to {first_block + n_blocks - 1} of the stream are asked "
                f"for; {oldest} to {self.n_complete - 1} are kept"
            )
        chosen: Sequence[BlockCovariances] = [
            self._blocks[index - oldest] for index in range(first_block, first_block + n_blocks)
        ]
        return joined(chosen, offset=offset)
