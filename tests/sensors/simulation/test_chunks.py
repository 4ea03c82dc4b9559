"""Streams that are made ahead in a thread: the same pieces, in order, and no more than wanted."""

from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest
from numpy.typing import NDArray

from sensors.simulation.tower import prefetch


def counted(made: list[int], last: int | None = None) -> Iterator[NDArray[np.float64]]:
    """Pieces (1, 1) that hold 0, 1, 2, …; `made` keeps which were asked for."""
    number = 0
    while last is None or number <= last:
        made.append(number)
        yield np.full((1, 1), float(number))
        number += 1


@pytest.mark.parametrize("depth", [1, 3, 20])
def test_prefetched_chunks_come_in_order_and_end_where_the_stream_ends(depth: int) -> None:
    chunks = prefetch(counted([], last=10), depth)
    assert [chunk.item() for chunk in chunks] == list(range(11))


def test_a_stream_closed_early_is_not_made_to_its_end() -> None:
    made: list[int] = []
    with closing(prefetch(counted(made), 4)) as chunks:
        taken = [next(chunks).item() for _ in range(3)]
    assert taken == [0, 1, 2]
    assert len(made) <= 3 + 4


def test_what_goes_wrong_in_the_thread_is_raised_where_the_chunk_is_wanted() -> None:
    def failing() -> Iterator[NDArray[np.float64]]:
        yield np.zeros((1, 1))
        raise ValueError("a load that cannot be")

    chunks = prefetch(failing(), 2)
    next(chunks)
    with pytest.raises(ValueError, match="a load that cannot be"):
        next(chunks)
