"""The generated reference names every key of every file, each with its meaning."""

from pathlib import Path
from types import ModuleType

import pytest

from pipeline.export.results import RESULT_TABLES
from pipeline.monitoring.alarms.settings import AlarmSettings
from pipeline.scenario import Scenario
from pipeline.updating.structural.settings import KNOWN
from sensors.feeds.payloads.mapping import PayloadMapping
from sensors.files.layout_file import LayoutFile
from sensors.structure.description import TurbineDescription

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def pages(reference: ModuleType) -> dict[str, str]:
    """Every page of reference by its name."""
    return dict(reference.pages())


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
    reference: ModuleType, pages: dict[str, str], settings: type, page: str, fewest: int
) -> None:
    text = pages[f"reference/{page}.md"]
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


def test_every_command_is_named_with_its_options(pages: dict[str, str]) -> None:
    text = pages["reference/commands.md"]
    assert "## pilewatch identify" in text
    assert "`--lowest-frequency`" in text


def test_the_choices_of_an_option_are_listed(pages: dict[str, str]) -> None:
    listed = "One of `importance`, `emcee`, `tmcmc`, `tmcmc-published`."
    assert listed in pages["reference/commands.md"]


@pytest.mark.parametrize("page", ["scenario", "description", "layout", "notices", "mapping"])
def test_values_are_named_in_words_and_as_toml(pages: dict[str, str], page: str) -> None:
    rows = [line for line in pages[f"reference/{page}.md"].splitlines() if "| `" in line]
    python = ("tuple[", "Optional", "Literal", "`None`", "`()`", "`True`", "`False`", "None:")
    assert [(row, word) for row in rows for word in python if word in row] == []


def test_every_field_of_a_message_has_its_meaning(reference: ModuleType) -> None:
    rows = [line for line in reference.message_tables().splitlines() if line.startswith("| `")]
    assert len(rows) > 100
    assert [row for row in rows if row.endswith("|  |")] == []


def test_every_file_and_column_of_an_export_is_named_as_it_is_in_the_file(
    reference_export: ModuleType,
) -> None:
    text = reference_export.page()
    for table in RESULT_TABLES:
        rows = text.split(f"## {table.name}.csv, ")[1].split("\n## ")[0]
        assert [name for name in table.schema.names if f"| `{name}` |" not in rows] == []


def test_meanings_are_of_columns_that_an_export_has(reference_export: ModuleType) -> None:
    used = set()
    for table in RESULT_TABLES:
        for title in table.schema.names:
            name, _ = reference_export.column_parts(title)
            own = f"{table.name}.{name}"
            in_any = reference_export.SPRING.sub("k", name)
            used.add(own if own in reference_export.COLUMNS else in_any)
    assert set(reference_export.COLUMNS) - used == set()
    assert {table.name for table in RESULT_TABLES} == set(reference_export.ROWS)
