"""Height, axis and kind of a channel, read from the names that loggers and people give."""

import numpy as np
import pytest

from sensors.acquisition.layout import FORE_AFT, SIDE_SIDE
from sensors.errors import InputError
from sensors.files.channel_names import (
    guess_channels,
    other_quantity,
    parallel_channels,
    placed,
    split_motions,
)
from sensors.files.table import ChannelTable

X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


@pytest.mark.parametrize(
    ("name", "elevation", "direction"),
    [
        ("LAT097_FA", 97.0, X),
        ("z145-ss", 145.0, Y),
        ("acc 44.1m x", 44.1, X),
        ("H_12.5_Y", 12.5, Y),
        ("TOWER_80_SideSide", 80.0, Y),
        ("acc 97m fore-aft", 97.0, X),
        ("acc 97m side-side", 97.0, Y),
        ("97m_fore_aft", 97.0, X),
        ("Side-to-side 97 m", 97.0, Y),
        ("TowerForeAft_97m", 97.0, X),
        ("ACC_T3_67,5m_X", 67.5, X),
        ("Acc_85000mm_SS", 85.0, Y),
        ("ACC 8500 cm Z", 85.0, Z),
        ("z85000_fa", 85.0, X),
        ("AccX_L25", 25.0, X),
        ("ACCY_85m", 85.0, Y),
        ("Level 25 m, Y-dir", 25.0, Y),
        ("acc_45m_V", 45.0, Z),
        ("45 m längs", 45.0, X),
        ("Turm 45m Quer", 45.0, Y),
        ("Beschl. 45 m vertikal", 45.0, Z),
        ("Acc_16m5_FA", 16.5, X),
        ("TWR 8m5 Y", 8.5, Y),
    ],
)
def test_height_and_axis_are_read_from_a_channels_name(
    name: str, elevation: float, direction: tuple[int, int, int]
) -> None:
    (guessed,) = guess_channels([name])
    assert (guessed.elevation, guessed.direction) == (elevation, direction)
    assert guessed.height_known
    assert guessed.direction_known


@pytest.mark.parametrize(
    ("name", "degrees"),
    [
        ("85_NS", 0),
        ("V_45m_N-S", 0),
        ("V_45m_O-W", 90),  # Ost
        ("Vel 45m E/W", 90),
        ("45 m Ost", 90),
        ("A24_N", 0),
        ("A24_W", 270),
        ("A24_S", 180),
        ("XX.T25..HNE", 90),
        ("XX.T25..HNN", 0),
        ("Ch_1 24.3m N30E", 30),
        ("Ch_2 24.3m N120E", 120),
        ("A24_N24E", 24),
        ("24 m S 30 W", 210),
        ("24 m S30E", 150),
        ("24 m N30W", -30),
        ("LAT024_030deg", 30),
        ("24m 120°", 120),
    ],
)
def test_a_compass_direction_is_a_guess_with_x_as_north(name: str, degrees: float) -> None:
    (guessed,) = guess_channels([name])
    angle = np.radians(degrees)
    assert guessed.direction == pytest.approx((np.cos(angle), -np.sin(angle), 0.0), abs=1e-6)
    assert guessed.is_compass
    assert not guessed.direction_known
    assert f"{degrees}° from north by " in guessed.reason


def test_a_bearing_is_no_height_and_no_place() -> None:
    guessed = guess_channels(["Ch1 N030E", "Ch1 N120E", "Ch2 N030E", "Ch2 N120E"])
    assert [each.elevation for each in guessed] == [1, 1, 2, 2]
    assert not any(each.height_known for each in guessed)


def test_an_axis_of_the_tower_is_taken_before_a_compass_letter() -> None:
    (guessed,) = guess_channels(["E_24m_x"])
    assert guessed.direction == X
    assert guessed.direction_known
    (sensor,) = guess_channels(["S1_24m"])
    assert not sensor.is_compass


@pytest.mark.parametrize(
    ("name", "direction"),
    [
        ("acc_-y+24.3", (0, -1, 0)),
        ("24 m -FA", (-1, 0, 0)),
        ("24m_Y-", (0, -1, 0)),
        ("acc_24-y", Y),
        ("acc_y-24", Y),
        ("24 m (top)-y", Y),
        ("z24-ss", Y),
    ],
)
def test_a_minus_is_kept_and_a_hyphen_is_none(name: str, direction: tuple[int, int, int]) -> None:
    (guessed,) = guess_channels([name])
    assert guessed.direction == direction
    assert guessed.reason.startswith("24")
    assert ("against " in guessed.reason) is (min(direction) < 0)


def test_channels_along_one_axis_at_one_height_are_found() -> None:
    names = ["24m X a", "24m -X b", "24m Y", "45m X", "45m Y"]
    assert parallel_channels(guess_channels(names)) == [("24m X a", "24m -X b")]
    assert parallel_channels(guess_channels(["24m N30E", "24m N120E"])) == []


def test_a_leading_v_is_a_velocity_and_no_axis() -> None:
    assert not any(each.direction_known for each in guess_channels(["V_20m", "V_45m"]))


@pytest.mark.parametrize("name", ["ch1", "channel 7", "AI0"])
def test_a_number_that_only_counts_is_no_height(name: str) -> None:
    guessed = guess_channels(["a", "b", name])[-1]
    assert not guessed.height_known
    assert guessed.elevation == 3.0
    assert "not in the name" in guessed.reason


@pytest.mark.parametrize("letter", ["y", "x", "z"])
def test_the_letter_of_a_matrix_is_no_axis(letter: str) -> None:
    assert not any(each.direction_known for each in guess_channels([f"{letter}1", f"{letter}2"]))
    heights = guess_channels([f"{letter}_15m", f"{letter}_85m"])
    assert all(each.direction_known for each in heights)


def test_channels_that_differ_in_the_axis_alone_are_at_one_place() -> None:
    guessed = guess_channels(["top FA", "top SS", "mid FA", "mid SS", "mid V", "hub"])
    assert [each.elevation for each in guessed] == [1, 1, 2, 2, 2, 3]
    assert not any(each.height_known for each in guessed)


def test_an_axis_in_full_is_no_part_of_the_place() -> None:
    guessed = guess_channels(["top side-side", "top fore-aft", "mid side-side", "mid fore-aft"])
    assert [each.elevation for each in guessed] == [1, 1, 2, 2]
    assert [each.direction for each in guessed] == [Y, X, Y, X]


def test_consecutive_numbers_are_sensors_and_no_heights() -> None:
    guessed = guess_channels([f"AI{number}" for number in range(9, 15)])
    assert [each.elevation for each in guessed] == [1, 2, 3, 4, 5, 6]
    assert not any(each.height_known for each in guessed)


def test_the_turbines_number_is_no_height() -> None:
    guessed = guess_channels([f"WTG12_{height}_{axis}" for height in (25, 85) for axis in "XY"])
    assert [each.elevation for each in guessed] == [25, 25, 85, 85]
    guessed = guess_channels(["WTG12_TOP_X", "WTG12_TOP_Y", "WTG12_MID_X", "WTG12_MID_Y"])
    assert not any(each.height_known for each in guessed)


def test_the_axis_of_a_standard_is_known() -> None:
    (guessed,) = guess_channels(["TwHt3ALxt"])
    assert guessed.direction_known
    assert guessed.direction == X


def test_the_z_of_a_height_is_no_vertical_axis() -> None:
    (guessed,) = guess_channels(["z85"])
    assert guessed.elevation == 85.0
    assert not guessed.direction_known


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("WindSpeed", "m/s"),
        ("Wind1VelX", "m/s"),
        ("ROT_SPEED", ""),
        ("RotSpeed", "rpm"),
        ("BldPitch1", "deg"),
        ("Temp_Nacelle", "degC"),
        ("PTemp", "Deg C"),
        ("BattV", "Volts"),
        ("Power", "kW"),
        ("TwrBsMyt", "kN-m"),
        ("Wave1Elev", "m"),
        ("LoadCell", "kN"),
        ("TwrBsMxt", ""),
        ("MudFz", ""),
        ("Sec0mMy", ""),
        ("TwHt1MLxt", ""),
        ("RootMxc1", ""),
        ("thrust_kN", ""),
        ("Biegemoment 12 m", ""),
    ],
)
def test_what_is_no_motion_is_recognised(name: str, unit: str) -> None:
    assert other_quantity(name, unit)


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("LAT097_FA", ""),
        ("YawBrTAxp", "m/s²"),
        ("YawBrTDxt", "m"),
        ("wind_side_acc", "m/s²"),
        ("geophone 3", "m/s"),
        ("SG10_N", "ue"),
        ("rot_x_85m", "rad"),
        ("ch1", "V"),
        ("tilt_85", "deg"),
        ("z145-fa", "m/s²"),
        ("AccTopFx", "m/s²"),
        ("FMx", ""),
        ("z145Fa", ""),
    ],
)
def test_motions_and_what_may_be_one_stay(name: str, unit: str) -> None:
    assert other_quantity(name, unit) == ""


def test_two_channels_of_one_height_without_axes_are_taken_across_each_other() -> None:
    found = guess_channels(["top 92 m a", "top 92 m b", "foot 10 m X"])
    assert [each.direction for each in found] == [FORE_AFT, SIDE_SIDE, FORE_AFT]
    assert found[1].reason.count("taken across the other one at its height") == 1
    assert not found[1].direction_known
    danish = guess_channels(["top 92 m langs", "top 92 m tvaers"])
    assert [each.direction for each in danish] == [FORE_AFT, SIDE_SIDE]
    turned = guess_channels(["top 92 m N90E", "top 92 m b", "foot 10 m -y", "foot 10 m b"])
    assert [each.direction for each in turned] == [(0, -1, 0), X, (0, -1, 0), X]
    half = guess_channels(["top 92 m other", "top 92 m SS", "foot 10 m Z", "foot 10 m a"])
    assert [each.direction for each in half] == [FORE_AFT, SIDE_SIDE, Z, FORE_AFT]
    three = guess_channels(["top 92 m a", "top 92 m b", "top 92 m c"])
    assert [each.direction for each in three] == [FORE_AFT] * 3


@pytest.mark.parametrize(
    ("answer", "elevation", "direction"),
    [
        ("97 fa", 97.0, (1, 0, 0)),
        ("44,1 -ss", 44.1, (0, -1, 0)),
        ("-20.5m, up", -20.5, (0, 0, 1)),
        ("8x", 8.0, (1, 0, 0)),
    ],
)
def test_an_answer_places_a_channel(answer: str, elevation: float, direction: object) -> None:
    (channel,) = guess_channels(["ch1"])
    answered = placed(channel, answer)
    assert answered.known
    assert (answered.elevation, answered.direction) == (elevation, direction)


@pytest.mark.parametrize("answer", ["", "97", "fa", "97 sideways", "97 98 fa"])
def test_an_answer_without_height_or_axis_is_refused(answer: str) -> None:
    (channel,) = guess_channels(["ch1"])
    with pytest.raises(InputError, match="a height in metres and an axis are needed"):
        placed(channel, answer)


def table_of(*units: str) -> ChannelTable:
    samples = np.random.default_rng(1).standard_normal((10, len(units)))
    names = tuple(f"z{20 * (i + 1)}-fa" for i in range(len(units)))
    return ChannelTable(names, units, samples, None)


def test_channels_without_a_scale_are_left_out_beside_channels_that_have_one() -> None:
    columns, left_out = split_motions(table_of("m/s²", "V", "furlong", ""))
    assert columns == [0, 3]
    assert [str(each) for each in left_out] == [
        "z40-fa (in V, beside channels in m/s²)",
        "z60-fa (in furlong, beside channels in m/s²)",
    ]
    assert split_motions(table_of("V", "V")) == ([0, 1], ())


def test_loads_alone_are_used_and_left_out_beside_motions() -> None:
    """Of a file without units; moments at the mudline have harmonics of the waves."""

    def table(*names: str) -> ChannelTable:
        samples = np.random.default_rng(0).standard_normal((10, len(names)))
        return ChannelTable(names, ("",) * len(names), samples, None)

    columns, left_out = split_motions(table("acc1_fa", "acc1_ss", "MudMx", "thrust_kN"))
    assert columns == [0, 1]
    assert [str(each) for each in left_out] == ["MudMx (a load)", "thrust_kN (a load)"]
    assert split_motions(table("MudMx", "MudMy")) == ([0, 1], ())


def test_a_channel_without_a_number_is_not_called_constant() -> None:
    samples = np.random.default_rng(1).standard_normal((50, 3))
    samples[:, 1], samples[:, 2] = np.nan, 0.5
    table = ChannelTable(("x", "y", "z"), ("m/s²",) * 3, samples, None)
    columns, left_out = split_motions(table)
    assert columns == [0]
    assert list(map(str, left_out)) == ["y (no value in any row)", "z (constant)"]


def test_channels_that_are_constant_or_without_a_number_may_be_motions_all_the_same() -> None:
    table = ChannelTable(("x", "y"), ("m/s²",) * 2, np.full((50, 2), [np.nan, 0.5]), None)
    assert split_motions(table) == ([0, 1], ())
