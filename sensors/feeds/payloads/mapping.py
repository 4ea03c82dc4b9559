"""A declared payload mapping: where a message has its samples, names, times and numbers.

    [mapping]
    rows = "data"                      # list of samples, or object by $key; "": the message
    time = "time"                      # in a row; "^a.b" is looked up in the whole message
    time_unit = "auto"                 # auto (ISO 8601, or by size), s, ms, us, ns
    values = "vals"                    # object {name: number}, list (with `names`), or one number
    names = "^head.fields[].name"      # of a list's numbers, or of a row's one number; or the
                                       # names themselves: ["ax", "ay"]
    sequence = "no"                    # counts messages (^…) or rows one by one

A path is keys joined by dots: `a.b`, `a[0]`, `a[]` (each element), `$key`, `$topic[-1]` (a level of
the topic), `""` (the row itself). Where a list of paths is given, the first that is there counts.
The numbers of a list without names are channels `PATH.0`, `PATH.1`, …, or the samples of the
channel `PATH` if the layout has it.
"""

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import Any

from sensors.feeds.protocol import FeedError
from sensors.settings import settings_from_table, toml_table

TIME_UNITS = {"auto": 0, "s": 10**9, "ms": 10**6, "us": 10**3, "ns": 1}  # [ns]
DECODERS = ("json", "sparkplug-b")
TIMESTAMP_FORMATS = ("first", "last")
PRESETS = Path(__file__).with_name("presets.toml")

Paths = tuple[str, ...]
_STEP = re.compile(r"([^.\[\]]+)|\[(-?\d*)\]")


@dataclass(frozen=True, slots=True)
class PayloadMapping:
    """Where the messages of one sender have what samples need."""

    time: Paths = ("time", "timestamp", "ts", "t")
    """Paths of a row's time. Without this key a time named `ts` is found as well, which is not
    read without a mapping.
    """
    values: Paths = ("",)
    """Paths of the values in a row; `""` is the row itself."""
    decode: str = "json"
    """What the bytes are: "json" or "sparkplug-b"."""
    rows: Paths = ("",)
    """Paths of the rows in a message; `""`, or none of them there: the message is one row."""
    time_base: Paths = ()
    """Paths of a time that is added to the row's [in `time_unit`]."""
    time_unit: str = "auto"
    """Of numbers since 1970: "s", "ms", "us", "ns"; "auto": by their size, or ISO 8601."""
    earliest: float = 0.0
    """A lower number counts from the message's arrival [s], which is no time: the message is
    refused. SenML: `earliest = 268435456.0`, below which `-5` is five seconds ago.
    """
    stamp: str = "first"
    """Which sample of a list the time is of: "first" or "last"."""
    names: Paths = ()
    """Channels of an array: their names in its order, or the path of them in the message."""
    name_base: Paths = ()
    """Paths of what stands before each name: `name_base = "device"` makes `acc` of `{"device":
    "t1/", "acc": 0.1}` the channel `t1/acc`.
    """
    only: str = ""
    """Regular expression of the names that are channels; "": all that have numbers."""
    value: Paths = ("value", "Value.Body", "Value", "Body", "v")
    """Paths of the number in a value that is an object."""
    value_base: Paths = ()
    """Paths of a number that is added to each value."""
    unit: Paths = ()
    """Paths of the unit: a word, or as many as names; in a value that is an object, its own."""
    rate: Paths = ()
    """Paths of the sampling rate of lists [Hz]."""
    sampling_rate: float | None = None
    """Sampling rate of lists, if no message has it [Hz]."""
    sequence: Paths = ()
    """Paths of the number of the message (^…) or of the row."""
    sequence_of: Paths = ()
    """Paths of what the numbers of `sequence` belong to, beside the topic, where several
    senders count on one topic: `sequence_of = "^properties.loggerID"`.
    """
    sequence_modulus: int = 0
    """The number after which they start again at 0; 0: they do not [-]."""
    carry: tuple[str, ...] = ()
    """Keys of a row that hold for the rows behind it too, as the base values of SenML: `carry
    = ["bn", "bt"]`.
    """
    rename: tuple[str, ...] = ()
    """Names of the message and of the layout, where they differ: `{beschl_x = "ax"}`."""

    def __post_init__(self) -> None:
        for key, value, known in (
            ("decode", self.decode, DECODERS),
            ("time_unit", self.time_unit, tuple(TIME_UNITS)),
            ("stamp", self.stamp, TIMESTAMP_FORMATS),
        ):
            if value not in known:
                raise FeedError(f"{key} is {value!r}; it is one of {', '.join(known)}")
        try:
            re.compile(self.only)
        except re.error as error:
            raise FeedError(f"only is {self.only!r}, no regular expression: {error}") from error


def mapping_from_table(table: Mapping[str, Any], where: str) -> PayloadMapping:
    """The mapping of a TOML table; one path may stand without brackets. Raises FeedError."""
    table_of = {
        key: (value,) if key in _PATH_KEYS and isinstance(value, str) else value
        for key, value in table.items()
    }
    rate = table.get("rate")
    if isinstance(rate, int | float):
        raise FeedError(
            f"{where}: rate is {rate!r}; it is the key that has the rate in a message: a fixed one "
            f"is sampling_rate = {rate!r}, or ?rate={rate!r} in the address"
        )
    rename = table_of.get("rename", {})
    if not isinstance(rename, dict) or not all(isinstance(v, str) for v in rename.values()):
        raise FeedError(f"{where}: rename is {rename!r}; it is a table like {{ai1 = 'ax'}}")
    if rename:
        table_of["rename"] = tuple(f"{theirs}={ours}" for theirs, ours in rename.items())
    listed = {
        key: list(value) if isinstance(value, tuple) else value for key, value in table_of.items()
    }
    return settings_from_table(PayloadMapping, listed, where, FeedError)


_PATH_KEYS = frozenset(
    each.name for each in fields(PayloadMapping) if each.type == "Paths" or each.type is Paths
)


@cache
def presets() -> Mapping[str, PayloadMapping]:
    """The shipped mappings by name."""
    tables = tomllib.loads(PRESETS.read_text("utf-8"))
    return {name: mapping_from_table(table, name) for name, table in tables.items()}


def mapping_named(text: str) -> PayloadMapping:
    """A preset, or the mapping of a TOML file with a section [mapping].

    Raises
    ------
    FeedError
        If it is neither, or the file has an unknown key or a wrong value.
    """
    if text in presets():
        return presets()[text]
    try:
        content = Path(text).read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise FeedError(
            f"mapping={text} is neither a file nor one of {', '.join(presets())}"
        ) from error
    table = toml_table(content, text, FeedError)
    if not isinstance(table.get("mapping"), dict):
        raise FeedError(f"{text}: the section [mapping] is missing")
    return mapping_from_table(table["mapping"], f"{text} [mapping]")


@cache
def _steps(path: str) -> tuple[str | int | None, ...]:
    """Keys, indices, and None for "each element"."""
    return tuple(
        key if key else (int(index) if index else None) for key, index in _STEP.findall(path)
    )


def looked_up(content: Any, path: str) -> Any:
    """What a path leads to; None if it leads nowhere."""
    return _followed(content, _steps(path))


def _followed(content: Any, steps: tuple[str | int | None, ...]) -> Any:
    for at, step in enumerate(steps):
        if step is None:
            if not isinstance(content, list):
                return None
            return [_followed(each, steps[at + 1 :]) for each in content]
        if isinstance(step, int):
            if not isinstance(content, list) or not -len(content) <= step < len(content):
                return None
            content = content[step]
        elif isinstance(content, dict) and step in content:
            content = content[step]
        else:
            return None
    return content
