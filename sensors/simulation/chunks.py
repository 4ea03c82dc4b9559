"""Streams of samples cut and joined: what a simulation hands on, in any piece length."""

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray


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


def made_ahead(pieces: Iterator[FloatArray], depth: int) -> Generator[FloatArray]:
    """Yield a stream whose next `depth` pieces are made in another thread while one is worked on.

    Closed early, it makes no further piece than the one that is being made.
    """
    pool = ThreadPoolExecutor(1, thread_name_prefix="loads")
    try:
        waiting = deque(pool.submit(next, pieces, None) for _ in range(depth))
        while (piece := waiting.popleft().result()) is not None:
            waiting.append(pool.submit(next, pieces, None))
            yield piece
    finally:
        pool.shutdown(cancel_futures=True)


def in_blocks(pieces: Iterator[NDArray[np.float32]], size: int) -> Iterator[NDArray[np.float32]]:
    """Yield the stream cut into blocks of `size` samples; the last one may be shorter."""
    held: NDArray[np.float32] | None = None
    for piece in pieces:
        held = piece if held is None else np.concatenate([held, piece])
        whole = len(held) // size * size
        yield from (held[start : start + size] for start in range(0, whole, size))
        held = held[whole:]
    if held is not None and len(held):
        yield held
