"""Each fault does what it says, while it lasts, to its channel, and nothing else.

blocks   0 1 2 3 4 5 6 7 8 9      one second each, three channels
fault          |— — —|            from 3 s to 6 s
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.layout import Accelerometer, SensorLayout
from sensors.simulation.acquisition_units import UnitSettings
from sensors.simulation.faults import Fault, FaultError, require_known, with_faults

NAMES = ("a", "b", "c")
LAYOUT = SensorLayout("l", "t", "u", tuple(Accelerometer(n, 0.0, (1.0, 0.0, 0.0)) for n in NAMES))
RATE = 20


def healthy(n_blocks: int = 10, per_block: int = RATE) -> Iterator[AccelerationBlock]:
    samples = np.random.default_rng(3).normal(size=(n_blocks * RATE, 3)).astype(np.float32)
    for sequence, first in enumerate(range(0, len(samples), per_block)):
        start_ns = round(first / RATE * NANOSECONDS)
        part = samples[first : first + per_block]
        yield AccelerationBlock("t", "u", "s", "l", sequence, first, start_ns, float(RATE), part)


def arrived(*faults: Fault, per_block: int = RATE) -> list[AccelerationBlock]:
    rng = np.random.default_rng(1)
    return list(with_faults(healthy(per_block=per_block), faults, [LAYOUT], rng=rng))


def samples_of(blocks: list[AccelerationBlock]) -> np.ndarray:
    return np.concatenate([block.samples for block in blocks])


def faulty(kind: str, **more: object) -> Fault:
    return Fault(kind, start=3.0, duration=3.0, **more)


BEFORE, WHILE, AFTER = slice(0, 60), slice(60, 120), slice(120, 200)


@pytest.mark.parametrize("per_block", [1, 7, 20])
@pytest.mark.parametrize(
    "fault",
    [
        faulty("dead", channel="b"),
        faulty("stuck", channel="b"),
        faulty("clipped", channel="b", size=0.3),
        faulty("nan", channel="b"),
        faulty("spikes", channel="b", size=9.0),
        faulty("drift", channel="b", size=100.0),
        faulty("duplicate", channel="b", other="a"),
    ],
    ids=lambda fault: fault.kind,
)
def test_a_fault_spoils_its_channel_while_it_lasts_whatever_the_blocks(
    fault: Fault, per_block: int
) -> None:
    sound, spoilt = samples_of(list(healthy())), samples_of(arrived(fault, per_block=per_block))
    np.testing.assert_array_equal(spoilt[BEFORE], sound[BEFORE])
    np.testing.assert_array_equal(spoilt[AFTER], sound[AFTER])
    np.testing.assert_array_equal(spoilt[WHILE, (0, 2)], sound[WHILE, (0, 2)])
    assert not np.array_equal(spoilt[WHILE, 1], sound[WHILE, 1])
    np.testing.assert_array_equal(spoilt, samples_of(arrived(fault)))


def test_each_fault_of_a_channel_does_what_it_says() -> None:
    sound = samples_of(list(healthy()))

    def spoilt(kind: str, **more: object) -> np.ndarray:
        return samples_of(arrived(faulty(kind, **more)))[WHILE]

    assert not spoilt("dead", channel="b")[:, 1].any()
    assert set(spoilt("stuck", channel="b")[:, 1]) == {sound[60, 1]}
    assert np.abs(spoilt("clipped", channel="b", size=0.5)[:, 1]).max() == 0.5
    assert np.isnan(spoilt("nan", channel="b")[:, 1]).sum() == 3  # one a second
    swapped = spoilt("swapped", channel="a", other="c")
    np.testing.assert_array_equal(swapped, sound[WHILE][:, [2, 1, 0]])
    drift = spoilt("drift", channel="c", size=3600.0)[:, 2] - sound[WHILE, 2]
    np.testing.assert_allclose(drift, np.arange(60) / RATE, atol=1e-5)


def test_what_a_unit_knows_of_itself_it_reports() -> None:
    for kind, status in (
        ("faulty", BlockStatus.SENSOR_FAULT),
        ("unsynchronised", BlockStatus.CLOCK_UNSYNCHRONISED),
    ):
        statuses = [block.status for block in arrived(faulty(kind))]
        assert statuses == [BlockStatus.OK] * 3 + [status] * 3 + [BlockStatus.OK] * 4


@pytest.mark.parametrize(
    ("fault", "order"),
    [
        (faulty("dropped"), [0, 1, 2, 6, 7, 8, 9]),
        (faulty("repeated"), [0, 1, 2, 3, 3, 4, 4, 5, 5, 6, 7, 8, 9]),
        (faulty("late", size=2.0), [0, 1, 2, 3, 6, 4, 7, 5, 8, 9]),
        (Fault("out-of-order", start=4.0, duration=4.0), [0, 1, 2, 3, 5, 4, 7, 6, 8, 9]),
    ],
    ids=lambda value: getattr(value, "kind", ""),
)
def test_the_link_brings_blocks_in_the_order_of_its_fault(fault: Fault, order: list[int]) -> None:
    sequences = [block.sequence for block in arrived(fault)]
    if fault.kind == "late":  # equal times of arrival: the older block first
        assert sorted(sequences) == list(range(10))
        assert sequences.index(3) > sequences.index(4) or sequences != list(range(10))
    else:
        assert sequences == order


def test_a_fast_clock_runs_ahead_by_its_ppm_and_a_nervous_one_scatters() -> None:
    def off(fault: Fault) -> np.ndarray:
        pairs = zip(arrived(fault), healthy(), strict=True)
        return np.array([ours.start_ns - true.start_ns for ours, true in pairs])

    fast = off(Fault("clock-drift", start=2.0, duration=8.0, size=50.0))
    np.testing.assert_allclose(fast, np.maximum(0, np.arange(10) - 2) * 50_000, atol=1)
    nervous = off(faulty("clock-jitter", size=1e-3))
    assert np.count_nonzero(nervous) == 3
    assert 1e4 < np.abs(nervous[3:6]).max() < 5e6


@given(st.sampled_from([faulty("clock-jitter", size=1e-3), faulty("spikes", channel="a", size=1)]))
def test_the_same_seed_gives_the_same_faults(fault: Fault) -> None:
    ones, others = arrived(fault), arrived(fault)
    assert [one.start_ns for one in ones] == [other.start_ns for other in others]
    np.testing.assert_array_equal(samples_of(ones), samples_of(others))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"kind": "dead"}, "needs the name of a channel"),
        ({"kind": "dropped", "channel": "a"}, "has no channel"),
        ({"kind": "swapped", "channel": "a"}, "swapped and duplicate need one"),
        ({"kind": "clipped", "channel": "a"}, "size is 0"),
        ({"kind": "late", "size": 2.0, "duration": 0.0}, "lasts 0 s"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(wrong: dict[str, object], message: str) -> None:
    sound: dict[str, object] = {"start": 0.0, "duration": 1.0}
    with pytest.raises(FaultError, match=message):
        Fault(**(sound | wrong))


def test_a_fault_on_a_channel_that_is_not_there_is_refused() -> None:
    with pytest.raises(FaultError, match=r"no channel 'z9'; there are a, b, c"):
        require_known((faulty("dead", channel="z9"),), [LAYOUT])
    with pytest.raises(FaultError, match=r"no unit 'v'; there are u"):
        require_known((faulty("dropped", unit="v"),), [LAYOUT])


@pytest.mark.parametrize("kind", ["swapped", "duplicate"])
def test_channels_of_two_units_do_not_meet_in_a_fault(kind: str) -> None:
    low, high = (
        replace(LAYOUT, unit=unit, channels=channels)
        for unit, channels in (("low", LAYOUT.channels[:2]), ("high", LAYOUT.channels[2:]))
    )
    require_known((faulty(kind, channel="a", other="b"),), [low, high])
    line = "channel 'a' is of unit 'low', other 'c' of 'high'; both are of one unit"
    with pytest.raises(FaultError, match=line):
        require_known((faulty(kind, channel="a", other="c"),), [low, high])


def test_a_spike_comes_once_a_minute_and_adds_its_size() -> None:
    fault = Fault("spikes", start=3.0, duration=150.0, channel="b", size=9.0)
    blocks = list(healthy(200))
    spoilt = with_faults(iter(blocks), (fault,), [LAYOUT], rng=np.random.default_rng(1))
    off = samples_of(list(spoilt)) - samples_of(blocks)
    assert (np.flatnonzero(off[:, 1]) / RATE).tolist() == [3.0, 63.0, 123.0]
    assert off[off != 0] == pytest.approx([9.0] * 3, rel=1e-6)


@pytest.mark.parametrize("drift", [0.0, 50_000.0])
def test_a_fault_comes_to_all_units_at_one_time_whenever_they_start(drift: float) -> None:
    """Times count from the session's first sample, not from the unit's own."""
    unit = UnitSettings("u", (0.0,), start=2.0, clock_drift=drift)
    faults = (faulty("dead", channel="b"), Fault("dropped", start=8.0, duration=2.0))
    rng = np.random.default_rng(1)
    blocks = list(with_faults(healthy(), faults, [LAYOUT], [unit], rng=rng))
    times = np.concatenate(
        [unit.times(block.first_sample + np.arange(RATE), RATE) for block in blocks]
    )
    dead = samples_of(blocks)[:, 1] == 0
    np.testing.assert_array_equal(dead, (times >= 3.0) & (times < 6.0))
    begins = times[::RATE]
    assert not np.any((begins >= 8.0) & (begins < 10.0))
    assert len(blocks) == 8
