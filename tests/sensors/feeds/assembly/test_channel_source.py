"""A channel is of the stream that gave it first, until that one has fallen silent."""

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.assembly.channel_source import HANDED_OVER, HANDED_OVER_TIME, ChannelSources
from sensors.feeds.protocol import ChannelSamples


def piece(stream: str, second: float) -> ChannelSamples:
    return ChannelSamples(stream, ("ax",), np.zeros((1, 1)), round(second * NANOSECONDS))


@pytest.mark.parametrize("given", [1, 3])
def test_a_stray_owner_of_few_messages_gives_way_to_one_of_more(given: int) -> None:
    sources = ChannelSources()
    assert [sources.refusal(piece("stray", n)) for n in range(given)] == [""] * given
    heard = [sources.refusal(piece("other", 10 + n)) for n in range(given + 1)]
    assert [bool(each) for each in heard] == [*[True] * given, False]
    assert sources.refusal(piece("stray", 20)) != ""


def test_an_owner_gives_way_after_messages_enough_over_time_enough() -> None:
    sources = ChannelSources()
    for n in range(HANDED_OVER):
        assert sources.refusal(piece("one", n)) == ""
    step = HANDED_OVER_TIME / (HANDED_OVER - 1)
    heard = [sources.refusal(piece("two", 20 + step * n)) for n in range(HANDED_OVER)]
    assert [bool(each) for each in heard] == [*[True] * (HANDED_OVER - 1), False]


def test_an_owner_that_speaks_between_keeps_its_channel() -> None:
    sources = ChannelSources()
    for n in range(HANDED_OVER):
        sources.refusal(piece("one", n))
    for n in range(5 * HANDED_OVER):
        assert sources.refusal(piece("two", 20 + 10 * n)) == (
            "two gives 'ax' while one does: a feed is one unit, so its address must name one of "
            "them"
        )
        assert sources.refusal(piece("one", 25 + 10 * n)) == ""
