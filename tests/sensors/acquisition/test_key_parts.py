"""A name that becomes part of a key is one that whoever listens to all turbines receives."""

from collections.abc import Callable

import pytest

from pipeline.deploy.access import parse_unit
from pipeline.scenario.settings import TurbineSettings
from sensors.acquisition.key_parts import key_part_error
from sensors.errors import InputError
from sensors.files.layout_file import LayoutFile, MappedChannel
from sensors.simulation.acquisition_units import UnitSettings

CHANNELS = (MappedChannel("ax", 100.0, (1.0, 0.0, 0.0)),)
NAMED: dict[str, Callable[[str], object]] = {
    "turbine of a scenario": lambda name: TurbineSettings(id=name),
    "turbine of a layout": lambda name: LayoutFile(CHANNELS, name),
    "unit of a layout": lambda name: LayoutFile(CHANNELS, "t1", name),
    "unit of a simulation": lambda name: UnitSettings(name, (100.0,)),
    "turbine of --unit": lambda name: parse_unit(f"{name}/tower"),
    "unit of --unit": lambda name: parse_unit(f"t1/{name}"),
}


@pytest.mark.parametrize("what", NAMED)
@pytest.mark.parametrize("name", ["@t1", "", "t 1", "a*", "a$", "a#", "a?"])
def test_a_name_that_wildcards_do_not_match_is_one_line(what: str, name: str) -> None:
    with pytest.raises(InputError) as refused:
        NAMED[what](name)
    assert "\n" not in str(refused.value)
    assert repr(name)[1:-1] in str(refused.value)


@pytest.mark.parametrize("what", NAMED)
def test_a_name_may_have_an_at_sign_elsewhere(what: str) -> None:
    assert NAMED[what]("t1@north")


def test_what_is_wrong_is_named() -> None:
    assert "a name does not begin with @" in key_part_error("@t1")
    assert key_part_error("t1") == ""
