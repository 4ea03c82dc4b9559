"""Which units agree with the joined clock, told from the latest blocks of all of them."""

from collections.abc import Iterator
from typing import Any, cast

import numpy as np
import pytest

from pipeline.nodes.units.acquisition_units import UnitBlock
from pipeline.nodes.units.joined_session import JoinedSession
from pipeline.oma.settings import OmaSettings
from pipeline.oma.window_identification import WindowContext
from pipeline.oma.windows.block_admission import Boot
from pipeline.oma.windows.windowing import Beginning
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout

START_NS, RATE = 1_800_000_000 * NANOSECONDS, 10
CONTEXT = WindowContext(OmaSettings(), cast(Any, None))


def joined(*units: str) -> JoinedSession:
    layouts = [
        SensorLayout(f"of-{unit}", "t", unit, (Accelerometer("z", 20.0 + n, FORE_AFT),))
        for n, unit in enumerate(units)
    ]
    return JoinedSession(layouts, CONTEXT)


def sent(unit: str, second: int, *, lasts: int = 1, stamped: float = 0.0) -> UnitBlock:
    """A unit's block of `lasts` seconds, its stamps off by so much [s]."""
    block = AccelerationBlock(
        turbine="t",
        unit=unit,
        session="s",
        layout_id=f"of-{unit}",
        sequence=second // lasts,
        first_sample=RATE * second,
        start_ns=START_NS + round((second + stamped) * NANOSECONDS),
        sampling_rate=float(RATE),
        samples=np.ones((RATE * lasts, 1), np.float32),
    )
    return UnitBlock(block, Boot("s", 0), Beginning(block.first_sample, block.sequence))


def pushed(session: JoinedSession, blocks: Iterator[UnitBlock] | list[UnitBlock]) -> None:
    for each in blocks:
        list(session.push(each))


def test_a_unit_that_starts_is_held_against_those_that_still_send() -> None:
    """b fell silent two hours before c starts; c's clock is that of a."""
    session, late = joined("a", "b", "c"), 7200
    pushed(session, [sent(unit, second) for second in range(3) for unit in ("a", "b")])
    pushed(session, [sent("a", late), sent("c", late)])
    assert session.state()["out"] == []
    assert not session.has_lost_time


def test_a_unit_that_starts_with_a_clock_of_its_own_is_left_out() -> None:
    session = joined("a", "b", "c")
    pushed(session, [sent(unit, second) for second in range(3) for unit in ("a", "b")])
    pushed(session, [sent("c", 3, stamped=7200.0)])
    assert session.state()["out"] == ["c"]


@pytest.mark.parametrize("lasts", [25, 30])
def test_a_unit_of_long_blocks_still_sends_while_another_one_sends_many(lasts: int) -> None:
    """b's clock steps back by a thousand seconds; a, a block for every thirty of b's, agrees."""
    session = joined("a", "b")
    pushed(session, [sent("a", 0, lasts=lasts), *(sent("b", each) for each in range(lasts))])
    pushed(session, [sent("a", lasts, lasts=lasts)])
    pushed(session, [sent("b", lasts + each, stamped=-1000.0) for each in range(lasts)])
    assert not session.has_lost_time


def test_a_unit_that_was_left_out_and_boots_after_a_restart_is_taken_again() -> None:
    session = joined("a", "b")
    session.resume({"window": 0, "grid": None, "out": ["b"]}, {})
    assert session.state()["out"] == ["b"]
    pushed(session, [sent("b", 0)])
    assert session.state()["out"] == []
