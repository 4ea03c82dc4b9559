"""Modal estimates as an archive keeps them: covariances in single precision, by their triangles.

A mode's covariance factor F, (2 + n_channels, n_columns), has a column for each time block and
more. F Fᵀ is all that is used of it, but for close pairs the covariance between the members too. So
the triangular L with L Lᵀ = F Fᵀ is kept, for the members of a pair that of their common columns
together: 55 numbers of 420 for eight channels and 40 blocks.

    frame       KeptEstimate
    content     length of what follows              4 bytes, little-endian
                ModalEstimate without factors       protobuf
                a group of modes: members, common columns, own columns     3 × 2 bytes
                    L row by row, own columns       float32
"""

import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from pipeline.archive.store import StoredFrame, frames_of, messages_in
from pipeline.messages import Message, ModalEstimate, Mode, without_covariances
from pipeline.transport.codec import decode, encode
from sensors.arrays import FloatArray

KEPT_ESTIMATE = "KeptEstimate"  # kind of the frame
_LENGTH = struct.Struct("<I")
_GROUP = struct.Struct("<HHH")


def kept_frames(messages: Iterable[Message]) -> Iterator[StoredFrame]:
    """Messages as an archive keeps them."""
    for message in messages:
        if isinstance(message, ModalEstimate):
            yield (KEPT_ESTIMATE, kept_estimate(message))
        else:
            yield from frames_of((message,))


def kept_messages(frames: Iterable[StoredFrame]) -> Iterator[Message]:
    """Yield what `kept_frames` made, in order. Raises CodecError, ValueError for a damaged one."""
    for frame in frames:
        if frame[0] == KEPT_ESTIMATE:
            yield restored_estimate(frame[1])
        else:
            yield from messages_in((frame,))


def kept_estimate(estimate: ModalEstimate) -> bytes:
    """Return an estimate as bytes, its covariances in single precision."""
    slim = without_covariances(estimate)
    content = encode(slim)
    groups = (_group_bytes(group) for group in _groups(estimate.modes))
    return _LENGTH.pack(len(content)) + content + b"".join(groups)


def restored_estimate(kept: bytes) -> ModalEstimate:
    """Return the estimate. Raises CodecError, ValueError where the bytes are damaged."""
    (length,) = _LENGTH.unpack_from(kept)
    begin = _LENGTH.size + length
    slim = decode(ModalEstimate, kept[_LENGTH.size : begin])
    reader = _Reader(kept, begin)
    factors = {
        place: factor
        for places in _places(slim.modes)
        for place, factor in zip(places, reader.group(slim, places), strict=True)
    }
    modes = tuple(
        replace(mode, covariance_factor=factors[place][0], n_block_columns=factors[place][1])
        for place, mode in enumerate(slim.modes)
    )
    return replace(slim, modes=modes)


def _places(modes: Sequence[Mode]) -> list[list[int]]:
    """Places of the members of each close pair, and of each other mode alone."""
    groups: dict[str, list[int]] = {}
    for place, mode in enumerate(modes):
        groups.setdefault(mode.pair_id or f"single {place}", []).append(place)
    return list(groups.values())


def _groups(modes: Sequence[Mode]) -> Iterator[list[Mode]]:
    for places in _places(modes):
        yield [modes[place] for place in places]


def _group_bytes(group: list[Mode]) -> bytes:
    """Return a single mode's columns together; a pair's common ones first, then each one's own."""
    n_blocks = max(mode.n_block_columns for mode in group)
    if len(group) == 1:
        head = _GROUP.pack(1, n_blocks, 0)
        return head + _lower(triangular(group[0].covariance_factor))
    rows = group[0].covariance_factor.shape[0]
    common = np.zeros((len(group) * rows, n_blocks))
    for place, mode in enumerate(group):
        of_blocks = mode.covariance_factor[:, : mode.n_block_columns]
        common[place * rows : (place + 1) * rows, : mode.n_block_columns] = of_blocks
    n_own = max(mode.covariance_factor.shape[1] - mode.n_block_columns for mode in group)
    own = np.zeros((len(group), rows, n_own))
    for place, mode in enumerate(group):
        of_mode = mode.covariance_factor[:, mode.n_block_columns :]
        own[place, :, : of_mode.shape[1]] = of_mode
    head = _GROUP.pack(len(group), n_blocks, n_own)
    return head + _lower(triangular(common)) + own.astype("<f4").tobytes()


def triangular(factor: FloatArray) -> FloatArray:
    """(p, p) lower triangular L with L Lᵀ = F Fᵀ, of F (p, n); rows of zeros stay exactly zero.

    With the QR decomposition Fᵀ = Q R, L = Rᵀ.
    """
    known = np.flatnonzero(np.any(factor != 0, axis=1))
    lower = np.zeros((len(factor), len(factor)))
    if len(known):
        upper = np.asarray(np.linalg.qr(factor[known].T, mode="r"))  # (min(n, n_known), n_known)
        found = upper.T
        lower[np.ix_(known, known[: found.shape[1]])] = found
    return lower


@cache
def _lower_mask(size: int) -> NDArray[np.bool_]:
    """(size, size) whether an element is on the diagonal or below: made once, used 40 times a
    window."""
    return np.tri(size, dtype=bool)


def _lower(matrix: FloatArray) -> bytes:
    return bytes(matrix[_lower_mask(len(matrix))].astype("<f4").tobytes())


@dataclass(slots=True)
class _Reader:
    """Takes the groups' numbers one after the other."""

    content: bytes
    place: int

    def group(self, slim: ModalEstimate, places: list[int]) -> Iterator[tuple[FloatArray, int]]:
        """Factor and number of common columns of each member."""
        members, n_blocks, n_own = _GROUP.unpack_from(self.content, self.place)
        if members != len(places):
            raise ValueError(f"{members} modes where {len(places)} are expected")
        self.place += _GROUP.size
        rows = 2 + len(slim.channels)
        lower = self._triangle(members * rows)
        if members == 1:
            wide = np.zeros((rows, max(n_blocks, rows)))
            wide[:, :rows] = lower
            yield wide, n_blocks
            return
        # As many common columns as there were: the evidence counts them as the blocks that the
        # covariance was estimated from
        used = np.flatnonzero(np.any(lower != 0, axis=0))
        common = np.zeros((len(lower), n_blocks))
        common[:, : len(used)] = lower[:, used]
        own = self._numbers(members * rows * n_own).reshape(members, rows, n_own)
        for member in range(members):
            of_member = common[member * rows : (member + 1) * rows]
            yield np.hstack([of_member, own[member]]), n_blocks

    def _triangle(self, size: int) -> FloatArray:
        matrix = np.zeros((size, size))
        matrix[_lower_mask(size)] = self._numbers(size * (size + 1) // 2)
        return matrix

    def _numbers(self, count: int) -> FloatArray:
        found = np.frombuffer(self.content, dtype="<f4", count=count, offset=self.place)
        self.place += 4 * count
        return found.astype(float)
