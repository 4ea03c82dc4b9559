"""Write the reference pages that follow from the code: commands and every key of every file.

Run by mkdocs (plugin gen-files) at every build, so that no page can fall behind the code.
"""

import ast
import inspect
import json
import math
import re
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import typer
from typer.main import get_command

from pipeline import messages
from pipeline.cli import app
from pipeline.monitoring.alarms.settings import AlarmSettings
from pipeline.scenario import Scenario
from pipeline.updating.structural.settings import OTHERS, StructureSettings
from sensors.feeds.payloads.mapping import Paths, PayloadMapping
from sensors.files.layout_file import LayoutFile
from sensors.settings import key_fields
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import FIGURES

HIDDEN = {"origin"}  # of a layout: set by the reader of the file


def commands() -> str:
    """Every command with its arguments and options."""
    group: Any = get_command(app)
    context = typer.Context(group, info_name="pilewatch")
    lines = [
        "# Commands",
        "",
        "Exit codes:",
        "",
        "- 0: done;",
        "- 1: a node failed; of `audit`: the books do not balance;",
        "- 2: the input is wrong, or something could not be done, with the reason in one line.",
        "  `reprocess` and `notices --test` take files and receivers one by one: they do the rest",
        "  and end with 2 as well.",
        "",
        "The same option means the same in every command: `--scenario` is a shipped scenario or",
        "a file, `--structure` a description, `--layout` a file of channels, `--turbine` an id.",
        "`--out` is the folder or file that a command writes. `status`, `control`, `ack`,",
        "`metrics`, `farm` and `notices` write none: there it is the folder of the session that",
        "runs. Every command that ends by itself takes `--json`, except `show`, which draws. The",
        "shell completes options and choices (`pilewatch --install-completion`).",
        "",
    ]
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        help_text = inspect.cleandoc(command.help or "")
        lines += [f"## pilewatch {name}", "", help_text, "", "| | default | |", "|---|---|---|"]
        for parameter in command.params:
            lines.append(_parameter_row(parameter))
        lines.append("")
    return "\n".join(lines)


def _parameter_row(parameter: Any) -> str:
    names = ", ".join(f"`{name}`" for name in (*parameter.opts, *parameter.secondary_opts))
    default = parameter.default
    empty = default in (None, False, (), [], "") or callable(default)
    shown = "" if empty else "yes" if default is True else f"`{default}`"
    text = " ".join((getattr(parameter, "help", None) or "").split())
    annotation = getattr(getattr(parameter, "type_descriptor", None), "annotation", None)
    choices = get_args(annotation) if get_origin(annotation) is Literal else ()
    if not all(f"{choice}:" in text for choice in choices):
        text += f" One of {', '.join(f'`{choice}`' for choice in choices)}."
    return f"| {names} | {shown} | {text} |".replace("||", "| |")


def keys_of(settings: Any, title: str, introduction: str, top: str = "Top of the file") -> str:
    """Every key of a settings type, section by section: type, default, meaning."""
    lines = [f"# {title}", "", introduction, ""]
    for section, kind in sections(settings, ""):
        if not keys(kind):
            continue  # holds sections alone
        lines += [f"## {section or top}", ""]
        lines += [_first_line(kind), "", "| key | value | default | meaning |", "|---|---|---|---|"]
        meanings, hints = field_meanings(kind), get_type_hints(kind)
        for each in keys(kind):
            meaning = sentence(meanings.get(each.name, ""))
            shown = PATHS if each.type is Paths else value_name(hints[each.name])
            shown = TABLES.get((kind.__name__, each.name), shown)
            default = DEFAULTS.get((kind.__name__, each.name)) or _default(each)
            lines.append(f"| `{each.name}` | {shown} | {default} | {meaning} |")
        lines.append("")
    return "\n".join(lines)


def keys(kind: Any) -> list[Field[Any]]:
    """The keys of a section that are values, not sections of their own."""
    hints = get_type_hints(kind)
    return [
        each
        for each in key_fields(kind)
        if each.name not in HIDDEN and _section_type(hints[each.name]) is None
    ]


def sections(kind: Any, path: str) -> Iterator[tuple[str, Any]]:
    yield path, kind
    hints = get_type_hints(kind)
    for each in key_fields(kind):
        inner = _section_type(hints[each.name])
        if inner is not None and inner is not StructureSettings and each.name not in HIDDEN:
            many = str(hints[each.name]).startswith("tuple")
            name = f"{path.strip('[]')}.{each.name}".strip(".")
            yield from sections(inner, f"[[{name}]]" if many else f"[{name}]")


def _section_type(hint: Any) -> Any | None:
    """The settings type behind a field's type; None where the field is a value."""
    for candidate in (hint, *get_args(hint)):
        if isinstance(candidate, type) and is_dataclass(candidate):
            return candidate
    return None


def field_meanings(kind: Any) -> dict[str, str]:
    """What each field means, inherited ones too: the string below, else the comment beside it."""
    bases = [base for base in kind.__mro__[1:] if is_dataclass(base)]
    meanings = {name: text for base in bases[::-1] for name, text in field_meanings(base).items()}
    source = inspect.cleandoc(inspect.getsource(kind))
    lines = source.splitlines()
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    for node, following in zip(body.body, [*body.body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        assert node.end_lineno is not None
        text = lines[node.end_lineno - 1].partition("#")[2].strip()
        if (
            isinstance(following, ast.Expr)
            and isinstance(following.value, ast.Constant)
            and isinstance(following.value.value, str)
        ):
            text = " ".join(following.value.value.split())
        meanings[node.target.id] = text
    return meanings


def sentence(meaning: str) -> str:
    """A meaning as a sentence of a table's cell, in the words of a TOML file."""
    text = meaning.replace("|", "\\|").replace("None:", "absent:").replace("():", "empty:")
    text = text.replace('"":', "empty:")
    if not text or text.startswith(("`", "[")):
        return text
    is_word = text[0].islower() and text[1:2].islower()  # no symbol, such as f or ζ
    first = text[0].upper() + text[1:] if is_word else text
    return first if first[-1] in ".…" else f"{first}."


def _first_line(kind: Any) -> str:
    return inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0]


def _default(each: Field[Any]) -> str:
    if each.default is not MISSING:
        return toml_value(each.default)
    return "required" if each.default_factory is MISSING else "empty"


def toml_value(value: object) -> str:
    """A default as a TOML file would state it; "absent" where there is none."""
    if value is None:
        return "absent"
    if value == math.inf:
        return "no limit"
    if value in ("", ()):
        return "empty"
    if isinstance(value, tuple):
        return f"`{json.dumps(list(value), ensure_ascii=False)}`"
    return f"`{json.dumps(value, ensure_ascii=False)}`"


DEFAULTS = {("LayoutFile", "layout_id"): "absent"}  # the reader of the file makes one
WORDS = {str: "text", float: "number", int: "whole number", bool: "`true` or `false`"}
PLURALS = {str: "texts", float: "numbers", int: "whole numbers"}
PATHS = "path, or list of paths"  # of a mapping
TABLES = {("PayloadMapping", "rename"): "table of texts"}  # what else its reader takes


def value_name(hint: Any) -> str:
    """What a key takes, in words: "number", "list of numbers", "one of …"."""
    arguments = [each for each in get_args(hint) if each is not type(None)]
    origin = get_origin(hint)
    if origin in (Union, UnionType):
        return " or ".join(value_name(each) for each in arguments)
    if origin is Literal:
        return " or ".join(f'`"{each}"`' for each in arguments)
    if origin is tuple:
        items = PLURALS[arguments[0]]
        count = "" if Ellipsis in arguments else f"{len(arguments)} "
        return f"list of {count}{items}"
    return WORDS[hint]


STRUCTURE = """## [structure.uncertain]

Standard deviation of the prior of each parameter of the structure that is inferred with the
springs; `"exact"` takes a parameter as described. `[structure] uncertain = "exact"` takes all of
them as described. The unit "-" is a share of the described value.

| key | default | unit | meaning | where the default comes from |
|---|---|---|---|---|
"""
OTHER_MEANINGS = {
    "water_level": ("m", "water level where SCADA measures it"),
    "unknown_water_level": ("m", "water level where nothing measures it"),
    "sensor_gain": ("-", "sensitivity of each channel"),
    "sensor_heading": (
        "deg",
        "heading of all channels at one height together; of two single-axis sensors that are not "
        "at right angles no heading explains both, and the warning `sensor` names the height",
    ),
    "sensor_height": ("m", "height of each sensor"),
}
ORIGINS = {  # where the code's words leave open what is meant
    "rna_height": (
        "drawings; 1 % of 5 m, the height of the centre above the tower's top: engineering "
        "judgement"
    ),
}
ALTERNATIVES = (
    ("flooding", "whether the monopile is flooded"),
    ("blade_model", "mesh of blades"),
    ("tube_shear", "whether the tubes deform by shear"),
)


def structure_keys() -> str:
    """The figures of [structure.uncertain] with their defaults."""
    rows = [(f.name, f.std, f.unit, f.title, ORIGINS.get(f.name, f.source)) for f in FIGURES]
    rows += [(name, std, *OTHER_MEANINGS[name], "") for name, std in OTHERS.items()]
    lines = [f"| `{n}` | {s:g} | {u} | {m} | {source} |" for n, s, u, m, source in rows]
    lines += [f'| `{name}` | both | | {text}; only `"exact"` | |' for name, text in ALTERNATIVES]
    return STRUCTURE + "\n".join(lines) + "\n"


SCENARIO = """One TOML file is the whole experiment. An unknown key is an error that names its
section. `pilewatch simulate --describe NAME` prints a shipped one."""
DESCRIPTION = """The structure: tubes from the mudline upwards, rotor and nacelle, water,
foundation. `pilewatch describe --template` prints a complete file to start from.

Instead of its own `youngs_modulus`, `density`, `poisson_ratio` and `shear`, a tube may name a
material, `material = "steel"`, whose section `[materials.steel]` has these keys; what a tube states
itself comes first."""
LAYOUT = """Where the channels of a measurement are: `--layout FILE`. `pilewatch import FILE
--template` prints one to fill in; `pilewatch new FILE` guesses one."""
NOTICES = """Who is notified of what: `run --notices FILE`. `pilewatch notices FILE --test` sends a
test message through every channel."""
MAPPING = """Where an instrument's messages have time, values and names: `?mapping=FILE` in its
address. `pilewatch feed ADDRESS --sniff` writes one from what comes."""


# Fields of messages that have the same meaning in all of them.
FIELDS = {
    "turbine": "Turbine id.",
    "unit": "Acquisition unit id; of a parameter its unit.",
    "session": "Session id: one per start of the unit.",
    "window": "Windows since the session's start, rejected ones counted, from 0.",
    "start_ns": "Begin, by the sensors' clock [ns since 1970-01-01 UTC].",
    "end_ns": "End, by the sensors' clock [ns since 1970-01-01 UTC].",
    "time_ns": "Time, by the sensors' clock [ns since 1970-01-01 UTC].",
    "layout_id": "Name of the SensorLayout.",
    "channels": "The channels, in the order of columns and shapes.",
    "modes": "Identified modes, lowest frequency first.",
    "warnings": "Reservations about the result.",
    "status": "What the unit reports of itself.",
    "windows_before": "Windows before it that have the same answer.",
    "k12": "Share of the variance of ln k12 [-].",
    "name": "Name of the alternative.",
    "pairs": "Identified modes with their model modes.",
    "n_blocks": "Number of blocks.",
    "count": "Number of messages.",
    "node": "Name of the node.",
    "received": "Messages that it received, by type.",
    "published": "Messages that it published, by type.",
}


def message_tables() -> str:
    """Every message with its fields: type and meaning."""
    lines = []
    for name, kind in vars(messages).items():
        if not (isinstance(kind, type) and is_dataclass(kind)) or name.startswith("_"):
            continue
        lines += [f"## {name}", "", inspect.cleandoc(kind.__doc__ or ""), ""]
        lines += ["| field | type | meaning |", "|---|---|---|"]
        meanings = field_meanings(kind)
        for each in fields(kind):
            shown = field_type(each.type)
            meaning = meanings.get(each.name) or FIELDS.get(each.name, "")
            lines.append(f"| `{each.name}` | {shown} | {sentence(meaning)} |")
        lines.append("")
    return "\n".join(lines)


def field_type(hint: Any) -> str:
    """A type as a reader of the page knows it; of an array what it holds is in the meaning."""
    text = hint.__name__ if isinstance(hint, type) else str(hint)
    for module in ("typing.", "numpy.", "collections.abc."):
        text = text.replace(module, "")
    text = re.sub(r"\b[a-z_]+(?:\.[a-z_]+)+\.(?=[A-Z])", "", text)
    return "array" if "ndarray" in text else text.replace("|", "or")


def pages() -> dict[str, str]:
    """Text of every page by its path in the site."""
    introduction = (Path(__file__).parent / "pages/reference/messages.md").read_text("utf-8")
    scenario = keys_of(Scenario, "Scenario keys", SCENARIO)
    return {
        "reference/commands.md": commands(),
        "reference/scenario.md": f"{scenario}\n{structure_keys()}",
        "reference/description.md": keys_of(TurbineDescription, "Turbine description", DESCRIPTION),
        "reference/layout.md": keys_of(LayoutFile, "Layout file", LAYOUT),
        "reference/notices.md": keys_of(AlarmSettings, "Notices file", NOTICES),
        "reference/messages.md": f"{introduction}\n{message_tables()}",
        "reference/mapping.md": keys_of(
            PayloadMapping, "Mapping of messages", MAPPING, top="[mapping]"
        ),
    }


def write_pages() -> None:
    """Write them as mkdocs' plugin takes them."""
    import mkdocs_gen_files

    for path, text in pages().items():
        with mkdocs_gen_files.open(path, "w") as page:
            page.write(text)


if __name__ == "<run_path>":  # by the plugin, not by a test
    write_pages()
