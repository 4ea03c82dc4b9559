"""Streams of samples cut and joined, in chunks of any length."""

from collections import deque
from collections.abc import Generator, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray


def trim(chunks: Iterator[FloatArray], *, first: int, count: int) -> Iterator[FloatArray]:
    """Samples first to first + count of a stream of chunks, (n, n_channels) each."""
    to_skip, wanted = first, count
    while wanted > 0:
        chunk = next(chunks)
        kept = chunk[to_skip : to_skip + wanted]
        to_skip = max(0, to_skip - len(chunk))
        wanted -= len(kept)
        if len(kept):
            yield kept


def prefetch(chunks: Iterator[FloatArray], depth: int) -> Generator[FloatArray]:
    """Yield a stream whose next `depth` chunks are made in another thread while one is used.

    Closed early, it makes no further chunk than the one that is being made.
    """
    pool = ThreadPoolExecutor(1, thread_name_prefix="loads")
    try:
        waiting = deque(pool.submit(next, chunks, None) for _ in range(depth))
        while (chunk := waiting.popleft().result()) is not None:
            waiting.append(pool.submit(next, chunks, None))
            yield chunk
    finally:
        pool.shutdown(cancel_futures=True)


def split_into_blocks(
    chunks: Iterator[NDArray[np.float32]], size: int
) -> Iterator[NDArray[np.float32]]:
    """Yield the stream cut into blocks of `size` samples; the last one may be shorter."""
    held: NDArray[np.float32] | None = None
    for chunk in chunks:
        held = chunk if held is None else np.concatenate([held, chunk])
        whole = len(held) // size * size
        yield from (held[start : start + size] for start in range(0, whole, size))
        held = held[whole:]
    if held is not None and len(held):
        yield held
