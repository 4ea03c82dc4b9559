"""What `pilewatch simulate --list` and `--describe` say of the shipped scenarios."""

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.cli.tables.recordings import (
    duration_in_words,
    scenario_description,
    scenario_settings,
)
from pipeline.scenario import load_scenario, shipped_scenarios


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_scenarios_settings_are_printed_as_in_its_file(name: str) -> None:
    """Units in brackets, section names, every line whole."""
    result = CliRunner().invoke(app, ["simulate", "--describe", name]).output
    scenario = load_scenario(name)
    assert scenario_settings(scenario) in result
    assert "[turbine]" in result
    assert scenario.title in result


@pytest.mark.parametrize("name", shipped_scenarios())
def test_a_scenarios_description_is_not_broken_where_its_file_breaks_it(name: str) -> None:
    scenario = load_scenario(name)
    title, *paragraphs = scenario_description(scenario).split("\n\n")
    assert title == f"{name}: {scenario.title}"
    assert " ".join(paragraphs).split() == scenario.description.split()
    assert all("\n" not in paragraph for paragraph in paragraphs)


def test_the_list_names_every_scenario_with_its_duration() -> None:
    result = CliRunner().invoke(app, ["simulate", "--list"]).output
    assert all(name in result for name in shipped_scenarios())
    assert "3 h 20 min" in result


def test_the_list_marks_a_scenario_that_cannot_be_simulated() -> None:
    result = CliRunner().invoke(app, ["simulate", "--list"]).output
    (row,) = [line for line in result.splitlines() if "modes-only" in line]
    assert row.split()[3] == "–"
    assert "–: without a structure, for run and import only" in " ".join(result.split())


@pytest.mark.parametrize(
    ("duration", "words"),
    [(600.0, "10 min"), (12000.0, "3 h 20 min"), (43200.0, "12 h"), (8, "8 s")],
)
def test_a_duration_is_given_in_hours_and_minutes(duration: float, words: str) -> None:
    assert duration_in_words(duration) == words
