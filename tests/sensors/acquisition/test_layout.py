"""Which channel is which, when the units of a turbine are taken together."""

from dataclasses import replace

import pytest

from sensors.acquisition.layout import (
    FORE_AFT,
    SIDE_SIDE,
    Accelerometer,
    LayoutError,
    SensorLayout,
    joined_layout,
)

LOWER = SensorLayout(
    "low", "t", "lower", (Accelerometer("x", 10.0, FORE_AFT), Accelerometer("y", 10.0, SIDE_SIDE))
)
UPPER = replace(LOWER, layout_id="up", unit="upper")


def test_units_with_channels_of_their_own_keep_the_names() -> None:
    other = replace(UPPER, channels=(Accelerometer("z", 90.0, FORE_AFT),))
    joined = joined_layout([LOWER, other])
    assert joined.channel_names == ("x", "y", "z")
    assert (joined.layout_id, joined.unit) == ("low+up", "lower+upper")
    assert joined_layout([LOWER]) is LOWER


def test_two_units_of_one_make_are_told_apart_by_their_units_names() -> None:
    joined = joined_layout([LOWER, UPPER])
    assert joined.channel_names == ("lower/x", "lower/y", "upper/x", "upper/y")
    assert [channel.direction for channel in joined.channels] == [FORE_AFT, SIDE_SIDE] * 2


def test_no_choice_of_names_makes_units_that_cannot_be_joined() -> None:
    sly = replace(UPPER, unit="third", channels=(Accelerometer("lower/x", 5.0, FORE_AFT),))
    names = joined_layout([LOWER, UPPER, sly]).channel_names
    assert names[-1] == "third/lower/x"
    assert len(set(names)) == 5


def test_a_name_that_appears_twice_among_many_is_found() -> None:
    channels = [Accelerometer(f"x{n}", 10.0, FORE_AFT) for n in range(50_000)]
    assert len(SensorLayout("many", "t", "u", tuple(channels)).channels) == 50_000
    with pytest.raises(LayoutError, match="'x7' appears more than once"):
        SensorLayout("many", "t", "u", (*channels, channels[7]))
