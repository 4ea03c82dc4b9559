"""Sensor time goes by as fast as asked, on an absolute schedule."""

import math

import pytest

from sensors.acquisition.pacing import Pace, paced
from sensors.errors import InputError

SECOND = 10**9  # [ns]
START_NS = 1_700_000_000 * SECOND


class SteppingClock:
    """A clock that only moves when somebody waits or works."""

    def __init__(self) -> None:
        self.time = 100.0
        self.waits: list[float] = []

    def now(self) -> float:
        return self.time

    def wait(self, seconds: float) -> None:
        self.waits.append(seconds)
        self.time += seconds

    def work(self, seconds: float) -> None:
        self.time += seconds


def times_of_arrival(sensor_times: list[int], speed: float, work: float = 0.0) -> list[float]:
    clock = SteppingClock()
    arrived = []
    for _ in paced(
        [START_NS + t for t in sensor_times], pace=Pace(speed, clock), time_of=lambda t: t
    ):
        arrived.append(clock.time - 100.0)
        clock.work(work)
    return arrived


def test_real_time_takes_as_long_as_the_recording() -> None:
    assert times_of_arrival([0, SECOND, 2 * SECOND], 1.0) == pytest.approx([0, 1, 2])


def test_ten_times_faster_takes_a_tenth() -> None:
    assert times_of_arrival([0, SECOND, 2 * SECOND], 10.0) == pytest.approx([0, 0.1, 0.2])


def test_a_gap_takes_its_time() -> None:
    assert times_of_arrival([0, 60 * SECOND], 1.0) == pytest.approx([0, 60])


def test_work_between_blocks_does_not_delay_the_following_ones() -> None:
    hour = [second * SECOND for second in range(3600)]
    assert times_of_arrival(hour, 1.0, work=0.9)[-1] == pytest.approx(3599)


def test_what_is_late_is_followed_by_what_is_due() -> None:
    clock = SteppingClock()
    pace = Pace(1.0, clock)
    pace.wait_until(START_NS)
    clock.work(5.0)
    pace.wait_until(START_NS + 3 * SECOND)
    assert clock.waits == []
    pace.wait_until(START_NS + 6 * SECOND)
    assert clock.waits == pytest.approx([1.0])


def test_a_block_from_the_past_is_given_at_once() -> None:
    assert times_of_arrival([5 * SECOND, 0, 6 * SECOND], 1.0) == pytest.approx([0, 0, 1])


def test_at_once_never_waits() -> None:
    assert times_of_arrival([0, 3600 * SECOND], math.inf) == [0, 0]


def test_what_has_no_time_is_given_at_once() -> None:
    clock = SteppingClock()
    assert list(paced(["layout"], pace=Pace(1.0, clock), time_of=lambda _: None)) == ["layout"]
    assert clock.waits == []


@pytest.mark.parametrize("speed", [0.0, -1.0, math.nan])
def test_time_cannot_stand_still_or_run_backwards(speed: float) -> None:
    with pytest.raises(InputError, match=f"speed is {speed:g}"):
        Pace(speed, SteppingClock())
