"""What every message may hold: the limit itself is let in, what lies beyond it is not."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from pipeline.messages import (
    BlockRange,
    FoundationTruth,
    Message,
    PooledPosterior,
    RecordedUntil,
    StabilisationDiagram,
    StreamEnd,
    StreamGap,
)
from pipeline.transport.checks import check
from pipeline.transport.errors import CodecError
from sensors.acquisition.scada import ScadaSample
from tests.pipeline.example_messages import LAYOUT, block, rejection, status
from tests.pipeline.report.example_session import estimate, event, posterior

LATEST = 2**62 - 1  # [ns]
POLES = {name: np.zeros(2, np.float32) for name in ("frequencies", "orders", "bands")}
POLES |= {name: np.zeros(2, np.float32) for name in ("frequency_stds", "damping_ratios")}
DIAGRAM = StabilisationDiagram("t1", 0, 0, 1, **POLES)
GAP = StreamGap("t1", "tower", "s", 0, 1, 0, 1)
END = StreamEnd("t1", "tower", "s", 0, 1)
SCADA = ScadaSample("t1", 0, "parked", 8.0, 0.0, 90.0, 0.0, 0.0, 0.5)
RANGE = BlockRange(3, 4, 0, 0)
POOLED = PooledPosterior("t1", 0, 0, 2, posterior(0).parameters[:3], 0.1, "")
SIGMA = posterior(0).parameters[3]
MODE = estimate(0).modes[0]
FACTOR = MODE.covariance_factor


def acknowledged(**changes: int) -> RecordedUntil:
    return RecordedUntil("t1", "tower", "s", 0, (replace(RANGE, **changes),))


def summary(**changes: float) -> Message:
    """A posterior whose σ has other figures."""
    return replace(
        posterior(0), parameters=(*posterior(0).parameters[:3], replace(SIGMA, **changes))
    )


def shown(**changes: Any) -> Message:
    """An estimate of one mode."""
    return replace(estimate(0), modes=(replace(MODE, **changes),))


def of_channels(number: int) -> Message:
    channel = LAYOUT.channels[0]
    return replace(LAYOUT, channels=tuple(replace(channel, name=f"{n}") for n in range(number)))


def samples(n_channels: int) -> dict[str, Any]:
    return {"samples": np.zeros((1, n_channels), np.float32)}


TAKEN: list[Message] = [
    *(replace(block(0), **each) for each in ({"sampling_rate": 1e-3}, {"sampling_rate": 1e7})),
    replace(block(0), sequence=2**62 - 1, first_sample=2**62 - 1),
    replace(block(0), sequence=0, first_sample=0, start_ns=0),
    replace(block(0), **samples(4096)),
    replace(block(0), start_ns=2**62 - 2**59 - 10**9 - 1),
    of_channels(4096),
    *(replace(estimate(0), weight=each) for each in (1e-6, 1.0)),
    *(replace(estimate(0), start_ns=each, end_ns=each) for each in (0, LATEST)),
    replace(estimate(0), modes=(), channels=()),
    shown(n_block_columns=0),
    shown(n_block_columns=FACTOR.shape[1]),
    *(replace(SCADA, water_level=each) for each in (1e9, -1e9, float("nan"))),
    replace(SCADA, time_ns=LATEST),
    summary(nominal=-1.0),
    replace(posterior(0), draws=np.zeros((0, 4))),
    replace(GAP, start_ns=1, end_ns=1, n_blocks=0),
    acknowledged(first=0, end=1),
    *(DIAGRAM, END, POOLED, rejection(0), status("recorder"), event()),
]
REFUSED: list[tuple[Message, str]] = [
    (replace(block(0), sampling_rate=9.9e-4), "sampling_rate is"),
    (replace(block(0), sampling_rate=1.01e7), "sampling_rate is"),
    (replace(block(0), sequence=2**62), "sequence is"),
    (replace(block(0), first_sample=-1), "first_sample is"),
    (replace(block(0), **samples(4097)), "4097 channels"),
    (replace(block(0), **samples(0)), "none"),
    (replace(block(0), start_ns=2**62 - 2**59 - 10**9), "samples end before"),
    (replace(block(0), start_ns=-1), "start_ns is -1"),
    (of_channels(0), "0 channels"),
    (of_channels(4097), "4097 channels"),
    (replace(estimate(0), weight=0.9e-6), "weight is"),
    (replace(estimate(0), weight=1.0000001), "weight is"),
    (replace(estimate(0), start_ns=2, end_ns=1), "lies before"),
    (replace(estimate(0), end_ns=LATEST + 1), "end_ns is"),
    (replace(estimate(0), wind_speed=-1.1e9), "wind_speed is"),
    (replace(estimate(0), channels=()), "modes without a channel"),
    (shown(shape=MODE.shape[:-1]), "shape"),
    (shown(covariance_factor=FACTOR[:-1]), "covariance factor"),
    (shown(covariance_factor=FACTOR[:, 0]), "covariance factor"),
    (shown(n_block_columns=-1), "columns are common"),
    (shown(n_block_columns=FACTOR.shape[1] + 1), "columns are common"),
    *((replace(SCADA, **{each: 1.1e9}), f"{each} is") for each in ("power", "pitch", "yaw")),
    *((replace(SCADA, **{each: -1.1e9}), f"{each} is") for each in ("rotor_speed", "wind_speed")),
    (replace(SCADA, time_ns=-1), "time_ns is"),
    *(
        (replace(DIAGRAM, **{each: np.zeros(3, np.float32)}), f"3 {each} for 2 poles")
        for each in POLES
        if each != "frequencies"
    ),
    (replace(DIAGRAM, end_ns=-1), "end_ns is"),
    (summary(nominal=0.0), "other than 0"),
    (summary(nominal=float("inf")), "finite value"),
    *((summary(**{each: float("nan")}), "no finite") for each in ("median", "p05", "p95")),
    (summary(nominal=1e-300, median=1e300), "no finite quantile"),
    (replace(posterior(0), parameters=posterior(0).parameters[:3]), "instead of"),
    (replace(posterior(0), figures=(replace(SIGMA, median=float("inf")),)), "no finite figures"),
    (replace(posterior(0), correlation=np.eye(4)), "correlation"),
    (replace(posterior(0), draws=np.zeros((2, 3))), "draws"),
    (replace(posterior(0), draws=np.zeros(4)), "draws"),
    (replace(posterior(0), model_frequencies=np.zeros(4)), "for 5 labels"),
    (replace(posterior(0), model_shapes=np.zeros((4, 8))), "for 5 labels"),
    (replace(posterior(0), model_shapes=np.zeros(5)), "for 5 labels"),
    (replace(posterior(0), time_ns=-1), "time_ns is"),
    (replace(POOLED, time_ns=-1), "time_ns is"),
    (replace(POOLED, n_turbines=-1), "n_turbines is"),
    (replace(POOLED, parameters=POOLED.parameters[::-1]), "instead of"),
    (
        replace(
            POOLED, parameters=(replace(SIGMA, name="k11", nominal=0.0), *POOLED.parameters[1:])
        ),
        "other than 0",
    ),
    *((replace(event(), **{each: -1}), each) for each in ("time_ns", "since_ns")),
    (replace(event(), since_latest_ns=event().since_earliest_ns - 1), "lies before"),
    *((replace(GAP, **{each: -1}), each) for each in ("start_ns", "first_sequence", "n_blocks")),
    *((replace(END, **{each: -1}), each) for each in ("time_ns", "n_blocks")),
    (acknowledged(end=3), "are no range"),
    (acknowledged(first=-1), "first is"),
    (acknowledged(earliest_ns=1), "lies before"),
    (replace(acknowledged(), time_ns=-1), "time_ns is"),
    (replace(rejection(0), start_ns=-1), "start_ns is"),
    (replace(status("recorder"), time_ns=-1), "time_ns is"),
    (FoundationTruth("t1", LATEST + 1, 1.0, 2.0, 3.0), "time_ns is"),
]


@pytest.mark.parametrize("message", TAKEN, ids=lambda each: type(each).__name__)
def test_a_message_at_its_limits_is_let_in(message: Message) -> None:
    check(message)


@pytest.mark.parametrize(
    ("message", "reason"), REFUSED, ids=lambda each: each if isinstance(each, str) else ""
)
def test_a_message_beyond_a_limit_is_refused_by_the_field(message: Message, reason: str) -> None:
    with pytest.raises(CodecError, match=reason):
        check(message)
