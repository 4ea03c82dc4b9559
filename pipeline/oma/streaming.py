"""The same identification from a stream: filters and lag products of each sample are computed once.

    samples ─► decimation ─► time blocks ─► lag covariances of each block, in a ring
                                                    │ the blocks of a window, when it is complete
                                                    ▼
                                            one decomposition, as for an array

A window's result equals that of `identify` on the window's own samples: the filter's and the
lags' first samples are taken from inside the window, never from before it. Rounding may move which
order's pole represents a mode: of sixteen modes one differed, by a quarter of its std. The
decomposition, which is most of the work, is that of a new window: one that slid by a tenth costs as
much as one from scratch (`tests/benchmarks identification speed`).

Why only covariances are carried from window to window: beyond the strongest ones, the singular
vectors of the Hankel matrix are fitted noise, and a tenth of new samples turns them. Of a 15 MW
tower's first sixty, two to four per cent lie outside the span of an earlier window's first two
hundred, so that no projection of a block on a kept basis would still be right to the 1e-8 that
poles are, or to the 1e-3 that their std is; and the poles of every order follow from all of them.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.data_quality.coupled_harmonics import coupled_harmonics, rotor_warnings
from pipeline.oma.identification import (
    Identification,
    check_window,
    concluded,
    default_names,
    identify,
    rejection_in,
)
from pipeline.oma.preprocessing import decimated, n_decimated
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.band_identification import block_length, modes_of_covariances
from pipeline.oma.ssi.bands import Band, plan_bands
from pipeline.oma.ssi.covariance import (
    ALL,
    BlockCovariances,
    LagCovariances,
    References,
    block_covariances,
    joined,
    references_among,
    settings_for_channels,
    takes_some,
)
from pipeline.oma.work_limit import checkpoint
from sensors.arrays import FloatArray

FILTERED_AT_ONCE = (
    10.0  # that is filtered at once [s]: filters are longer than a block of one second
)


class StreamingDecimator:
    """`preprocessing.decimated` for samples that come piece by piece."""

    def __init__(self, decimation: int, *, high_passed: bool = False):
        self._decimation = decimation
        self._high_passed = high_passed
        self._held: FloatArray | None = None  # samples that further outputs still need

    def push(self, samples: FloatArray) -> FloatArray:
        """The outputs that these samples complete, (n_out, n_channels)."""
        held = samples if self._held is None else np.concatenate([self._held, samples])
        outputs = decimated(held, self._decimation, high_passed=self._high_passed)
        self._held = held[len(outputs) * self._decimation :]  # stays on the grid of outputs
        return outputs


class CovarianceRing:
    """Lag covariances of the newest time blocks of one band of a stream."""

    def __init__(self, band: Band, *, block_length: int, n_blocks: int):
        """block_length in samples of the band; n_blocks are kept, older ones are dropped."""
        self.band = band
        self._n_lags = 2 * band.block_rows
        self._block_length = block_length
        self._decimator = StreamingDecimator(band.decimation, high_passed=band.high_passed)
        self._held: FloatArray | None = None  # band samples from the next block's first on
        self._blocks: deque[BlockCovariances] = deque(maxlen=n_blocks)
        self.n_complete = 0  # blocks since the start, dropped ones counted

    def push(self, samples: FloatArray) -> None:
        """Take samples at the full rate, (n, n_channels)."""
        new = self._decimator.push(samples)
        self._held = new if self._held is None else np.concatenate([self._held, new])
        while len(self._held) >= self._block_length + self._n_lags:
            piece = self._held[: self._block_length + self._n_lags]
            checkpoint()
            self._blocks.append(block_covariances(piece, n_lags=self._n_lags))
            self._held = self._held[self._block_length :]
            self.n_complete += 1

    def covariances(
        self,
        first_block: int,
        n_blocks: int,
        offset: FloatArray,
        references: References = ALL,
    ) -> LagCovariances:
        """Of a window: n_blocks from a block counted since the start, the full-rate samples'
        offset (n_channels,) off, of which a high pass leaves nothing.

        The ring holds all channels as references; a window takes those that it asks for.
        Raises IndexError when a block is not complete yet or no longer kept.
        """
        oldest = self.n_complete - len(self._blocks)
        if first_block < oldest or first_block + n_blocks > self.n_complete:
            raise IndexError(
                f"blocks {first_block} to {first_block + n_blocks - 1} of the stream are asked "
                f"for; {oldest} to {self.n_complete - 1} are kept"
            )
        chosen = [
            self._blocks[index - oldest].with_references(references)
            for index in range(first_block, first_block + n_blocks)
        ]
        left = np.zeros_like(offset) if self.band.high_passed else offset
        return joined(chosen, offset=left, references=references)


def largest_piece(length: int, most: float) -> int:
    """The largest number of samples up to `most` that divides `length`: 1 at least."""
    return max(n for n in range(1, max(1, int(most)) + 1) if length % n == 0)


class StreamingIdentifier:
    """Identifies windows of one gapless stretch of a stream, block by block.

    What comes is filtered in pieces of some ten seconds that begin where windows do, whatever the
    blocks' length: a stream that is taken up again at a window gives the same numbers.

    Where windows do not overlap, or the hop is no whole number of time blocks, nothing is shared
    between windows and each is identified from its samples: the covariances of its blocks take
    twenty times their memory, and a hundred turbines fill a window at the same time.
    """

    def __init__(self, sampling_rate: float, n_channels: int, settings: OmaSettings):
        self._settings = settings
        self._rate = sampling_rate
        self._window = round(settings.window_duration * sampling_rate)
        self._hop = round(settings.hop * sampling_rate)
        bands = plan_bands(
            n_samples=self._window,
            n_channels=n_channels,
            sampling_rate=sampling_rate,
            settings=settings,
        )
        whole = abs(settings.hop * sampling_rate - self._hop) < 1e-6
        overlap = self._hop < self._window
        shared = overlap and whole and all(self._hop % self._block(band) == 0 for band in bands)
        shared = shared and not takes_some(n_channels, settings)  # a window's own are taken
        self._rings = [self._ring(band) for band in bands] if shared else []
        self._piece = largest_piece(
            math.gcd(self._window, self._hop), FILTERED_AT_ONCE * sampling_rate
        )
        self._held: list[FloatArray] = []  # samples on their way to the rings

    def _block(self, band: Band) -> int:
        """A time block of the band, in samples at the full rate."""
        return band.decimation * block_length(self._window, band, self._settings)

    def _blocks_in_window(self, band: Band) -> int:
        n_samples = n_decimated(self._window, band.decimation, high_passed=band.high_passed)
        usable = n_samples - 2 * band.block_rows
        return usable * band.decimation // self._block(band)

    def _ring(self, band: Band) -> CovarianceRing:
        return CovarianceRing(
            band,
            block_length=self._block(band) // band.decimation,
            n_blocks=self._blocks_in_window(band) + self._hop // self._block(band) + 1,
        )

    @property
    def hop_samples(self) -> int:
        """From one window's first sample to the next one's."""
        return self._hop

    def push(self, samples: NDArray[np.floating]) -> None:
        """Take the next samples of the stretch, (n, n_channels)."""
        if not self._rings:
            return
        self._held.append(np.asarray(samples, dtype=np.float64))
        if sum(map(len, self._held)) >= self._piece:
            held = np.concatenate(self._held)
            whole = len(held) - len(held) % self._piece
            for start in range(0, whole, self._piece):
                self._give(held[start : start + self._piece])
            self._held = [held[whole:]]

    def _give(self, samples: FloatArray) -> None:
        for ring in self._rings:
            ring.push(samples)

    def identify(
        self,
        hops: int,
        samples: NDArray[np.floating],
        *,
        channel_names: Sequence[str] | None = None,
    ) -> Identification:
        """The window that begins `hops` hops after the stretch did; `samples` are its own.

        Reference channels that the window lacks are left out: a stream goes on without them.
        """
        names = channel_names or default_names(samples.shape[1])
        settings = settings_for_channels(self._settings, names)
        if self._held:
            self._give(np.concatenate(self._held))
            self._held = []
        if not self._rings:
            return identify(samples, self._rate, settings, channel_names=names)
        findings = check_window(samples, self._rate, channel_names=names)
        if rejection_in(findings) is not None:
            return Identification((), (), rejection_in(findings))
        if any(finding.action == "mend" for finding in findings):
            return identify(samples, self._rate, settings, channel_names=names)
        references = references_among(names, settings)
        steady = np.asarray(samples, dtype=np.float64)
        offset = steady.mean(axis=0)
        if coupled_harmonics(steady - offset, self._rate) is not None:
            return identify(samples, self._rate, settings, channel_names=names)
        by_band = []
        for ring in self._rings:
            covariances = ring.covariances(
                hops * self._hop // self._block(ring.band),
                self._blocks_in_window(ring.band),
                offset,
                references,
            )
            by_band.append(modes_of_covariances(covariances, ring.band, self._settings))
        found = concluded(by_band, steady - offset, self._rate, findings, self._settings)
        turning = rotor_warnings(steady - offset, self._rate)
        return replace(found, warnings=(*found.warnings, *turning))
