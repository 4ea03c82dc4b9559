"""What changes with time: weather and operation between stages, tide, foundation."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sensors.loads import LoadError, Sea, Wind
from sensors.loads.operating_states import RATED_SPEED, steady_state
from sensors.simulation.loads_over_time import build_loads, build_schedule
from sensors.simulation.schedule import (
    FoundationSchedule,
    Schedule,
    ScheduleError,
    ScheduleStep,
    StiffnessEvent,
    Tide,
    scada_samples,
)
from sensors.simulation.settings import SimulationError, SimulationSettings
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine

STAGES = (
    ScheduleStep(at=0.0, state="parked", wind_speed=6.0),
    ScheduleStep(at=100.0, state="start", wind_speed=10.0, yaw=0.0),
    ScheduleStep(at=160.0, state="operating"),
    ScheduleStep(at=300.0, state="stop"),
    ScheduleStep(at=330.0, state="idling", wind_speed=8.0, yaw=20.0),
)


def test_weather_runs_straight_from_step_to_step_that_gives_it() -> None:
    schedule = Schedule(stages=STAGES)
    winds = [schedule.figure("wind_speed", time) for time in (-50.0, 50.0, 100.0, 215.0, 900.0)]
    assert winds == pytest.approx([6.0, 8.0, 10.0, 9.0, 8.0])


def test_the_state_holds_until_the_next_one() -> None:
    schedule = Schedule(stages=STAGES)
    states = [schedule.state(time) for time in (-1.0, 99.0, 100.0, 200.0, 310.0, 400.0)]
    assert states == ["parked", "parked", "start", "operating", "stop", "idling"]


def test_a_rotor_gathers_speed_in_a_start_and_loses_it_in_a_stop() -> None:
    schedule = Schedule(stages=STAGES)
    shares = [schedule.running_share(time) for time in (0.0, 130.0, 200.0, 315.0, 400.0)]
    assert shares == pytest.approx([0.0, 0.5, 1.0, 0.5, 0.0])
    assert schedule.rotor(50.0).rotor_speed == 0.0
    assert 0 < schedule.rotor(400.0).rotor_speed < 1.0


def test_a_turbine_at_rated_wind_turns_at_rated_speed_and_gives_its_power() -> None:
    steady = steady_state(12.0, share=1.0)
    assert (steady.rotor_speed, steady.power) == pytest.approx((RATED_SPEED, 15e6))
    assert steady_state(12.0, share=0.0).pitch == 90.0


def test_scour_takes_its_share_at_once_and_for_good() -> None:
    foundation = FoundationSchedule(events=(StiffnessEvent(100.0, (1.0, 0.9, 1.0)),))
    assert foundation.factors(99.9) == pytest.approx([1.0, 1.0, 1.0])
    assert foundation.factors(100.0) == pytest.approx([1.0, 0.9, 1.0])
    assert foundation.factors(1e6) == pytest.approx([1.0, 0.9, 1.0])


def test_a_drift_is_that_of_the_days_gone_by() -> None:
    foundation = FoundationSchedule(drift_per_day=(0.01, -0.02, 0.0))
    assert foundation.factors(43_200.0) == pytest.approx([1.005, 0.99, 1.0])


def test_soil_that_moves_more_is_softer() -> None:
    foundation = FoundationSchedule(softening=0.1, softening_displacement=0.02)
    assert foundation.factors(0.0, motion=0.01) == pytest.approx([0.95] * 3)
    assert foundation.factors(0.0, motion=1.0) == pytest.approx([0.9] * 3)


def test_the_foundation_rides_with_the_tide() -> None:
    schedule = Schedule(tide=Tide(amplitude=1.5, period=400.0, stiffness_share=0.02))
    assert schedule.level(100.0) == pytest.approx(1.5)
    assert schedule.stiffness_factors(100.0) == pytest.approx([1.02] * 3)
    assert schedule.level(300.0) == pytest.approx(-1.5)
    assert schedule.highest_level == 1.5


def test_scada_reports_what_the_schedule_does() -> None:
    schedule = Schedule(stages=STAGES, tide=Tide(amplitude=1.0, period=400.0))
    samples = list(
        scada_samples(schedule, turbine="t", start_ns=10**18, period=10.0, duration=400.0)
    )
    assert len(samples) == 40
    assert [sample.time_ns - 10**18 for sample in samples[:2]] == [0, 10**10]
    assert samples[20].state == "operating"
    assert samples[20].rotor_speed > 5.0
    assert samples[10].water_level == pytest.approx(1.0)
    assert samples[-1].yaw == 20.0


def test_steps_come_in_order_of_time() -> None:
    with pytest.raises(ScheduleError, match="stage at 5 s comes after the one at 9 s"):
        Schedule(stages=(ScheduleStep(at=9.0), ScheduleStep(at=5.0)))


def test_a_step_without_wind_is_refused() -> None:
    with pytest.raises(ScheduleError, match="wind_speed is 0"):
        ScheduleStep(wind_speed=0.0)


@pytest.mark.parametrize(
    ("weather", "line"),
    [
        ({"significant_wave_height": -4.0}, "height is -4 m; it must be 0 or more"),
        ({"peak_period": 0.0}, "peak_period is 0 s; it must be positive"),
        ({"peak_period": 1.0}, "peak_period is 1 s; .* longer than 1.67 s"),
    ],
)
def test_a_step_has_the_limits_of_the_sea_itself(weather: dict[str, float], line: str) -> None:
    for owner in (Sea, partial(ScheduleStep, 60.0)):
        with pytest.raises(LoadError, match=line):
            owner(**weather)
    ScheduleStep(significant_wave_height=0.0, peak_period=1.7)


@pytest.mark.parametrize(
    ("weather", "section"),
    [("wind_speed", "wind"), ("significant_wave_height", "sea"), ("peak_period", "sea")],
)
def test_weather_of_a_step_that_no_load_makes_is_refused(weather: str, section: str) -> None:
    """SCADA would report a wind that nothing feels."""
    stages = (ScheduleStep(), ScheduleStep(at=60.0, **{weather: 9.0}))
    both = {"wind": Wind(), "sea": Sea()}
    without = {name: load for name, load in both.items() if name != section}
    SimulationSettings(stages=stages, **both)
    line = rf"stage at 60 s has {weather} 9, which needs \[simulation.{section}\]"
    with pytest.raises(SimulationError, match=line):
        SimulationSettings(stages=stages, **without)


def test_a_stiffness_that_is_not_positive_is_refused() -> None:
    with pytest.raises(ScheduleError, match="factors are 1, 0, 1"):
        StiffnessEvent(0.0, (1.0, 0.0, 1.0))


def test_factors_do_not_depend_on_the_order_of_events_after_both() -> None:
    events = (StiffnessEvent(1.0, (0.9, 1, 1)), StiffnessEvent(2.0, (0.8, 1, 1)))
    forward = FoundationSchedule(events=events).factors(3.0)
    np.testing.assert_allclose(forward, FoundationSchedule(events=events[::-1]).factors(3.0))


def test_the_wind_of_the_settings_blows_where_no_step_gives_one() -> None:
    settings = SimulationSettings(wind=Wind(speed=9.0))
    description = load_turbine("iea15mw_monopile")
    assert build_schedule(settings, description).figure("wind_speed", 60.0) == 9.0


def test_every_load_begins_a_transient_before_the_record() -> None:
    """At time 0 the tower moves as if the weather had always been there."""
    description = load_turbine("iea15mw_monopile")
    settings = SimulationSettings(wind=Wind(), sea=Sea(), transient=25.0, stages=STAGES)
    model, schedule = assemble(description), build_schedule(settings, description)
    loads = build_loads(model, settings, schedule, rate=10.0)
    starts = [load.start for load in loads if hasattr(load, "start")]
    assert starts == [-25.0] * 3  # waves, wind, rotor


def test_limits_of_settings_are_themselves_allowed() -> None:
    SimulationSettings(seed=0, transient=0.0, noise_share=0.0, quantisation_step=0.0)
    with pytest.raises(SimulationError, match="seed is -1"):
        SimulationSettings(seed=-1)


def test_a_tower_on_land_has_the_level_0_and_one_in_water_its_own() -> None:
    offshore = load_turbine("iea15mw_monopile")
    settings = SimulationSettings(duration=600.0)
    assert build_schedule(settings, replace(offshore, water=None)).mean_level == 0.0
    assert offshore.water is not None
    assert build_schedule(settings, offshore).mean_level == offshore.water.level
