"""A description as the TOML text that `load_turbine` reads again."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

from sensors.settings import key_fields
from sensors.structure.description import TurbineDescription


def description_toml(turbine: TurbineDescription) -> str:
    """Return the whole description; numbers to twelve digits, what is left at its default left out.

    Parameters
    ----------
    turbine : TurbineDescription
        A structure.
    """
    table = _table(turbine)
    scalars = {key: value for key, value in table.items() if not isinstance(value, dict)}
    sections = {key: value for key, value in table.items() if isinstance(value, dict)}
    lines = [f"{key} = {_value(value)}" for key, value in scalars.items()]
    for name, section in sections.items():
        lines += ["", f"[{name}]"]
        lines += [f"{key} = {_value(value)}" for key, value in section.items()]
    return "\n".join(lines) + "\n"


def _table(settings: Any) -> dict[str, Any]:
    """Keys that differ from their defaults."""
    found: dict[str, Any] = {}
    defaults = {each.name: each.default for each in fields(settings)}
    for each in key_fields(type(settings)):
        value = getattr(settings, each.name)
        if value is None or value == defaults[each.name] or value == ():
            continue
        found[each.name] = _plain(value)
    return found


def _plain(value: Any) -> Any:
    if is_dataclass(value):
        return _table(value)
    if isinstance(value, tuple):
        return [_plain(each) for each in value]
    return value


def _value(value: Any) -> str:
    if isinstance(value, Mapping):
        inner = ", ".join(f"{key} = {_value(each)}" for key, each in value.items())
        return f"{{ {inner} }}"
    if isinstance(value, list):
        if value and isinstance(value[0], Mapping):
            return "[\n" + "".join(f"  {_value(each)},\n" for each in value) + "]"
        return f"[{', '.join(_value(each) for each in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return f'"{escaped}"'
    return f"{value:.12g}" if isinstance(value, int) else _number(float(value))


def _number(value: float) -> str:
    text = f"{value:.12g}"
    return text if any(letter in text for letter in ".en") else f"{text}.0"
