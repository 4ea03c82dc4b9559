"""The table of streams: one key for each message, found again from either side."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from pipeline.messages import Message, ModalEstimate, NodeStatus
from pipeline.streams import STREAMS, key_of, stream_of
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_estimates import estimate, mode
from tests.pipeline.example_messages import LAYOUT, block, rejection, status


def test_every_message_has_one_stream() -> None:
    travelling = [stream.message for stream in STREAMS]
    assert set(travelling) == set(get_args(Message))
    assert len(travelling) == len(set(travelling))


def test_keys_name_the_turbine_the_unit_and_the_node() -> None:
    assert key_of(block(0)) == "pilewatch/t1/tower/acceleration"
    assert key_of(LAYOUT) == "pilewatch/t1/tower/layout"
    assert key_of(rejection(0)) == "pilewatch/t1/window-rejected"
    assert key_of(status("updating")) == "pilewatch/t1/status/updating"


def test_no_two_streams_share_a_key_expression() -> None:
    expressions = [stream.key_expression for stream in STREAMS]
    assert len(expressions) == len(set(expressions))
    assert stream_of(AccelerationBlock).key_expression == "pilewatch/*/*/acceleration"
    assert stream_of(NodeStatus).key_expression == "pilewatch/*/status/*"


def test_a_window_of_ten_minutes_can_be_fetched_again_from_the_publisher() -> None:
    stream = stream_of(AccelerationBlock)
    assert stream.period is not None
    assert stream.cached * stream.period >= 600.0


def test_what_a_publisher_keeps_of_a_turbine_is_bounded_by_megabytes() -> None:
    """Modes of eight channels with their factors: some 40 a window, of 40 columns."""
    modes = [
        replace(mode(0.1 + n, np.ones(8)), covariance_factor=np.ones((10, 40))) for n in range(40)
    ]
    assert len(encode(estimate(*modes))) * stream_of(ModalEstimate).cached < 4e6


def test_a_type_that_does_not_travel_has_no_stream() -> None:
    with pytest.raises(KeyError):
        stream_of(int)
