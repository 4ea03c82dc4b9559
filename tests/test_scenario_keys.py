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
from tests.syntax import nodes_of

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
        for node in nodes_of(file):
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


LEAST = 1e-9  # beside a limit, of its own size [-]
LIMITS = {  # taken, refused
    "farm.log_std": (0.5 - LEAST, 0.5),
    "farm.spread": (0.5 - LEAST, 0.5),
    "oma.hop": (600.0, 600.0 + 600 * LEAST),  # no longer than the window
    "oma.window_duration": (600.0, 600.0 - 600 * LEAST),
    "recording.rotate_after": (1e-9, 0.99e-9),  # a nanosecond
    "recording.rotate_megabytes": (1e-9, 0.99e-9),
    "simulation.damping.blades": (1.0 - LEAST, 1.0),
    "simulation.damping.support": (1.0 - LEAST, 1.0),
    "simulation.duration": (100 * 365.25 * 86400.0, 100 * 365.25 * 86400.0 + 1.0),
    "simulation.foundation.softening": (0.5 - LEAST, 0.5),
    "simulation.sea.peak_period": (1.67, 1.66),
    "updating.guards.paired_share": (0.5, 0.5 - LEAST),
    "updating.prior.highest_ratio": (0.25 + LEAST, 0.25),
    "updating.prior.lowest_ratio": (4.0 - LEAST, 4.0),
    "updating.sampler.walkers": (26, 25),
    "updating.sampling.importance.draws": (50, 49),
    "updating.sampling.importance.effective_draws": (50.0, 50.0 - LEAST),
    "updating.sampling.tempering.samples": (100, 99),
}
BETWEEN = {"updating.change.certainty": (0.5, 1.0)}  # both refused, and all between them taken


@pytest.mark.parametrize("path", LIMITS)
def test_a_limit_of_a_key_is_where_it_is_stated(path: str) -> None:
    cls, name = settings_keys()[path]
    taken, refused = LIMITS[path]
    replace(cls(), **{name: taken})
    with pytest.raises(InputError):
        replace(cls(), **{name: refused})


@pytest.mark.parametrize("path", BETWEEN)
def test_a_key_between_two_limits_is_neither_of_them(path: str) -> None:
    cls, name = settings_keys()[path]
    for limit, beside in zip(BETWEEN[path], (1 + LEAST, 1 - LEAST), strict=True):
        replace(cls(), **{name: limit * beside})
        with pytest.raises(InputError):
            replace(cls(), **{name: limit})


def is_required(field: Any) -> bool:
    """Whether a settings type cannot be made without this field."""
    return field.default is MISSING and field.default_factory is MISSING
