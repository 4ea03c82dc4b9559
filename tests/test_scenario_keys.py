"""A test or a shipped scenario turns every key of a scenario; other numbers are constants."""

import ast
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, get_type_hints

import pytest

from pipeline.scenario import Scenario, shipped_scenarios
from sensors.errors import InputError
from sensors.settings import key_fields, settings_type

TESTS = Path(__file__).parent
MOST_KEYS = 120
AMBIGUOUS = ("speed", "steps", "scale", "unit")  # keywords of much else


@cache
def settings_keys() -> dict[str, tuple[type, str]]:
    """ "simulation.sea.spreading" → (Sea, "spreading"), of every key that a scenario can have."""
    return dict(_keys(Scenario, ""))


def _keys(cls: type, prefix: str) -> Iterator[tuple[str, tuple[type, str]]]:
    hints = get_type_hints(cls)
    for field in key_fields(cls):
        inner = settings_type(hints[field.name])
        if inner is None:
            yield prefix + field.name, (cls, field.name)
        else:
            yield from _keys(inner, f"{prefix}{field.name}.")


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
    unturned = set(settings_keys()) - turned_keys()
    assert not unturned, f"no test and no shipped scenario sets {sorted(unturned)}"


def test_the_number_of_keys_only_falls() -> None:
    keys = sorted(settings_keys())
    assert len(keys) <= MOST_KEYS, "\n".join(keys)


NEGATIVE = {
    "sensors.corner_frequency", "simulation.wind.shear_exponent", "simulation.sea.direction",
    "simulation.stages.at", "simulation.tide.amplitude", "simulation.tide.stiffness_share",
    "simulation.instruments.drift_per_hour", "updating.sampler.effective_draws",
}  # fmt: skip
NOTHING = NEGATIVE | {
    "simulation.broadband.tower_rms", "simulation.broadband.blade_rms",
    "simulation.waves.fore_aft_rms", "simulation.waves.side_side_rms",
    "simulation.wind.turbulence_intensity", "simulation.sea.significant_wave_height",
    "simulation.sea.inertia_coefficient", "simulation.sea.drag_coefficient",
    "simulation.rotor.first_harmonic", "simulation.rotor.third_harmonic",
    "simulation.foundation.softening", "simulation.transient", "simulation.noise_share",
    "simulation.instruments.noise_density", "simulation.instruments.full_scale",
    "simulation.scada_period", "oma.lateness", "updating.likelihood.frequency_floor",
    "updating.likelihood.shape_floor", "farm.spread", "farm.log_std", "recording.free_megabytes",
}  # fmt: skip


@pytest.mark.parametrize(("value", "taken"), [(-1, NEGATIVE), (0, NOTHING)])
def test_a_quantity_that_has_to_be_positive_is_refused_where_it_is_not(
    value: int, taken: set[str]
) -> None:
    """The keys that take a negative number, or none at all, are listed; all others are one line."""
    accepted = set()
    for path, (cls, name) in settings_keys().items():
        if any(is_required(each) for each in key_fields(cls)):
            continue
        default = getattr(cls(), name)
        if isinstance(default, int | float) and not isinstance(default, bool):
            with suppress(InputError):
                replace(cls(), **{name: type(default)(value)})
                accepted.add(path)
    assert accepted == taken


def is_required(field: Any) -> bool:
    """Whether a settings type cannot be made without this field."""
    return field.default is MISSING and field.default_factory is MISSING
