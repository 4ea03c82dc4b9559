"""Write the reference pages that follow from the code: commands, scenario keys, description.

Run by mkdocs (plugin gen-files) at every build, so that no page can fall behind the code.
"""

import ast
import inspect
from collections.abc import Iterator
from dataclasses import MISSING, Field, fields, is_dataclass
from typing import Any, get_args, get_type_hints

import mkdocs_gen_files
import typer
from typer.main import get_command

from pipeline.cli import app
from pipeline.scenario import Scenario
from sensors.structure.description import TurbineDescription

HIDDEN = {"name", "text", "origin"}  # of a scenario: set by the reader of the file


def commands() -> str:
    """Every command with its arguments and options."""
    group: Any = get_command(app)
    context = typer.Context(group, info_name="pilewatch")
    lines = [
        "# Commands",
        "",
        "Exit codes: 0 done; 1 a node failed; 2 the input is wrong (one line says what).",
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
    shown = "" if default in (None, False, (), []) or callable(default) else f"`{default}`"
    text = " ".join((getattr(parameter, "help", None) or "").split())
    return f"| {names} | {shown} | {text} |".replace("||", "| |")


def keys_of(settings: Any, title: str, introduction: str) -> str:
    """Every key of a settings type, section by section: type, default, meaning."""
    lines = [f"# {title}", "", introduction, ""]
    for section, kind in _sections(settings, ""):
        lines += [f"## {section or 'Top of the file'}", ""]
        lines += [_first_line(kind), "", "| key | type | default | meaning |", "|---|---|---|---|"]
        meanings, hints = field_meanings(kind), get_type_hints(kind)
        for each in fields(kind):
            if each.name in HIDDEN or _section_type(hints[each.name]) is not None:
                continue
            meaning = meanings.get(each.name, "").replace("|", "\\|")
            shown = _type_name(hints[each.name]).replace("|", "or")
            lines.append(f"| `{each.name}` | {shown} | {_default(each)} | {meaning} |")
        lines.append("")
    return "\n".join(lines)


def _sections(kind: Any, path: str) -> Iterator[tuple[str, Any]]:
    yield path, kind
    hints = get_type_hints(kind)
    for each in fields(kind):
        inner = _section_type(hints[each.name])
        if inner is not None and each.name not in HIDDEN:
            many = str(hints[each.name]).startswith("tuple")
            name = f"{path.strip('[]')}.{each.name}".strip(".")
            yield from _sections(inner, f"[[{name}]]" if many else f"[{name}]")


def _section_type(hint: Any) -> Any | None:
    """The settings type behind a field's type; None where the field is a value."""
    for candidate in (hint, *get_args(hint)):
        if isinstance(candidate, type) and is_dataclass(candidate):
            return candidate
    return None


def field_meanings(kind: Any) -> dict[str, str]:
    """What each field means: the string below it, else the comment beside it."""
    source = inspect.cleandoc(inspect.getsource(kind)) if kind else ""
    lines = source.splitlines()
    body = ast.parse(source).body[0]
    assert isinstance(body, ast.ClassDef)
    meanings: dict[str, str] = {}
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


def _first_line(kind: Any) -> str:
    return inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0]


def _default(each: Field[Any]) -> str:
    if each.default is not MISSING:
        return f"`{each.default!r}`"
    return "" if each.default_factory is MISSING else "`()`"


def _type_name(hint: Any) -> str:
    text = hint.__name__ if isinstance(hint, type) else str(hint)
    return text.replace("typing.", "")


SCENARIO = """One TOML file is the whole experiment. An unknown key is an error that names its
section. `pilewatch simulate --describe NAME` prints a shipped one."""
DESCRIPTION = """The structure: tubes from the mudline upwards, rotor and nacelle, water,
foundation. `pilewatch describe --template` prints a complete file to start from."""

for path, text in (
    ("reference/commands.md", commands()),
    ("reference/scenario.md", keys_of(Scenario, "Scenario keys", SCENARIO)),
    ("reference/description.md", keys_of(TurbineDescription, "Turbine description", DESCRIPTION)),
):
    with mkdocs_gen_files.open(path, "w") as page:
        page.write(text)
