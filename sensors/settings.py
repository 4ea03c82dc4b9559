"""A TOML table → a frozen settings dataclass, with an error that a person can act on.

Scenarios and turbine descriptions are both read by it, so their mistakes read alike.
"""

import difflib
import math
import re
import tomllib
import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from typing import Any, ClassVar, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from sensors.errors import InputError

_T = TypeVar("_T")

_KINDS = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}


_DECIMAL_COMMA = re.compile(r"=\s*([-+]?\d+),(\d+)")


def toml_table(text: str, where: str, error: type[InputError]) -> dict[str, Any]:
    """Return the table of a TOML text.

    Parameters
    ----------
    where : str
        The file, for the error.
    error : type[InputError]
        What to raise.

    Notes
    -----
    Raises `error`, one line, for a text that is not TOML; a decimal comma is named as such.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as damage:
        at = re.search(r"at line (\d+)", str(damage))
        line = text.splitlines()[int(at[1]) - 1] if at else ""
        comma = _DECIMAL_COMMA.search(line)
        advice = f"; numbers have a decimal point: {comma[1]}.{comma[2]}" if comma else ""
        raise error(f"{where}: not valid TOML: {damage}{advice}") from damage


def settings_from_table(
    cls: type[_T], table: Mapping[str, Any], where: str, error: type[InputError]
) -> _T:
    """Return the dataclass that a table describes; nested dataclasses are sub-tables.

    Parameters
    ----------
    cls : type[T]
        Frozen dataclass; its field types define what each key takes.
    table : Mapping[str, Any]
        As the TOML file has it.
    where : str
        File and section, for the error: "parked.toml" or "parked.toml [oma]".
    error : type[InputError]
        What to raise.

    Notes
    -----
    Raises `error`, one line, for an unknown or missing key, a value of the wrong type, and whatever
    InputError the dataclass' own checks raise, with `where` in front.
    """
    return _Reader(error).read(cls, table, where)


NO_KEY: Mapping[str, Any] = types.MappingProxyType({"key": False})
"""Metadata of a field that is set in Python only and is no key of a TOML table."""

NEVER_A_KEY: Mapping[str, Any] = types.MappingProxyType({"key": False, "was_key": False})
"""Metadata of a field that no version has read from a TOML table."""


def key_fields(cls: type) -> tuple[Field[Any], ...]:
    """Return the fields of a settings dataclass that are keys of its TOML table."""
    return tuple(each for each in fields(cls) if each.init and each.metadata.get("key", True))


def constants_of(cls: type) -> dict[str, Any]:
    """Return the values of a settings dataclass that no TOML table can set, by name.

    They are class variables, and fields with `NO_KEY` by their default. Earlier versions had many
    of them as keys.
    """
    keys = {each.name for each in key_fields(cls)}
    fixed = {
        each.name: each.default
        for each in fields(cls)
        if each.name not in keys and each.metadata.get("was_key", True)
    }
    for name, hint in get_type_hints(cls).items():
        if get_origin(hint) is ClassVar:
            fixed[name] = getattr(cls, name)
    return fixed


def without_constants(
    cls: type, table: Mapping[str, Any], where: str = ""
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Return a stored table without keys that are constants now, and these keys.

    Parameters
    ----------
    cls : type
        Settings dataclass that the table describes.
    table : mapping of str to Any
        As an earlier version has stored it.
    where : str
        Path of the table, for the returned keys: "" or "oma.".
    """
    hints, constants = get_type_hints(cls), constants_of(cls)
    kept: dict[str, Any] = {}
    dropped = [where + key for key in table if key in constants]
    for key, value in table.items():
        if key not in constants:
            inner = settings_type(hints.get(key))
            tables = value if isinstance(value, list) else [value]
            if inner is not None and all(isinstance(each, Mapping) for each in tables):
                found = [without_constants(inner, each, f"{where}{key}.") for each in tables]
                dropped += [path for _, paths in found for path in paths]
                inside = [each for each, _ in found]
                kept[key] = inside if isinstance(value, list) else inside[0]
            else:
                kept[key] = value
    return kept, tuple(dict.fromkeys(dropped))


def settings_type(hint: Any) -> type | None:
    """Return the dataclass of a sub-table or of an array of tables; None of a plain value."""
    if isinstance(hint, type) and is_dataclass(hint):
        return hint
    if get_origin(hint) in (tuple, Union, types.UnionType):
        return next((found for each in get_args(hint) if (found := settings_type(each))), None)
    return None


@dataclass(frozen=True, slots=True)
class _Reader:
    error: type[InputError]

    def read(self, cls: type[_T], table: Mapping[str, Any], where: str) -> _T:
        known = {field.name: field for field in key_fields(cls)}
        self._check_keys(cls, table, known, where)
        hints = get_type_hints(cls)
        values = {
            key: self._converted(value, hints[key], where, key) for key, value in table.items()
        }
        try:
            return cls(**values)
        except InputError as error:
            section = f"{where[where.find('[') :]} "  # which checks of one section's own name, too
            raise self.error(f"{where}: {str(error).removeprefix(section)}") from error

    def _check_keys(
        self, cls: type, table: Mapping[str, Any], known: Mapping[str, Field[Any]], where: str
    ) -> None:
        constants = constants_of(cls)
        for key in table:
            if key in constants:
                raise self.error(
                    f"{where}: {key!r} is no key any more; its value is always {constants[key]!r}: "
                    "leave it out"
                )
            if key not in known:
                close = difflib.get_close_matches(key, known, n=1)
                advice = f"did you mean {close[0]!r}?" if close else f"it takes {', '.join(known)}"
                raise self.error(f"{where}: unknown key {key!r}; {advice}")
        for name, field in known.items():
            optional = field.default is not MISSING or field.default_factory is not MISSING
            if name not in table and not optional:
                raise self.error(f"{where}: the key {name!r} is missing")

    def _converted(self, value: Any, hint: Any, where: str, key: str) -> Any:
        """Return the TOML value as the annotated type; lists become tuples, integers floats."""
        origin, arguments = get_origin(hint), get_args(hint)
        if origin in (Union, types.UnionType):  # X | None: TOML has no null, the key holds an X
            (inner,) = (each for each in arguments if each is not type(None))
            return self._converted(value, inner, where, key)
        if origin is Literal:
            return self._one_of(value, arguments, where, key)
        if origin is tuple:
            return self._tuple(value, arguments, where, key)
        if is_dataclass(hint) and isinstance(hint, type):
            if not isinstance(value, Mapping):
                raise self.error(f"{where}: {key} is {value!r}; a table of keys is needed")
            return self.read(hint, value, _section(where, key))
        return self._scalar(value, hint, where, key)

    def _one_of(self, value: Any, choices: tuple[Any, ...], where: str, key: str) -> Any:
        if value not in choices:
            words = " or ".join(repr(choice) for choice in choices)
            raise self.error(f"{where}: {key} is {value!r}; it can be {words}")
        return value

    def _tuple(self, value: Any, hints: tuple[Any, ...], where: str, key: str) -> tuple[Any, ...]:
        if not isinstance(value, list):
            raise self.error(f"{where}: {key} is {value!r}; a list is needed")
        if hints[-1] is Ellipsis:
            hints = (hints[0],) * len(value)
        if len(value) != len(hints):
            raise self.error(f"{where}: {key} has {len(value)} values; {len(hints)} are needed")
        return tuple(
            self._converted(item, hint, where, f"{key}[{i}]")
            for i, (item, hint) in enumerate(zip(value, hints, strict=True))
        )

    def _scalar(self, value: Any, hint: type, where: str, key: str) -> Any:
        if hint is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if not isinstance(value, hint) or isinstance(value, bool) != (hint is bool):
            raise self.error(f"{where}: {key} is {value!r}; {_KINDS[hint]} is needed")
        if isinstance(value, float) and not math.isfinite(value):
            raise self.error(f"{where}: {key} is {value}; a finite number is needed")
        return value


def _section(where: str, key: str) -> str:
    """ "parked.toml" and "oma" give "parked.toml [oma]", one level down "parked.toml [oma.x]"."""
    return f"{where[:-1]}.{key}]" if where.endswith("]") else f"{where} [{key}]"


def toml_string(text: str) -> str:
    """Return a text as a basic string of TOML, quotes included, whatever is in it."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08x}" for c in escaped) + '"'
