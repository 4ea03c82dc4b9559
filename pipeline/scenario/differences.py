"""In what two scenarios would give other results of the same samples."""

import tomllib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from itertools import zip_longest
from typing import Any

from pipeline.scenario.farm_members import farm_members
from pipeline.scenario.loading import scenario_from_metadata
from pipeline.scenario.settings import Scenario
from sensors.errors import InputError

MOST_SETTINGS = 5  # that are reported of a turbine
STORED = ("toml", "files", "structure")  # of what a recording stores: on the rest only draws depend
SECTIONS = ("oma", "updating", "operation")  # that windows and posteriors depend on


@dataclass(frozen=True, slots=True)
class SettingsDifference:
    """A setting that two scenarios have otherwise."""

    name: str
    """As in a scenario's file: "[turbine] description"."""
    before: str
    """What the first has."""
    after: str
    """What the second has."""


def settings_differences(
    before: Scenario, after: Scenario, turbine: str
) -> tuple[SettingsDifference, ...]:
    """Return what two scenarios set otherwise for a turbine that its results depend on.

    Parameters
    ----------
    before, after : Scenario
        As recordings have them stored.
    turbine : str
        Its id, which is looked for among the members of a farm.
    """
    return tuple(_differences(_member(before, turbine), _member(after, turbine)))


def other_settings(
    stored: Iterable[tuple[str, Mapping[str, str]]], used: Scenario, turbine: str
) -> Iterator[str]:
    """Yield a line for each setting that older recordings have stored otherwise than the newest.

    Parameters
    ----------
    stored : iterable of (str, mapping)
        Names of the files, the newest first, and what `scenario_metadata` gave; {} where a file has
        none. What is stored by an earlier version and none of this one is passed over.
    used : Scenario
        The newest's, under which all are processed.
    turbine : str
        Whose results they are.
    """
    seen = set[tuple[str, ...]]()
    reported = set[str]()
    newest = ""
    for name, metadata in stored:
        settings = tuple(metadata.get(each, "") for each in STORED)
        if not metadata or settings in seen:
            continue
        seen.add(settings)
        newest = newest or name
        for each in _from_stored(name, metadata, used, turbine) if name != newest else ():
            if each.name not in reported and len(reported) < MOST_SETTINGS:
                reported.add(each.name)
                yield (
                    f"{each.name} is {each.before} in {name}, {each.after} in {newest}; all "
                    "recordings are processed with the settings of the newest, unless --scenario "
                    "names others"
                )


def _from_stored(
    name: str, metadata: Mapping[str, str], used: Scenario, turbine: str
) -> tuple[SettingsDifference, ...]:
    try:
        older = scenario_from_metadata(metadata, f"scenario in {name}")
        return settings_differences(older, used, turbine)
    except InputError:
        return ()


def _member(scenario: Scenario, turbine: str) -> Scenario:
    return {member.turbine.id: member for member in farm_members(scenario)}.get(turbine, scenario)


def _differences(before: Scenario, after: Scenario) -> Iterator[SettingsDifference]:
    for name in ("description", "springs_sign"):
        first, second = getattr(before.turbine, name), getattr(after.turbine, name)
        if first != second:
            yield SettingsDifference(f"[turbine] {name}", _shown(first), _shown(second))
    for section in SECTIONS:
        first, second = getattr(before, section), getattr(after, section)
        yield from _in_section(section, first, second)
    yield from _in_files(before, after)


def _in_section(section: str, before: Any, after: Any) -> Iterator[SettingsDifference]:
    for field in fields(before):
        name, first, second = field.name, getattr(before, field.name), getattr(after, field.name)
        if first == second or name == "stated":  # how it was stated changes no result
            continue
        if name == "structure":  # a section of its own in the file
            yield from _in_section("structure", first, second)
        elif is_dataclass(first) and type(first) is type(second):
            yield from _in_section(f"{section}.{name}", first, second)
        else:
            yield SettingsDifference(f"[{section}] {name}", _shown(first), _shown(second))


def _in_files(before: Scenario, after: Scenario) -> Iterator[SettingsDifference]:
    """Yield the first line that differs of each file that both name and store."""
    first, second = dict(before.files), dict(after.files)
    used = (before.turbine.description, before.updating.population)
    for name in used:
        texts = first.get(name, ""), second.get(name, "")
        if all(texts) and _content(texts[0]) != _content(texts[1]):
            lines = zip_longest(*(text.splitlines() for text in texts), fillvalue="")
            number, (one, other) = next(
                (number, pair) for number, pair in enumerate(lines, start=1) if pair[0] != pair[1]
            )
            yield SettingsDifference(f"line {number} of {name}", _shown(one), _shown(other))


def _content(text: str) -> Any:
    """Return what a text states, comments left out; itself where it is no TOML."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        return text


def _shown(value: Any) -> str:
    return "not set" if value is None else repr(value.strip() if isinstance(value, str) else value)
