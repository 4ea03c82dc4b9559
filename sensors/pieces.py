"""Streams of samples cut and joined: what a simulation hands on, in any piece length."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def trimmed(pieces: Iterator[FloatArray], *, first: int, count: int) -> Iterator[FloatArray]:
    """Samples first to first + count of a stream that comes in pieces, (n, n_channels) each."""
    to_skip, wanted = first, count
    while wanted > 0:
        piece = next(pieces)
        kept = piece[to_skip : to_skip + wanted]
        to_skip = max(0, to_skip - len(piece))
        wanted -= len(kept)
        if len(kept):
            yield kept


def one_ahead(pieces: Iterator[FloatArray]) -> Iterator[FloatArray]:
    """An endless stream, its next piece made in another thread while this one is worked on."""
    with ThreadPoolExecutor(1, thread_name_prefix="loads") as pool:
        following = pool.submit(next, pieces)
        while True:
            piece = following.result()
            following = pool.submit(next, pieces)
            yield piece


def in_blocks(pieces: Iterator[NDArray[np.float32]], size: int) -> Iterator[NDArray[np.float32]]:
    """The stream cut into blocks of `size` samples; the last one may be shorter."""
    held: NDArray[np.float32] | None = None
    for piece in pieces:
        held = piece if held is None else np.concatenate([held, piece])
        whole = len(held) // size * size
        yield from (held[start : start + size] for start in range(0, whole, size))
        held = held[whole:]
    if held is not None and len(held):
        yield held
