"""The generated reference names every key of every file, each with its meaning."""

from pathlib import Path
from types import ModuleType

import pytest

from pipeline.monitoring.alarms.settings import AlarmSettings
from pipeline.scenario import Scenario
from pipeline.updating.structural.settings import KNOWN
from sensors.feeds.payloads.mapping import PayloadMapping
from sensors.files.layout_file import LayoutFile
from sensors.structure.description import TurbineDescription

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    ("settings", "page", "fewest"),
    [
        (Scenario, "scenario", 110),
        (TurbineDescription, "description", 40),
        (LayoutFile, "layout", 12),
        (AlarmSettings, "notices", 30),
        (PayloadMapping, "mapping", 18),
    ],
)
def test_every_key_is_named_with_its_meaning(
    reference: ModuleType, settings: type, page: str, fewest: int
) -> None:
    text = reference.pages()[f"reference/{page}.md"]
    named, without = 0, []
    for section, kind in reference.sections(settings, ""):
        meanings = reference.field_meanings(kind)
        for key in reference.keys(kind):
            assert f"| `{key.name}` |" in text, (section, key.name)
            named += 1
            if not meanings.get(key.name):
                without.append((section, key.name))
    assert without == []
    assert named >= fewest


def test_every_figure_of_the_structure_is_named(reference: ModuleType) -> None:
    text = reference.structure_keys()
    assert [name for name in KNOWN if f"| `{name}` |" not in text] == []


def test_every_command_is_named_with_its_options(reference: ModuleType) -> None:
    text = reference.commands()
    assert "## pilewatch identify" in text
    assert "`--lowest-frequency`" in text
