"""Write the reference pages that follow from the code: commands and every key of every file.

Run by mkdocs (plugin gen-files) at every build, so that no page can fall behind the code.
"""

import ast
import inspect
from collections.abc import Iterator
from dataclasses import MISSING, Field, is_dataclass
from typing import Any, get_args, get_type_hints

import typer
from typer.main import get_command

from pipeline.cli import app
from pipeline.monitoring.alarms.settings import AlarmSettings
from pipeline.scenario import Scenario
from pipeline.updating.structural.settings import OTHERS, StructureSettings
from sensors.feeds.payloads.mapping import PayloadMapping
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
        "Exit codes: 0 done; 1 a node failed; 2 the input is wrong or nothing could be done, with",
        "the reason in one line.",
        "",
        "One word is one thing in every command: `--out` is where results are written,",
        "`--scenario` a shipped scenario or a file, `--structure` a description,",
        "`--layout` a file of channels, `--turbine` an id. Every command that ends takes `--json`;",
        "choices are listed in the help and completed by the shell",
        "(`pilewatch --install-completion`).",
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
    for section, kind in sections(settings, ""):
        if not keys(kind):
            continue  # holds sections alone
        lines += [f"## {section or 'Top of the file'}", ""]
        lines += [_first_line(kind), "", "| key | type | default | meaning |", "|---|---|---|---|"]
        meanings, hints = field_meanings(kind), get_type_hints(kind)
        for each in keys(kind):
            meaning = meanings.get(each.name, "").replace("|", "\\|")
            shown = _type_name(hints[each.name]).replace("|", "or")
            lines.append(f"| `{each.name}` | {shown} | {_default(each)} | {meaning} |")
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


def _first_line(kind: Any) -> str:
    return inspect.cleandoc(kind.__doc__ or "").split("\n\n")[0]


def _default(each: Field[Any]) -> str:
    if each.default is not MISSING:
        return f"`{each.default!r}`"
    return "" if each.default_factory is MISSING else "`()`"


def _type_name(hint: Any) -> str:
    text = hint.__name__ if isinstance(hint, type) else str(hint)
    return text.replace("typing.", "")


STRUCTURE = """## [structure.uncertain]

Standard deviation of the prior of each figure of the structure that is inferred with the springs;
`"exact"` takes a figure as described. `[structure] uncertain = "exact"` takes all so. "-" is a
share of the described value.

| key | default | unit | meaning | where the default comes from |
|---|---|---|---|---|
"""
OTHER_MEANINGS = {
    "water_level": ("m", "water level where SCADA measures it"),
    "unknown_water_level": ("m", "water level where nothing measures it"),
    "sensor_gain": ("-", "sensitivity of each channel"),
    "sensor_heading": ("deg", "heading of each sensor's axes"),
    "sensor_height": ("m", "height of each sensor"),
}
ALTERNATIVES = (
    ("flooding", "whether the monopile is flooded"),
    ("blade_model", "mesh of blades"),
    ("tube_shear", "whether the tubes deform by shear"),
)


def structure_keys() -> str:
    """The figures of [structure.uncertain] with their defaults."""
    rows = [(f.name, f.std, f.unit, f.title, f.source) for f in FIGURES]
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


def pages() -> dict[str, str]:
    """Text of every page by its path in the site."""
    scenario = keys_of(Scenario, "Scenario keys", SCENARIO)
    return {
        "reference/commands.md": commands(),
        "reference/scenario.md": f"{scenario}\n{structure_keys()}",
        "reference/description.md": keys_of(TurbineDescription, "Turbine description", DESCRIPTION),
        "reference/layout.md": keys_of(LayoutFile, "Layout file", LAYOUT),
        "reference/notices.md": keys_of(AlarmSettings, "Notices file", NOTICES),
        "reference/mapping.md": keys_of(PayloadMapping, "Mapping of messages", MAPPING),
    }


def write_pages() -> None:
    """Write them as mkdocs' plugin takes them."""
    import mkdocs_gen_files

    for path, text in pages().items():
        with mkdocs_gen_files.open(path, "w") as page:
            page.write(text)


if __name__ == "<run_path>":  # by the plugin, not by a test
    write_pages()
