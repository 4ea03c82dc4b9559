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
from pipeline.export.results import RESULT_TABLES
from pipeline.monitoring.alarms.settings import AlarmSettings
from pipeline.scenario import Scenario
from pipeline.updating.structural.settings import OTHERS, StructureSettings
from sensors.feeds.payloads.mapping import Paths, PayloadMapping
from sensors.files.layout_file import LayoutFile
from sensors.settings import key_fields
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import FIGURES

HIDDEN = {"origin"}  # of a layout: set by the reader of the file


# In place of what the code says beside the field, for readers of the site: type, key → meaning.
WORDING = {
    ("Scenario", "seed"): "Seed of every random choice: loads, noise, sampler.",
    ("OmaSettings", "window_duration"): "Length of a window [s].",
    ("OmaSettings", "hop"): "Time from one window's start to the next one's [s].",
    ("OmaSettings", "lateness"): "Time for which a late block is waited for [s].",
    ("OmaSettings", "lowest_frequency"): (
        "Lowest frequency of a mode [Hz]; absent: as low as the window's length resolves."
    ),
    ("OmaSettings", "highest_frequency"): (
        "Highest frequency of a mode [Hz]; absent: 0.45 × the sampling rate."
    ),
    ("OmaSettings", "reference_channels"): (
        "Names of the channels that all are correlated with; absent: all channels."
    ),
    ("UpdatingSettings", "population"): (
        "File of a farm's prior, written by `pilewatch farm --prior`; empty: none."
    ),
    ("PriorSettings", "lowest_ratio"): "Lower bound of each spring over nominal [-].",
    ("PriorSettings", "highest_ratio"): "Upper bound of each spring over nominal [-].",
    ("PriorSettings", "highest_sigma"): "Upper bound of σ, the relative model discrepancy [-].",
    ("PairingSettings", "search_draws"): (
        "Number of points of the prior that are tried when modes are paired."
    ),
    ("PairingSettings", "refined"): "Number of the best of these from which the fit is refined.",
    ("LikelihoodSettings", "frequency_floor"): (
        "Systematic error of a frequency, as a share of it [-]."
    ),
    ("LikelihoodSettings", "shape_floor"): (
        "Systematic error of a shape's component, as a share of the largest [-]."
    ),
    ("LikelihoodSettings", "joint_covariance"): (
        "Whether the correlations between the components of one mode are kept."
    ),
    ("LikelihoodSettings", "tails"): "Distribution of each mode's discrepancy.",
    ("LikelihoodSettings", "modes"): (
        "Labels of the model's modes that are compared; empty: all of them."
    ),
    ("SamplingSettings", "method"): (
        "Sampler of an exact structure ([which one](../theory.md#samplers)); an uncertain one "
        "takes none of them."
    ),
    ("ImportanceSettings", "effective_draws"): (
        "Effective number of draws (Kish) at which sampling stops."
    ),
    ("ImportanceSettings", "draws"): "Number of draws of equal weight at the end.",
    ("TemperingSettings", "samples"): "Number of samples of the last stage, and of draws.",
    ("AcceptanceSettings", "reduced_chi_square"): (
        "Largest reduced χ² of the frequencies that is trusted [-]."
    ),
    ("AcceptanceSettings", "paired_share"): (
        "Least share of the identified modes that have a model mode [-]."
    ),
    ("AcceptanceSettings", "pairing_cost"): (
        "Largest mean pairing cost of a mode that is trusted [-]."
    ),
    ("AcceptanceSettings", "rhat"): "R-hat above which chains have not converged [-].",
    ("ChangeSettings", "years_between_false_alarms"): (
        "Mean time between two false alarms of any kind [years]."
    ),
    ("ChangeSettings", "changes_per_year"): (
        "Number of changes that is expected; it enters the reported probability of a change, "
        "not the alarm."
    ),
    ("ChangeSettings", "certainty"): (
        "Probability from which a change is called `foundation` or `modal-drift` [-]."
    ),
    ("OperationSettings", "allowed_states"): (
        "States whose windows update the foundation. A window of an unknown state is used unless "
        "it shows a state that is not in the list."
    ),
    ("RecordingSettings", "rotate_after"): (
        "Age at which a file is closed and the next one begins [s]."
    ),
    ("RecordingSettings", "rotate_megabytes"): (
        "Size at which a file is closed and the next one begins [10⁶ bytes]."
    ),
    ("RecordingSettings", "keep_days"): "Age from which samples are deleted; results stay [days].",
    ("RecordingSettings", "keep_gigabytes"): (
        "Size of all parts with samples, of earlier sessions in the folder too, above which the "
        "oldest samples are deleted [10⁹ bytes]."
    ),
    ("RecordingSettings", "free_megabytes"): "Space that stays free on the disk [10⁶ bytes].",
    ("LimitSettings", "channels"): (
        "Largest number of channels of a unit; the time for a window grows with its square."
    ),
    ("LimitSettings", "block_megabytes"): "Largest size of a block's samples [10⁶ bytes].",
    ("LimitSettings", "cpu_seconds"): (
        "CPU time of a run for one window [s]; a window that needs more is rejected."
    ),
    ("LimitSettings", "window_values"): (
        "Largest number of values of a window, samples × channels; each takes some 40 bytes while "
        "it is identified. The default is sixteen channels at 1 kHz for ten minutes."
    ),
    ("LimitSettings", "units"): "Largest number of units of a turbine.",
    ("LimitSettings", "turbines"): "Largest number of turbines; each takes 3 MB of the updating.",
    ("PayloadMapping", "values"): 'Paths of the values in a row; `""` is the row itself.',
    ("PayloadMapping", "rows"): (
        'Paths of the rows in a message; `""`, or none of them there: the message is one row.'
    ),
    ("PayloadMapping", "names"): (
        "Channels of an array: their names in its order, or the path of them in the message."
    ),
    ("PayloadMapping", "time"): (
        "Paths of a row's time. Without this key a time named `ts` is found as well, which is not "
        "read without a mapping."
    ),
    ("PayloadMapping", "earliest"): (
        "A lower number counts from the message's arrival [s], which is no time: the message is "
        "refused. SenML: `earliest = 268435456.0`, below which `-5` is five seconds ago."
    ),
    ("PayloadMapping", "name_base"): (
        'Paths of what stands before each name: `name_base = "device"` makes `acc` of '
        '`{"device": "t1/", "acc": 0.1}` the channel `t1/acc`.'
    ),
    ("PayloadMapping", "sequence_of"): (
        "Paths of what the numbers of `sequence` belong to, beside the topic, where several "
        'senders count on one topic: `sequence_of = "^properties.loggerID"`.'
    ),
    ("PayloadMapping", "carry"): (
        "Keys of a row that hold for the rows behind it too, as the base values of SenML: "
        '`carry = ["bn", "bt"]`.'
    ),
    ("LayoutFile", "layout_id"): (
        "Name of the layout, in every message, one of each unit; absent: turbine and unit, joined "
        "by a hyphen (`t1-tower`)."
    ),
    ("PayloadMapping", "rename"): (
        'Names of the message and of the layout, where they differ: `{beschl_x = "ax"}`.'
    ),
    ("MqttSettings", "host"): "Name or address of the broker.",
    ("MqttSettings", "port"): "Port of the broker; with TLS mostly 8883.",
    ("MqttSettings", "user"): "User at the broker; empty: none.",
    ("MailSettings", "host"): "Name or address of the mail server.",
    ("MailSettings", "port"): "Port of the mail server: 587 with STARTTLS, 465 with `tls`.",
    ("MailSettings", "user"): "User at the mail server; empty: none.",
    ("TurbineDescription", "source"): "Where the values come from.",
    ("TurbineDescription", "transition"): (
        "Elevation of the monopile's top, where a transition piece sits [m]; absent: not known."
    ),
    ("Calibration", "springs_sign"): "Sign of k12 in the model of the calibration.",
}


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
            meaning = sentence(WORDING.get((kind.__name__, each.name), meanings.get(each.name, "")))
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
        else:
            text = _continued(text, lines[node.end_lineno :])
        meanings[node.target.id] = text
    return meanings


def _continued(comment: str, below: list[str]) -> str:
    """The comment beside a field with the lines of comments alone that continue it."""
    for line in below if comment else ():
        if not line.strip().startswith("#"):
            break
        comment += " " + line.strip().strip("# ")
    return comment


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


EXPORT = """`pilewatch export out --csv -o tables`, or `--parquet`, writes a file of each kind that the
recording or the session's folder has; a kind without rows has no file.

- **CSV**: a header row, then UTF-8 text with commas. Times are `2026-01-01 00:10:00.000000000Z`, in
  UTC; truth values `true` and `false`. What is not known is an empty cell or `nan`. A text that a spreadsheet may take for a formula
  has a `'` in front.
- **Parquet**: the same columns under the same names, times as timestamps of nanoseconds in UTC, with
  types of their own. `reprocess` writes the same tables in folders by turbine and month.

The names below are those in the file, unit included: `table["k22_p05 [N·m/rad]"]`. A window is
named by `turbine` and `window`.

## samples-TURBINE-UNIT.csv, samples-TURBINE-UNIT.parquet

A row a sample, a file for each acquisition unit; a unit whose channels change has another,
`samples-TURBINE-UNIT-2`, from there on. Samples that are missing are missing rows.

| column | unit | meaning |
|---|---|---|
| `time [s]` (CSV), `time` (Parquet) | s | CSV: seconds since 1970-01-01 UTC; Parquet: a timestamp |
| `NAME [m/s²]`, `NAME [g]`, … | in its name | Readings of a channel, by its name in the layout; `ch1 [m/s²]`, `ch2 [m/s²]`, … where the layout is not known. |
"""  # noqa: E501 - rows of tables

# Rows of a table: file → what a row is.
EXPORT_ROWS = {
    "modes": "A row an identified mode and window.",
    "mode_shapes": "A row an identified mode, window and channel.",
    "posterior": "A row a window that has a posterior, of the windows since the last event.",
    "figures": (
        "A row an uncertain parameter of the structure or of a sensor and window; none where the "
        "structure is exact."
    ),
    "pairs": "A row an identified mode that has a model mode, and window.",
    "events": "A row an [event](../theory.md#events).",
    "rejected": "A row a window that was rejected, by the identification or by the updating.",
    "gaps": "A row a gap in the blocks of a unit.",
    "scada": "A row a SCADA sample.",
    "truth": "A row a time from which other springs hold; of simulations only.",
}
# Columns, without units: what they have, in all files or in one ("file.column").
EXPORT_COLUMNS = {
    "turbine": "Turbine id.",
    "unit": "Acquisition unit id.",
    "session": "Session id of the unit's stream: one per start of the unit.",
    "window": "Windows since the session's start, rejected ones counted, from 0.",
    "start": "Begin of the window.",
    "end": "End of the window.",
    "time": "End of the window.",
    "number": (
        "Number of the mode in its window, from 1. With `turbine` and `window` it names a mode in "
        "`modes` and `mode_shapes`."
    ),
    "mode": "Name that the mode keeps from window to window; empty while it has none.",
    "pair_id": "Two modes that cannot be separated share one; else empty.",
    "frequency": "Undamped natural frequency.",
    "frequency_std": "Its standard deviation.",
    "damping_ratio": "Share of critical damping.",
    "damping_ratio_std": "Its standard deviation.",
    "phase_collinearity": "MPC of the complex shape; 1: all channels in phase.",
    "presence": "Share of the model orders in which the mode was stable.",
    "quality": "0 (doubtful) to 1 (sure).",
    "weight": "Hop over window length: how much of the window is new.",
    "operating_state": "State of the whole window by SCADA; empty: not known.",
    "wind_speed": "At the hub; of a window its mean by SCADA.",
    "rotor_speed": "Of the rotor; of a window its mean by SCADA.",
    "yaw": "Of the nacelle, from the tower's x axis towards y; of a window its mean by SCADA.",
    "water_level": "Above the mean water level; of a window its mean by SCADA.",
    "channel": "Name of the channel.",
    "component": "Component of the shape; the largest of a mode is 1.",
    "component_std": "Its standard deviation; 0 of the largest one, which is 1 by definition.",
    "windows": "Number of windows that entered since the last event.",
    "k_median": "Median of the spring.",
    "k_p05": "5 % quantile: lower end of the 90 % interval.",
    "k_p95": "95 % quantile: upper end of the 90 % interval.",
    "k_nominal": "The description's value.",
    "sigma_median": "Median of σ, the relative discrepancy between model and truth.",
    "sigma_p05": "5 % quantile of σ.",
    "sigma_p95": "95 % quantile of σ.",
    "correlation_k11_k22": "Correlation of the two springs in the posterior.",
    "correlation_k11_k12": "Likewise.",
    "correlation_k22_k12": "Likewise.",
    "sampler": "`laplace`, `importance`, `emcee`, …",
    "ess": "Smallest effective number of draws over the parameters.",
    "rhat": "Largest split-R̂ over the parameters; `nan` with `laplace`.",
    "reduced_chi_square": "Of the paired frequencies at σ = 0.",
    "paired_share": "Share of the identified modes that have a model mode.",
    "pairing_cost": "Mean pairing cost of an identified mode.",
    "change_probability": "Probability that the modes have changed since the last event.",
    "trusted": (
        "Whether no check contradicts the posterior "
        "([the checks](../theory.md#when-a-posterior-is-not-to-be-trusted))."
    ),
    "doubts": "Its warnings, `code: text`, apart by `; `; empty: none.",
    "figure": "Key of the parameter, such as `steel_modulus`; of a sensor `gain NAME` or alike.",
    "figures.unit": "Unit of the parameter, and of the next three columns.",
    "median": "Median [in `unit`].",
    "p05": "5 % quantile [in `unit`].",
    "p95": "95 % quantile [in `unit`].",
    "contraction": "1 − width of the interval over the prior's; 0: nothing was learned.",
    "identified": (
        "Name of the identified mode, as `mode` of `modes`; `m1+m2`: the mean of two that cannot "
        "be separated."
    ),
    "model": "Label of the model mode.",
    "pairs.frequency": "Identified frequency.",
    "model_frequency": "The model's, at the median of the posterior.",
    "mac": "Modal assurance criterion of the two shapes.",
    "shape_used": "Whether the shape entered the likelihood; false: the frequency alone.",
    "misfit": "Of the frequency, in standard deviations of the posterior's prediction.",
    "information": "The mode's share of what all modes tell of the springs.",
    "events.time": "End of the window in which the event was noticed.",
    "kind": "`foundation`, `modal-drift` or `undecided`.",
    "probability": "Probability that there was a change at all.",
    "since": "Start of the first window after the change, most probably.",
    "since_earliest": "Its 5 % quantile.",
    "since_latest": "Its 95 % quantile.",
    "k_change_median": "Change of the spring, a share of what it was; empty of a modal drift.",
    "k_change_p05": "Its 5 % quantile.",
    "k_change_p95": "Its 95 % quantile.",
    "text": "One sentence.",
    "code": "[Code](warnings.md) of the reason.",
    "reason": "The reason, in words.",
    "gaps.start": "Where the missing samples begin.",
    "gaps.end": "Where samples go on.",
    "duration": "From `start` to `end`.",
    "first_sequence": "Number of the first missing block.",
    "blocks": "Number of missing blocks.",
    "scada.time": "Time of the sample.",
    "state": "`parked`, `idling`, `start`, `operating` or `stop`; empty: not known.",
    "pitch": "Of the blades; 90 is feathered.",
    "power": "Electrical power.",
    "truth.time": "From when it holds.",
    "k": "True spring.",
}
SPRING = re.compile(r"^k(?:11|22|12)(?=_|$)")
TIMES = "UTC"  # in place of a unit


def column_parts(title: str) -> tuple[str, str]:
    """A column's name and its unit; "" where it has none."""
    name, _, unit = title.partition(" [")
    return name, unit.removesuffix("]")


def column_meaning(table: str, name: str) -> str:
    """What a column of an export has; KeyError where that is not written yet."""
    of_table, of_any = f"{table}.{name}", SPRING.sub("k", name)
    return EXPORT_COLUMNS[of_table if of_table in EXPORT_COLUMNS else of_any]


def export_tables() -> str:
    """Every file of an export with its columns, as they stand in the file."""
    lines = []
    for table in RESULT_TABLES:
        lines += [f"## {table.name}.csv, {table.name}.parquet", "", EXPORT_ROWS[table.name], ""]
        lines += ["| column | unit | meaning |", "|---|---|---|"]
        for field in table.schema:
            name, unit = column_parts(field.name)
            shown = unit or (TIMES if str(field.type).startswith("timestamp") else "")
            lines.append(f"| `{field.name}` | {shown} | {column_meaning(table.name, name)} |")
        lines.append("")
    return "\n".join(lines)


EXPORT_IMU = """## imu.mcap

`pilewatch export out --imu -o tables` writes the samples alone, for Foxglove, PlotJuggler and RViz:
topic `/TURBINE/UNIT/z145/imu` of each height, one message `sensor_msgs/msg/Imu` of ROS 2 (CDR) a
sample. `linear_acceleration` has x fore-aft, y side-side, z up [m/s²]; an axis that no sensor
measures is NaN.
"""


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
        "reference/export.md": f"# Files of an export\n\n{EXPORT}\n{export_tables()}\n{EXPORT_IMU}",
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
