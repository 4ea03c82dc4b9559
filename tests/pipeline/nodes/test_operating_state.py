"""Windows know what the turbine was doing."""

from dataclasses import replace
from math import nan

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.nodes.operating_state import CHANGING, OperationLog, OperationSettings
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError
from tests.pipeline.example_estimates import estimate
from tests.pipeline.example_messages import START_NS


def sample(second: float, state: str = "parked", yaw: float = 0.0) -> ScadaSample:
    time_ns = START_NS + round(second * NANOSECONDS)
    return ScadaSample("t1", time_ns, state, 8.0 + second / 100, 0.0, 90.0, yaw, 0.0, 0.5)


def with_conditions(*samples: ScadaSample, number: int = 0) -> ModalEstimate:
    log = OperationLog()
    for each in samples:
        log.note(each)
    return log.with_conditions(estimate(number=number))


def test_a_window_carries_the_state_that_held_during_all_of_it() -> None:
    told = with_conditions(*(sample(second) for second in range(0, 600, 10)))
    assert told.operating_state == "parked"
    assert told.wind_speed == pytest.approx(8.0 + 2.95)
    assert told.water_level == 0.5


def test_a_state_holds_until_the_next_sample() -> None:
    told = with_conditions(sample(-300.0, "idling"), number=3)
    assert told.operating_state == "idling"


def test_of_earlier_reports_the_latest_holds() -> None:
    told = with_conditions(sample(-900.0, "start"), sample(-300.0, "idling"))
    assert told.operating_state == "idling"


def test_what_a_controller_that_fell_silent_said_last_does_not_hold_for_ever() -> None:
    last = sample(-3600.0, yaw=40.0)
    assert with_conditions(last).operating_state == "parked"
    silent = with_conditions(replace(last, time_ns=last.time_ns - NANOSECONDS))
    assert silent.operating_state == ""
    assert np.isnan([silent.yaw, silent.water_level]).all()


def test_a_tide_gauge_beside_the_controller_changes_no_state_and_hides_none() -> None:
    """Two feeds of one turbine, each of which knows some of the quantities."""
    gauge = replace(sample(0), state="", wind_speed=nan, rotor_speed=nan, yaw=nan, water_level=1.5)
    controller = replace(sample(-300.0, yaw=10.0), water_level=nan)
    levels = [replace(gauge, time_ns=START_NS + k * 60 * NANOSECONDS) for k in range(-2, 10)]
    told = with_conditions(controller, *levels)
    assert told.operating_state == "parked"
    assert told.yaw == pytest.approx(10.0)
    assert told.water_level == 1.5
    assert told.wind_speed == controller.wind_speed


def test_a_state_that_is_unknown_for_a_moment_is_left_out() -> None:
    samples = [sample(second) for second in range(0, 600, 10)]
    samples[30] = replace(samples[30], state="")
    assert with_conditions(*samples).operating_state == "parked"


def test_a_window_in_which_the_state_or_the_yaw_changes_is_changing() -> None:
    assert with_conditions(sample(0), sample(300, "start")).operating_state == CHANGING
    assert with_conditions(sample(0), sample(300, yaw=15.0)).operating_state == CHANGING
    assert with_conditions(sample(0), sample(300, yaw=1.9)).operating_state == "parked"
    assert with_conditions(sample(0), sample(300, yaw=2.1)).operating_state == CHANGING


@pytest.mark.parametrize("towards", [0.0, 45.0, 180.0, -90.0])
def test_a_nacelle_that_stands_towards_any_direction_is_steady(towards: float) -> None:
    """Controllers report 0 to 360: towards north, 359.8 and 0.2 are close."""
    yaws = [towards + 0.2 * (-1) ** number for number in range(60)]
    yaws = yaws if towards < 0 else [yaw % 360 for yaw in yaws]
    found = with_conditions(*(sample(10 * number, yaw=yaw) for number, yaw in enumerate(yaws)))
    assert found.operating_state == "parked"
    assert found.yaw == pytest.approx(towards, abs=1e-6)
    turning = with_conditions(sample(0, yaw=359.0), sample(300, yaw=1.5))
    assert turning.operating_state == CHANGING


def test_what_a_controller_did_not_know_for_a_moment_is_left_out_of_a_windows_means() -> None:
    samples = [sample(second, yaw=359.0 + second / 300) for second in range(0, 600, 10)]
    unknown = replace(samples[30], wind_speed=nan, rotor_speed=nan, yaw=nan, water_level=nan)
    told = with_conditions(*samples[:30], unknown, *samples[31:])
    assert told.operating_state == "parked"
    assert told.wind_speed == pytest.approx(np.mean([8.0 + i / 10 for i in range(60) if i != 30]))
    assert told.rotor_speed == 0.0
    assert told.water_level == 0.5
    assert told.yaw == pytest.approx(359.0 + (295 - 5 / 59) / 300, abs=1e-3)
    never = with_conditions(*(replace(unknown, time_ns=each.time_ns) for each in samples))
    assert np.isnan([never.wind_speed, never.rotor_speed, never.yaw, never.water_level]).all()
    assert never.operating_state == "parked"


def test_a_turbine_without_a_controllers_stream_has_windows_of_unknown_state() -> None:
    told = with_conditions()
    assert told.operating_state == ""
    assert np.isnan(told.yaw)


def test_a_state_that_there_is_not_is_refused() -> None:
    with pytest.raises(InputError, match="allowed_states has 'asleep'"):
        OperationSettings(("asleep",))
