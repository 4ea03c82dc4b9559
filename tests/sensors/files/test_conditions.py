"""Columns of wind, rotor and sea become SCADA samples."""

import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from sensors.files.block_builder import open_file
from sensors.files.channel_names import other_quantity
from sensors.files.conditions import condition_channels, read_conditions, state_of_rotor
from sensors.files.table import TimeColumn, Wanted


def test_fields_are_found_by_name_and_unit() -> None:
    names = ("z85-fa", "WindSpeed", "WindDir", "GenPwr", "RotSpeed", "WaterLevel", "WindSpeed_std")
    units = ("m/s²", "m/s", "deg", "kW", "rpm", "m", "m/s")
    found = condition_channels(names, units)
    assert {field: each.name for field, each in found.items()} == {
        "wind_speed": "WindSpeed",
        "power": "GenPwr",
        "rotor_speed": "RotSpeed",
        "water_level": "WaterLevel",
    }
    assert found["power"].factor == 1e3


@pytest.mark.parametrize(("unit", "factor"), [("W", 1.0), ("kW", 1e3), ("MW", 1e6)])
def test_power_is_in_watts(unit: str, factor: float) -> None:
    assert condition_channels(["GenPwr"], [unit])["power"].factor == factor


@pytest.mark.parametrize(
    "names",
    [
        ("Windgeschwindigkeit", "Drehzahl Rotor", "Leistung", "Wasserstand"),
        ("Windgeschw.", "Drehzahl Rotor", "Leistung", "Pegel"),
        ("Windsnelheid", "Toerental", "Vermogen", "Waterstand"),
        ("Vindhastighed", "Omdrejninger", "Effekt", "Vandstand"),
    ],
)
def test_fields_are_found_in_other_languages_too(names: tuple[str, ...]) -> None:
    found = condition_channels(names, ("m/s", "1/min", "kW", "m"))
    assert set(found) == {"wind_speed", "rotor_speed", "power", "water_level"}
    assert all(other_quantity(name, "") for name in names)


@pytest.mark.parametrize(
    ("names", "rotor"),
    [
        (("gen_rpm", "rotor_rpm"), "rotor_rpm"),
        (("Generator speed RPM", "Rotor speed"), "Rotor speed"),
        (("GenSpeed", "RotSpeed"), "RotSpeed"),
        (("Drehzahl Generator", "Drehzahl Rotor"), "Drehzahl Rotor"),
        (("Generator-Drehzahl", "Drehzahl"), "Drehzahl"),
        (("Toerental generator", "Toerental rotor"), "Toerental rotor"),
        (("Omdrejninger generator", "Rotoromdrejninger"), "Rotoromdrejninger"),
        (("Vitesse génératrice rpm", "Vitesse rotor rpm"), "Vitesse rotor rpm"),
        (("Generador rpm", "Rotor rpm"), "Rotor rpm"),
        (("RPM", "Rotor RPM"), "Rotor RPM"),
        (("Drehzahl", "Rotordrehzahl"), "Rotordrehzahl"),
        (("Fan RPM", "Pump RPM", "Yaw motor rpm", "RPM"), "RPM"),
        (("Rotor azimuth", "Rotor position", "Rotor speed"), "Rotor speed"),
        (("Rotor", "Rotor speed"), "Rotor speed"),
        (("gen_rpm",), None),
        (("Generatordrehzahl", "Drehzahl Generator"), None),
        (("Generator rotor speed",), None),
        (("HSS rpm", "High speed shaft rpm", "Gearbox rpm"), None),
    ],
)
@pytest.mark.parametrize("unit", ["rpm", ""])
def test_a_generators_speed_is_not_the_rotors(
    names: tuple[str, ...], rotor: str | None, unit: str
) -> None:
    for order in (names, names[::-1]):
        found = condition_channels(order, [unit] * len(order)).get("rotor_speed")
        assert (found and found.name) == rotor


def test_of_speeds_that_are_named_alike_the_first_counts() -> None:
    found = condition_channels(("rotor speed 1", "rotor speed 2"), ("rpm", "rpm"))
    assert found["rotor_speed"].name == "rotor speed 1"


@pytest.mark.parametrize("unit", ["1/min", "rpm", "U/min", "min⁻¹", "min^-1", "tr/min", ""])
def test_a_rotor_speed_is_found_in_any_unit_of_turns_a_minute(unit: str) -> None:
    assert set(condition_channels(("Rotordrehzahl",), (unit,))) == {"rotor_speed"}
    assert other_quantity("Rotordrehzahl", unit)


@pytest.mark.parametrize(
    ("yaw", "pitch"),
    [
        ("Gierwinkel", "Blattwinkel"),
        ("Gondelposition", "Pitchwinkel Blatt 1"),
        ("Gierhoek", "Bladhoek"),
        ("Krøjevinkel", "Pitchvinkel"),
        ("Angle de lacet", "Angle de calage"),
    ],
)
def test_angles_of_the_turbine_are_found_in_other_languages(yaw: str, pitch: str) -> None:
    found = condition_channels(("Wind", yaw, pitch), ("m/s", "°", "deg"))
    assert {field: each.name for field, each in found.items()} == {
        "wind_speed": "Wind",
        "yaw": yaw,
        "pitch": pitch,
    }
    assert other_quantity(yaw, "°") == other_quantity(pitch, "") == "an angle of the turbine"


TIMES = np.arange(400) / 20  # [s]


def conditions_of(path: Path, title: str, values: FloatArray) -> list[ScadaSample]:
    """What a file of twenty seconds at 20 Hz tells of one column beside an acceleration."""
    table = np.column_stack([1_700_000_000 + TIMES, np.sin(TIMES), values])
    header = f"time,acc_85m_x,{title}"
    np.savetxt(path, table, delimiter=",", header=header, comments="", fmt="%.3f")
    file, first = open_file(path)
    return list(read_conditions([file], condition_channels(first.names, first.units), "t1"))


def test_samples_are_means_of_ten_seconds_and_the_rest_is_unknown(tmp_path: Path) -> None:
    wind = np.where(TIMES < 10, 4.0, 8.0)
    found = conditions_of(tmp_path / "tower.csv", "WindSpeed [m/s]", wind)
    assert [each.wind_speed for each in found] == [4.0, 8.0]
    assert [each.time_ns for each in found] == [1_700_000_000 * 10**9, 1_700_000_010 * 10**9]
    assert math.isnan(found[0].water_level)
    assert found[0].state == ""


@pytest.mark.parametrize("step", [60, 300, 600])
@pytest.mark.parametrize("night", ["2025-10-25T20:00", "2025-03-29T20:00"])
def test_a_controllers_file_in_local_time_runs_over_the_change_of_its_clock(
    tmp_path: Path, step: int, night: str
) -> None:
    """The level is the hour of UTC: what each sample holds is what was measured then."""
    zone = "Europe/Berlin"
    begin = datetime.fromisoformat(night).replace(tzinfo=UTC)
    moments = [begin + timedelta(seconds=step * i) for i in range(10 * 3600 // step)]
    rows = [f"{each.astimezone(ZoneInfo(zone)):%F %T};{hours(each, begin):.6f}" for each in moments]
    path = tmp_path / "scada.csv"
    path.write_text("\n".join(["time;water level [m]", *rows]) + "\n")
    file, first = open_file(path, None, Wanted(time=TimeColumn(zone=zone)))
    found = list(read_conditions([file], condition_channels(first.names, first.units), "t1"))
    assert [each.time_ns // 10**9 for each in found] == [int(each.timestamp()) for each in moments]
    assert [each.water_level for each in found] == pytest.approx(
        [hours(each, begin) for each in moments], abs=1e-6
    )


@pytest.mark.parametrize(
    ("title", "zone", "day"),
    [
        ("time (UTC)", "", "2025-03-30"),
        ("time", "UTC", "2025-03-30"),
        ("time", "UTC+01:00", "2025-03-30"),
        ("time", "Europe/Berlin", "2025-03-02"),
        ("time", "", "2025-03-02"),
    ],
)
def test_an_hour_that_is_missing_on_a_sunday_night_is_no_summer_time(
    tmp_path: Path, title: str, zone: str, day: str
) -> None:
    begin = datetime.fromisoformat(day)
    moments = [begin + timedelta(minutes=10 * i) for i in range(36) if not 6 <= i < 12]
    rows = [f"{each:%F %T};{hours(each, begin):.6f}" for each in moments]
    path = tmp_path / "scada.csv"
    path.write_text("\n".join([f"{title};water level [m]", *rows]) + "\n")
    file, first = open_file(path, None, Wanted(time=TimeColumn(zone=zone)))
    found = list(read_conditions([file], condition_channels(first.names, first.units), "t1"))
    since = [(each.time_ns - found[0].time_ns) / 3600e9 for each in found]
    assert [each.water_level for each in found] == pytest.approx(since, abs=1e-6)


def hours(moment: datetime, begin: datetime) -> float:
    return (moment - begin).total_seconds() / 3600


def test_a_mean_yaw_towards_north_is_north(tmp_path: Path) -> None:
    yaw = np.where(TIMES < 10, 0.3 * (-1.0) ** np.arange(400) % 360, 200.0)
    found = conditions_of(tmp_path / "tower.csv", "yaw [deg]", yaw)
    assert [each.yaw for each in found] == [0.0, 200.0]


@pytest.mark.parametrize(
    ("speed", "state"),
    [
        (7.5, "operating"),
        (-2.01, "operating"),
        (2.0, "idling"),
        (0.5, "idling"),
        (-0.11, "idling"),
        (0.1, "parked"),
        (0.0, "parked"),
        (math.nan, ""),
    ],  # a parked rotor may creep, an idling one turns once in half a minute
)
def test_the_rotor_speed_states_what_the_turbine_does(speed: float, state: str) -> None:
    assert state_of_rotor(speed) == state
