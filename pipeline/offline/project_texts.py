"""The files of a new project as texts: layout, scenario, description of the structure."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

from pipeline.scenario import NO_STRUCTURE
from pipeline.updating.prior import Prior
from sensors.errors import InputError
from sensors.files.channel_names import GuessedChannel
from sensors.files.table import (
    UNSTATED,
    TimeColumn,
)
from sensors.settings import key_fields, toml_string
from sensors.structure.decks.bmodes import read_bmodes
from sensors.structure.decks.elastodyn import read_elastodyn
from sensors.structure.decks.windio import read_windio
from sensors.structure.description import (
    SHIPPED,
    TurbineDescription,
    load_turbine,
    turbine_text,
)
from sensors.structure.foundation import FoundationSprings

YAML = (".yaml", ".yml")  # of WindIO
DAT, BMI = ".dat", ".bmi"  # of ElastoDyn, of BModes
WINDOW = 600.0  # length of an identified window, unless the record is shorter [s]


def structure_text(
    structure: str,
    subdyn: Path | None = None,
    springs: FoundationSprings | None = None,
    mudline: float | None = None,
) -> str | None:
    """Return the description that goes into a project's folder; None for a shipped one or none.

    Parameters
    ----------
    structure : str
        Shipped name, description, or another program's file.
    subdyn : Path, optional
        SubDyn file beside a structure of ElastoDyn.
    springs : FoundationSprings, optional
        Of another program's structure.
    mudline : float, optional
        Elevation of the mudline of another program's structure [m].

    Raises
    ------
    InputError
        If the file cannot be read, or another program's comes without springs.
    """
    is_deck = structure.endswith((DAT, BMI, *YAML))
    if (subdyn or springs or mudline is not None) and not is_deck:
        raise InputError(
            "--subdyn, --springs and --mudline are for --structure NAME_ElastoDyn.dat, NAME.yaml "
            "and NAME.bmi"
        )
    if is_deck:
        if not Path(structure).exists():
            raise InputError(f"{structure}: no such file")
        if springs is None:
            raise InputError(
                f"{structure} has no springs of the mudline: give --springs k11,k22,k12 "
                "[N/m, N·m/rad, N/rad]"
            )
        return description_toml(_of_deck(Path(structure), springs, subdyn, mudline))
    if structure == NO_STRUCTURE:
        return None
    Prior(load_turbine(structure).foundation.stiffness)  # raises where these cannot be updated
    return None if structure in SHIPPED else turbine_text(structure)


def _of_deck(
    path: Path, springs: FoundationSprings, subdyn: Path | None, mudline: float | None
) -> TurbineDescription:
    """Return the turbine of another program's file."""
    if subdyn is not None and path.suffix != DAT:
        raise InputError(f"--subdyn is for --structure NAME_ElastoDyn.dat, not for {path}")
    if mudline is not None and path.suffix == DAT:
        raise InputError(f"--mudline is for NAME.yaml and NAME.bmi, not for {path}")
    if path.suffix == DAT:
        return read_elastodyn(path, springs, subdyn=subdyn)
    if path.suffix == BMI:
        return read_bmodes(path, springs, mudline=mudline)
    return read_windio(path, springs, mudline=mudline)


def layout_text(
    channels: Sequence[GuessedChannel], turbine: str, time: TimeColumn = UNSTATED
) -> str:
    """Return the layout file of guessed channels, each with what it was read from."""
    lines = [
        "# Axes: x downwind (fore-aft), y to the side (side-side), z up from mean water level.",
        "# What was guessed stands beside each channel; correct it and start from this file with\n"
        "# `pilewatch new FILE --layout`.",
        f"turbine = {toml_string(turbine)}",
    ]
    for each in channels:
        direction = ", ".join(f"{value:g}" for value in each.direction)
        lines += [
            "",
            f"[[channels]]  # {each.reason}",
            f"name = {toml_string(each.name)}",
            f"elevation = {each.elevation:.6g}" + ("" if each.height_known else "  # place only"),
            f"direction = [{direction}]",
        ]
    stated = {"dates": time.dates, "zone": time.zone}
    if any(stated.values()):
        lines += ["", "[time]", *(f"{k} = {toml_string(v)}" for k, v in stated.items() if v)]
    return "\n".join(lines) + "\n"


def scenario_text(turbine: str, structure: str, duration: float) -> str:
    """Return the scenario of a new project; a record shorter than a window is one window.

    Parameters
    ----------
    turbine : str
        Its id.
    structure : str
        Its description, or "none".
    duration : float
        Length of the record [s].
    """
    text = (
        f"title = {toml_string(f'Measurements of {turbine}')}\n\n"
        f"[turbine]\nid = {toml_string(turbine)}\n"
        f"description = {toml_string(structure)}\n"
    )
    if duration >= WINDOW:
        return text
    window = int(duration)
    return f"{text}\n[oma]\nwindow_duration = {window}.0  # the record [s]\nhop = {window}.0\n"


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
