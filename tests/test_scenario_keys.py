"""A test or a shipped scenario turns every key of a scenario; other numbers are constants."""

import ast
import tomllib
import types
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from pathlib import Path
from typing import Any, Union, get_args, get_origin, get_type_hints

from pipeline.scenario import Scenario, shipped_scenarios
from sensors.settings import key_fields

TESTS = Path(__file__).parent
MOST_KEYS = 168  # to become 120
AMBIGUOUS = ("speed", "steps", "scale", "unit")  # keywords of much else

# Keys that nothing turns, of rooms where this is still to be done. Only ever shorter.
TO_BE_DONE = frozenset(
    (
        "oma.lowest_frequency",
        "oma.maximum_bandwidth_share",
        "oma.maximum_bound_ratio",
        "oma.maximum_damping",
        "oma.maximum_frequency_std",
        "oma.maximum_shape_std",
        "oma.minimum_collinearity",
        "operation.unusable",
        "recording.free_megabytes",
        "updating.change.foundation_share",
        "updating.guards.figure_deviation",
        "updating.guards.interval_share",
        "updating.guards.mode_misfit",
        "updating.guards.refused_cost",
        "updating.guards.unpredicted_share",
        "updating.likelihood.degrees_of_freedom",
        "updating.likelihood.least_mac",
        "updating.likelihood.resolution",
        "updating.likelihood.shape_mixing",
        "updating.pairing.mac_scale",
        "updating.pairing.steps",
        "updating.sampling.importance.least_efficiency",
        "updating.sampling.published.scale",
        "updating.sampling.published.variation",
        "updating.sampling.tempering.components",
        "updating.sampling.tempering.least_efficiency",
        "updating.sampling.tempering.most_pilots",
        "updating.sampling.tempering.most_steps",
        "updating.sampling.tempering.remembered",
        "updating.sampling.tempering.variation",
    )
)


@cache
def settings_keys() -> dict[str, tuple[type, str]]:
    """ "simulation.sea.spreading" → (Sea, "spreading"), of every key that a scenario can have."""
    return dict(_keys(Scenario, ""))


def _keys(cls: type, prefix: str) -> Iterator[tuple[str, tuple[type, str]]]:
    hints = get_type_hints(cls)
    for field in key_fields(cls):
        inner = _table_of(hints[field.name])
        if inner is None:
            yield prefix + field.name, (cls, field.name)
        else:
            yield from _keys(inner, f"{prefix}{field.name}.")


def _table_of(hint: Any) -> type | None:
    """The dataclass of a sub-table or of an array of tables; None of a plain value."""
    if isinstance(hint, type) and is_dataclass(hint):
        return hint
    if get_origin(hint) in (tuple, Union, types.UnionType):
        return next((found for each in get_args(hint) if (found := _table_of(each))), None)
    return None


def keys_in(table: Any, prefix: str = "") -> Iterator[str]:
    """The paths of all values of a TOML table."""
    if isinstance(table, Mapping):
        for key, value in table.items():
            yield prefix + key
            yield from keys_in(value, f"{prefix}{key}.")
    elif isinstance(table, list):
        for each in table:
            yield from keys_in(each, prefix)


@cache
def turned_keys() -> frozenset[str]:
    """The keys that a shipped scenario, a TOML text in a test or a call in a test sets."""
    scenarios = TESTS.parent / "pipeline" / "scenarios"
    texts = [(scenarios / f"{name}.toml").read_text("utf-8") for name in shipped_scenarios()]
    calls: set[tuple[str, str]] = set()
    replaced: set[str] = set()
    passed: set[str] = set()  # keywords of any call, perhaps a helper that builds the settings
    for file in set(TESTS.rglob("*.py")) - {Path(__file__)}:
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                texts.append(node.value)
            elif isinstance(node, ast.Call):
                name = getattr(node.func, "attr", getattr(node.func, "id", ""))
                names = {keyword.arg for keyword in node.keywords if keyword.arg}
                calls |= {(name, each) for each in names}
                calls |= {(name, str(position)) for position in range(len(node.args))}
                replaced |= names if name == "replace" else set()
                passed |= names
    counts = Counter(name for _, name in settings_keys().values())
    replaced |= {name for name in passed if counts[name] == 1 and name not in AMBIGUOUS}
    in_texts = {key for text in texts for key in _keys_of_text(text)}
    return frozenset(
        path
        for path, (cls, name) in settings_keys().items()
        if path in in_texts or name in replaced or _is_called(cls, name, calls)
    )


def _keys_of_text(text: str) -> Iterator[str]:
    try:
        yield from keys_in(tomllib.loads(text)) if "=" in text else ()
    except tomllib.TOMLDecodeError:
        return


def _is_called(cls: type, name: str, calls: set[tuple[str, str]]) -> bool:
    position = [field.name for field in fields(cls) if not field.kw_only].index(name)
    return (cls.__name__, name) in calls or (cls.__name__, str(position)) in calls


def test_every_key_is_turned_by_a_test_or_a_shipped_scenario() -> None:
    unturned = set(settings_keys()) - turned_keys() - TO_BE_DONE
    assert not unturned, f"no test and no shipped scenario sets {sorted(unturned)}"


def test_the_number_of_keys_only_falls() -> None:
    keys = sorted(settings_keys())
    assert len(keys) <= MOST_KEYS, "\n".join(keys)
