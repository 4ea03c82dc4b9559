"""Which channel is which, when the units of a turbine are taken together."""

from dataclasses import replace
from typing import Any

import pytest

from sensors.acquisition.layout import (
    FORE_AFT,
    SIDE_SIDE,
    Accelerometer,
    LayoutDifference,
    LayoutError,
    SensorLayout,
    biaxial_layout,
    joined_layout,
    layout_difference,
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


def test_the_first_difference_of_two_layouts_is_a_channel_and_what_each_says_of_it() -> None:
    layout = biaxial_layout("a", turbine="t", unit="tower", elevations=(41.0, 80.0))
    first, *others = layout.channels

    def changed(**values: Any) -> LayoutDifference | None:
        other = replace(layout, channels=(replace(first, **values), *others))
        return layout_difference(layout, other)

    ac = {"coupling": "ac", "corner_frequency": 0.05}
    assert changed() is None
    assert changed(serial="other", corner_frequency=0.05) is None  # of a DC-coupled one
    assert changed(elevation=30.0) == LayoutDifference("z41-fa", "is at 41 m", "is at 30 m")
    assert changed(direction=(-1.0, 0.0, 0.0)) == LayoutDifference(
        "z41-fa", "points along [1.0, 0.0, 0.0]", "points along [-1.0, 0.0, 0.0]"
    )
    assert changed(**ac) == LayoutDifference(
        "z41-fa", "is DC-coupled", "is AC-coupled above 0.05 Hz"
    )
    assert changed(name="new") == LayoutDifference("z41-fa", "is there", "is not")
    assert layout_difference(layout, replace(layout, channels=tuple(others))) is None
