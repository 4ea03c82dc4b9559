"""What a sender's messages are, and which mapping reads them: `pilewatch feed … --sniff`."""

import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.payloads.json_samples import JsonReader, MessageError, json_of
from sensors.feeds.payloads.mapped_reader import MappedReader, number_in
from sensors.feeds.payloads.mapping import PayloadMapping, looked_up, presets
from sensors.feeds.payloads.timestamps import moment_ns
from sensors.feeds.protocol import ChannelSamples, FeedCounts

EARLIEST_NS = 946_684_800 * NANOSECONDS  # the year 2000: what is before is no time of a sample
DEEPEST_SNIFFED = 6  # levels of objects
MOST_ARRAY_CHANNELS = 64  # numbers of a list that are one sample of as many channels
_RATES = ("rate", "sampling_rate", "sample_rate", "samplerate", "sampling_frequency", "fs", "hz")
_COUNTERS = ("sequence", "seq", "no", "nr", "n", "number", "counter", "count", "id", "session")
ORDER = (  # what asks most of a message first
    *("csijson", "campbell-geojson", "sparkplug-b", "senml", "opcua-pubsub-json", "telegraf"),
    *("thingsboard", "wise", "teltonika", "json", "nested", "proposed"),
)


@dataclass(frozen=True, slots=True)
class Sniffed:
    """What some messages of a sender are."""

    mapping: str
    """A preset's name, "json" or "proposed"; "": nothing reads them."""
    toml: str
    """Section [mapping] that is proposed; "" if a preset reads them."""
    channels: dict[str, int]
    """Samples by channel [-]."""
    units: tuple[str, ...]
    """Units that the messages have."""
    sampling_rate: float
    """Median rate of a channel's samples [Hz]; NaN if there are too few."""
    refused: int
    """Messages that the mapping does not read [-]."""
    reason: str = ""
    """Why nothing reads them, if that is known."""
    is_text: bool = False
    """Whether the numbers are written as text: then a feed reads channels of its layout alone."""


def sniffed(messages: Sequence[tuple[str, bytes]]) -> Sniffed:
    """Find the mapping that reads most of some messages.

    Parameters
    ----------
    messages : sequence of (str, bytes)
        Topics and payloads, in order.
    """
    readers: dict[str, Any] = {"json": JsonReader((), FeedCounts())}
    readers |= {name: MappedReader(each, (), FeedCounts()) for name, each in presets().items()}
    proposal = proposed(messages)
    if proposal is not None:
        readers["proposed"] = MappedReader(proposal, (), FeedCounts())
    read = {name: _read(reader, messages) for name, reader in readers.items()}
    best = min(read, key=lambda name: (read[name][1], ORDER.index(name)))
    pieces, refused = read[best]
    if not pieces:
        return _sniffed_as_text(messages) or Sniffed(
            "", "", {}, (), float("nan"), len(messages), _why_none(messages)
        )
    toml = (
        toml_of(proposal, _by_place(proposal, pieces))
        if best == "proposed" and proposal is not None
        else ""
    )
    channels: Counter[str] = Counter()
    for piece in pieces:
        channels.update({name: len(piece.samples) for name in piece.names})
    units = tuple(sorted({piece.unit for piece in pieces if piece.unit}))
    return Sniffed(best, toml, dict(channels), units, _rate(pieces), refused)


def _sniffed_as_text(messages: Sequence[tuple[str, bytes]]) -> Sniffed | None:
    """The same of messages with all their numbers in text; None if they have none, or nothing reads
    them either."""
    rewritten = [(topic, _with_numbers(payload)) for topic, payload in messages]
    if rewritten == list(messages):
        return None
    found = sniffed(rewritten)
    return replace(found, is_text=True) if found.mapping else None


def _with_numbers(payload: bytes) -> bytes:
    """A JSON message with numbers where it has them as text; any other as it is."""
    try:
        message = json_of(payload)
    except MessageError:
        return payload
    changed = _as_numbers(message, 0)
    return payload if changed == message else json.dumps(changed).encode()


def _as_numbers(content: Any, depth: int) -> Any:
    if depth > DEEPEST_SNIFFED:
        return content
    if isinstance(content, dict):
        return {key: _as_numbers(inner, depth + 1) for key, inner in content.items()}
    if isinstance(content, list):
        return [_as_numbers(inner, depth + 1) for inner in content]
    return content if number_in(content) is math.nan else number_in(content)


def _by_place(mapping: PayloadMapping, pieces: Sequence[ChannelSamples]) -> str:
    """Names of channels that are single numbers of one list; "" if there are none."""
    first = pieces[0]
    by_place = [name for name in first.names if name.startswith(f"{mapping.values[0]}.")]
    if len(first.samples) > 1 or not all(name.rpartition(".")[2].isdigit() for name in by_place):
        return ""
    return f"{by_place[0]} … {by_place[-1]}" if len(by_place) > 1 else ""


def _read(reader: Any, messages: Sequence[tuple[str, bytes]]) -> tuple[list[ChannelSamples], int]:
    """The plausible pieces, and how many messages have none."""
    pieces: list[ChannelSamples] = []
    refused = 0
    for topic, payload in messages:
        try:
            found = [each for each in reader.read(payload, topic) if _is_plausible(each)]
        except MessageError:
            found = []
        pieces += found
        refused += not found
    return pieces, refused


def _is_plausible(piece: ChannelSamples) -> bool:
    """Whether the time is one of a sample, and several have a rate, without which no feed takes
    them."""
    has_rate = len(piece.samples) == 1 or piece.sampling_rate is not None
    return piece.start_ns > EARLIEST_NS and has_rate


def _rate(pieces: Sequence[ChannelSamples]) -> float:
    said = [piece.sampling_rate for piece in pieces if piece.sampling_rate]
    if said:
        return float(np.median(said))
    name = pieces[0].names[0]
    times = [piece.start_ns for piece in pieces if name in piece.names]
    steps = [later - earlier for earlier, later in pairwise(times) if later > earlier]
    return NANOSECONDS / float(np.median(steps)) if len(steps) > 1 else float("nan")


def proposed(messages: Sequence[tuple[str, bytes]]) -> PayloadMapping | None:
    """A mapping made from the messages' own keys; None if they have no time or no numbers."""
    for _, payload in messages:
        try:
            message = json_of(payload)
        except MessageError:
            continue
        rows = _list_of_rows(message, "", 0)
        row = message if rows is None else _of_path(message, rows)[0]
        here = list(_times(row, "", 0))
        times = here or [f"^{path}" for path in _times(message, "", 0)]
        values = _values_path(row)
        rates = [*_rate_keys(row, "", 0), *(f"^{path}" for path in _rate_keys(message, "", 0))]
        if times and values is not None:
            return PayloadMapping(
                time=(times[0],),
                values=(values,),
                rows=("" if rows is None else rows,),
                rate=tuple(rates[:1]),
            )
    return None


def _why_none(messages: Sequence[tuple[str, bytes]]) -> str:
    """That no message has a time, or that lists of samples have no rate, and which one their number
    and the times show; "" if it is neither."""
    mapping = proposed(messages)
    if mapping is None:
        return _no_time(messages)
    if mapping.rate:
        return ""
    with_rate = replace(mapping, sampling_rate=1.0)
    pieces, _ = _read(MappedReader(with_rate, (), FeedCounts()), messages)
    lists = [piece for piece in pieces if len(piece.samples) > 1]
    if not lists:
        return ""
    count = len(lists[0].samples)
    steps = [later.start_ns - earlier.start_ns for earlier, later in pairwise(lists)]
    reason = (
        f"{', '.join(lists[0].names[:4])}: lists of {count} samples, and no message has their rate"
    )
    if any(step > 0 for step in steps):
        step_ns = float(np.median([step for step in steps if step > 0]))
        reason += f" (by the times {count * NANOSECONDS / step_ns:.6g} Hz)"
    paths = toml_of(mapping).removeprefix("[mapping]\n").replace("\n", ", ")
    return f"{reason}; in a file with [mapping] {paths} and sampling_rate = HZ read them"


def _no_time(messages: Sequence[tuple[str, bytes]]) -> str:
    """That JSON messages have no time; "" if one has, or none is JSON."""
    contents = []
    for _, payload in messages:
        with suppress(MessageError):
            contents.append(json_of(payload))
    rows = [each[0] if isinstance(each, list) and each else each for each in contents]
    if not rows or any(True for row in rows for _ in _times(row, "", 0)):
        return ""
    return "no message has a time, and the time of arrival is never taken for it"


def _rate_keys(content: Any, path: str, depth: int) -> Iterator[str]:
    """Paths of what can be the sampling rate, by their last key."""
    if isinstance(content, dict) and depth < DEEPEST_SNIFFED:
        for key, inner in content.items():
            yield from _rate_keys(inner, f"{path}.{key}" if path else key, depth + 1)
    elif _is_number(content) and path.rpartition(".")[2].lower() in _RATES:
        yield path


def _of_path(message: Any, path: str) -> Any:
    for key in filter(None, path.split(".")):
        message = message[key]
    return message


def _list_of_rows(content: Any, path: str, depth: int) -> str | None:
    """Path of the first list of objects."""
    if isinstance(content, list) and content and isinstance(content[0], dict):
        return path
    if isinstance(content, dict) and depth < DEEPEST_SNIFFED:
        for key, inner in content.items():
            found = _list_of_rows(inner, f"{path}.{key}" if path else key, depth + 1)
            if found is not None:
                return found
    return None


def _times(content: Any, path: str, depth: int) -> Iterator[str]:
    """Paths of what can be the time of a sample."""
    if isinstance(content, dict) and depth < DEEPEST_SNIFFED:
        for key, inner in content.items():
            yield from _times(inner, f"{path}.{key}" if path else key, depth + 1)
        return
    try:
        if path and moment_ns(content) > EARLIEST_NS:
            yield path
    except (ValueError, OverflowError):
        return


def _values_path(row: Any) -> str | None:
    """Path of the object or array with the most numbers or lists directly in it; of several, the
    first. A list that has a rate, or others beside it, is the samples of one channel."""
    counts = {path: _count_numbers(content) for path, content in _objects(row, "", 0)}
    arrays = dict(_arrays(row, "", 0))
    flat = [path for path, content in arrays.items() if _is_number(content[0])]
    if len(flat) > 1 or any(True for _ in _rate_keys(row, "", 0)):
        arrays = {path: content for path, content in arrays.items() if path not in flat}
    counts |= {path: len(content) for path, content in arrays.items()}
    best = max(counts, key=lambda path: counts[path], default=None)
    return best if best is not None and counts[best] else None


def _objects(content: Any, path: str, depth: int) -> Iterator[tuple[str, dict[str, Any]]]:
    if isinstance(content, dict) and depth < DEEPEST_SNIFFED:
        yield path, content
        for key, inner in content.items():
            yield from _objects(inner, f"{path}.{key}" if path else key, depth + 1)


def _arrays(content: Any, path: str, depth: int) -> Iterator[tuple[str, list[Any]]]:
    """Lists of as many numbers, or lists of numbers, as a unit can have channels."""
    if isinstance(content, dict) and depth < DEEPEST_SNIFFED:
        for key, inner in content.items():
            yield from _arrays(inner, f"{path}.{key}" if path else key, depth + 1)
    elif isinstance(content, list) and 1 < len(content) <= MOST_ARRAY_CHANNELS:
        numbers = all(each is None or _is_number(each) for each in content)
        lists = all(isinstance(each, list) and each and _is_number(each[0]) for each in content)
        if lists or (numbers and content[0] is not None):
            yield path, content


def _count_numbers(content: dict[str, Any]) -> int:
    """Numbers, lists of them and objects around one, that are no time."""
    others = {*_RATES, *_COUNTERS}
    found = (_number_in(inner) for key, inner in content.items() if key.lower() not in others)
    return sum(each is not None and not list(_times(each, "x", 0)) for each in found)


def _number_in(content: Any) -> float | int | None:
    """The first number of a value; None if it has none."""
    if isinstance(content, dict):
        inner = (looked_up(content, path) for path in PayloadMapping().value)
        content = next((each for each in inner if each is not None), None)
    if isinstance(content, list) and content:
        content = content[0]
    return content if _is_number(content) else None


def _is_number(content: Any) -> bool:
    return isinstance(content, int | float) and not isinstance(content, bool)


def toml_of(mapping: PayloadMapping, by_place: str = "") -> str:
    """The section of a TOML file, with a comment on what could be understood otherwise: channels
    that are named by their places in a list."""
    lines = ["[mapping]"]
    for key in ("rows", "time", "values", *(["rate"] if mapping.rate else [])):
        paths = getattr(mapping, key)
        lines.append(f"{key} = " + ", ".join(f'"{path}"' for path in paths))
    if by_place:
        lines.append(f"# {by_place}: as many channels; if they are samples of one channel, add")
        lines.append('# names = "NAME" and sampling_rate = HZ')
    return "\n".join(lines)
