"""A TOML table → a frozen settings dataclass, with an error that a person can act on."""

import difflib
import types
from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from sensors.errors import InputError

T = TypeVar("T")


class ScenarioError(InputError):
    """A scenario that cannot be run; the message names file, section and key."""


def settings_from_table(cls: type[T], table: Mapping[str, Any], where: str) -> T:
    """Settings of one section.

    cls     frozen dataclass; nested dataclasses are sub-tables
    table   what the TOML file has under that section
    where   file and section, for the error: "parked.toml [oma]"

    Raises ScenarioError for an unknown or missing key, a value of the wrong type, and whatever
    InputError the settings' own checks raise, with `where` in front.
    """
    known = {field.name: field for field in fields(cls) if field.init}  # type: ignore[arg-type]
    for key in table:
        if key not in known:
            raise ScenarioError(_unknown_key(key, list(known), where))
    hints = get_type_hints(cls)
    values = {key: _converted(value, hints[key], f"{where} {key}") for key, value in table.items()}
    for name, field in known.items():
        if name not in values and field.default is MISSING and field.default_factory is MISSING:
            raise ScenarioError(f"{where}: the key {name!r} is missing")
    try:
        return cls(**values)
    except ScenarioError:
        raise
    except InputError as error:
        raise ScenarioError(f"{where}: {error}") from error


def _place(where: str, key: str, hint: Any) -> str:
    """Where a value stands: "parked.toml [oma] hop"; a table's name goes into the brackets."""
    if not is_dataclass(hint):
        return f"{where} {key}"
    return f"{where[:-1]}.{key}]" if where.endswith("]") else f"{where} [{key}]"


def _unknown_key(key: str, known: list[str], where: str) -> str:
    close = difflib.get_close_matches(key, known, n=1)
    advice = f"did you mean {close[0]!r}?" if close else f"it takes {', '.join(known)}"
    return f"{where}: unknown key {key!r}; {advice}"


def _converted(value: Any, hint: Any, where: str) -> Any:
    """The TOML value as the annotated type; lists become tuples, integers floats."""
    origin = get_origin(hint)
    if origin is Literal:
        return _one_of(value, get_args(hint), where)
    if origin in (Union, types.UnionType):
        return _first_that_fits(value, get_args(hint), where)
    if is_dataclass(hint) and isinstance(hint, type):
        if not isinstance(value, Mapping):
            raise ScenarioError(f"{where} is {value!r}; a table of keys is needed")
        return settings_from_table(hint, value, where)
    if origin is tuple:
        return _tuple(value, get_args(hint), where)
    if origin is dict:
        return dict(value)
    return _scalar(value, hint, where)


def _one_of(value: Any, choices: tuple[Any, ...], where: str) -> Any:
    if value not in choices:
        words = ", ".join(repr(choice) for choice in choices)
        raise ScenarioError(f"{where} is {value!r}; it can be {words}")
    return value


def _first_that_fits(value: Any, hints: tuple[Any, ...], where: str) -> Any:
    problem: ScenarioError | None = None
    for hint in hints:
        if hint is type(None):
            continue
        try:
            return _converted(value, hint, where)
        except ScenarioError as error:
            problem = error
    assert problem is not None
    raise problem


def _tuple(value: Any, hints: tuple[Any, ...], where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ScenarioError(f"{where} is {value!r}; a list is needed")
    if len(hints) == 2 and hints[1] is Ellipsis:
        return tuple(_converted(item, hints[0], where) for item in value)
    if len(value) != len(hints):
        raise ScenarioError(f"{where} has {len(value)} values; {len(hints)} are needed")
    return tuple(_converted(item, hint, where) for item, hint in zip(value, hints, strict=True))


def _scalar(value: Any, hint: Any, where: str) -> Any:
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if isinstance(value, bool) != (hint is bool) or not isinstance(value, hint):
        raise ScenarioError(
            f"{where} is {value!r}; a value of type {getattr(hint, '__name__', hint)} is needed"
        )
    return value
