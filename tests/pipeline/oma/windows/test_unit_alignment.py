"""What joining units costs is bounded by the samples that came, whatever a stranger says of time.

unit A   |0|                                       |1|      a day between two sessions
unit B   |0|                                       |1|
joined   |0|      one gap, passed over             |1|
"""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.oma.windows.unit_alignment import (
    BELOW_GRID,
    MOST_SESSIONS,
    RATES_APART,
    UnitJoiner,
    UnitStream,
)
from pipeline.oma.windows.windowing import MissingSamples
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.acquisition.resampling import HALF_LENGTH

RATE = 40.0
LATENESS = 5.0
DAY = 86_400  # [s]
UNITS = ("lower", "upper")
Piece = AccelerationBlock | MissingSamples


def joiner() -> UnitJoiner:
    channels = {unit: (Accelerometer(f"{unit}-x", 40.0, FORE_AFT),) for unit in UNITS}
    layouts = [SensorLayout(unit, "t", unit, channels[unit]) for unit in UNITS]
    return UnitJoiner(layouts, LATENESS)


def block(unit: str, second: int, *, session: str = "s", rate: float = RATE) -> AccelerationBlock:
    """One second's number of samples, all of the value of that second."""
    samples = np.full((round(RATE), 1), second, np.float32)
    start_ns = second * NANOSECONDS
    return AccelerationBlock(
        "t", unit, session, unit, second, round(RATE) * second, start_ns, rate, samples
    )


def given(joined: UnitJoiner, blocks: list[AccelerationBlock]) -> list[Piece]:
    return [piece for each in blocks for piece in joined.push(each, [each])]


def both(second: int, session: str = "s") -> list[AccelerationBlock]:
    return [block(unit, second, session=session) for unit in UNITS]


def seconds(first: int, n: int, session: str = "s") -> list[AccelerationBlock]:
    return [each for second in range(first, first + n) for each in both(second, session)]


def test_a_day_between_two_sessions_is_one_gap_and_no_sample_is_lost() -> None:
    joined = joiner()
    pieces = given(joined, [*seconds(0, 20), *seconds(DAY, 20, "later")])
    pieces += list(joined.finish())
    assert len(pieces) < 60  # and not one a second
    reached = 0
    for piece in pieces:
        assert piece.first_sample == reached
        size = piece.n_samples if isinstance(piece, MissingSamples) else len(piece.samples)
        reached += size
    assert reached == round((DAY + 20) * RATE)
    (day,) = [each for each in pieces if isinstance(each, MissingSamples) and each.n_blocks > 100]
    assert day.end_ns - day.start_ns == pytest.approx(DAY * NANOSECONDS, rel=1e-3)
    heard = [each for each in pieces if isinstance(each, AccelerationBlock)]
    values = np.concatenate([each.samples for each in heard if each.start_ns >= DAY * NANOSECONDS])
    np.testing.assert_array_equal(np.unique(values[:, 0].round()), np.arange(DAY, DAY + 20))


def test_a_unit_covers_a_time_as_soon_as_all_that_a_sample_is_read_from_is_here() -> None:
    stream = UnitStream(block("lower", 0), 1)
    for second in range(30):
        stream.push(block("lower", second))
    last_read = round(30 * RATE) - 1 - HALF_LENGTH
    for forgotten in (0, 25):  # seconds that are let go: it does not depend on what is held
        stream.forget_before(forgotten * NANOSECONDS)
        assert stream.covers(round(last_read / RATE * NANOSECONDS))
        assert not stream.covers(round((last_read + 1) / RATE * NANOSECONDS))


def test_what_is_passed_over_is_what_would_have_been_given_step_by_step(monkeypatch) -> None:
    blocks = [*seconds(0, 20), *seconds(300, 20, "later")]
    passed = given(joiner(), blocks)
    monkeypatch.setattr(UnitJoiner, "_empty_blocks", lambda *_: 0)
    step_by_step = given(joiner(), blocks)
    assert len(passed) < len(step_by_step) - 200
    ours, theirs = (
        [each for each in pieces if isinstance(each, AccelerationBlock)]
        for pieces in (passed, step_by_step)
    )
    for one, other in zip(ours, theirs, strict=True):
        assert (one.sequence, one.first_sample, one.start_ns) == (
            other.sequence,
            other.first_sample,
            other.start_ns,
        )
        np.testing.assert_array_equal(one.samples, other.samples)


def test_a_rate_far_from_the_others_is_refused_before_the_grid_is_settled_and_after() -> None:
    joined = joiner()
    given(joined, [block("lower", 0)])
    assert "0.001 Hz" in joined.refusal(block("upper", 0, rate=1e-3))
    assert joined.refusal(block("upper", 0, rate=RATE / RATES_APART)) == ""
    assert joined.refusal(block("upper", 0, rate=2 * RATE * RATES_APART))
    given(joined, seconds(1, 20))
    assert joined.refusal(block("upper", 30, session="later", rate=RATE / BELOW_GRID)) == ""
    refusal = joined.refusal(block("upper", 30, session="later", rate=10.0))
    assert refusal == (
        "10 Hz, which cannot be joined with the other units' samples: that takes 20 to 4e+03 Hz"
    )


def test_two_units_of_less_than_a_sample_a_second_are_joined_sample_by_sample() -> None:
    joined = joiner()
    slow = [block(unit, 0, rate=0.1) for unit in UNITS]
    pieces = [*given(joined, slow), *joined.finish()]
    samples = np.concatenate([e.samples for e in pieces if isinstance(e, AccelerationBlock)])
    assert samples.shape == (round(RATE), 2)


def test_sessions_that_are_forged_one_a_block_leave_little_behind() -> None:
    joined = joiner()
    given(joined, seconds(0, 20))
    for second in range(20, 400):
        given(joined, [*both(second), block("upper", second + 3000, session=f"forged {second}")])
        given(joined, [block("upper", second, session=f"again {second}")])
    streams = joined._streams
    assert all(len(each) <= MOST_SESSIONS for each in streams.values())
    held = sum(len(stream._samples) for each in streams.values() for stream in each)
    assert held < 100 * RATE


def test_samples_that_the_grid_has_passed_are_not_kept() -> None:
    joined = joiner()
    given(joined, [*seconds(0, 20), *seconds(1000, 20, "later")])
    given(joined, [block("upper", second, session="late") for second in range(100, 900)])
    assert sum(len(stream._samples) for stream in joined._streams["upper"]) < 100 * RATE


def test_stamps_that_stand_still_do_not_change_a_units_rate() -> None:
    joined = joiner()
    still = [
        replace(each, start_ns=(each.start_ns // (40 * NANOSECONDS)) * 40 * NANOSECONDS)
        for each in seconds(0, 39)
    ]
    pieces = given(joined, still) + list(joined.finish())
    assert all(np.isfinite(p.samples).any() for p in pieces if isinstance(p, AccelerationBlock))


def test_one_late_stamp_moves_no_sample() -> None:
    """The line through all stamps says where a sample lies, not the first or the last of them."""
    for late in (0, 29, 59):
        stream = UnitStream(block("lower", 0), 1)
        for k in range(60):
            each = block("lower", k)
            stream.push(replace(each, start_ns=each.start_ns + 20_000_000 * (k == late)))
        position = stream.position_at(59 * NANOSECONDS)
        assert position == pytest.approx(59 * RATE, abs=0.1)  # 20 ms are .8 samples


def test_one_stamp_that_is_late_moves_the_samples_by_its_share_of_all_stamps() -> None:
    """Of 60 stamps the first is 6 ms late: a line through all of them moves by a tenth at most."""
    exact, disturbed = UnitStream(block("lower", 0), 1), UnitStream(block("lower", 0), 1)
    for second in range(60):
        piece = block("lower", second)
        exact.push(piece)
        late = replace(piece, start_ns=piece.start_ns + 6_000_000 * (second == 0))
        disturbed.push(late)
    asked = 30 * NANOSECONDS
    moved = (disturbed.position_at(asked) - exact.position_at(asked)) / RATE
    assert 0 < abs(moved) < 0.6e-3


@pytest.mark.parametrize(("off", "followed"), [(0.009, True), (0.012, False), (-0.2, False)])
def test_a_rate_that_no_converter_has_is_the_stamps_fault(off: float, followed: bool) -> None:
    """A clock that is set, or stamps that stand still: the nominal rate is nearer to the truth."""
    stream = UnitStream(block("lower", 0), 1)
    for k in range(60):
        each = block("lower", k)
        stream.push(replace(each, start_ns=round(k * NANOSECONDS / (1 + off))))
    line = stream._fitted(stream._stamps)
    assert line.rate == pytest.approx(RATE * (1 + off) if followed else RATE)
