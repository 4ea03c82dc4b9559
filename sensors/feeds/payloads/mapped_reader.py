"""Messages of a declared mapping → samples."""

import math
import re
from collections.abc import Collection, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS
from sensors.bounded_dict import BoundedDict
from sensors.feeds.payloads.frame import HIGHEST_RATE, LOWEST_RATE
from sensors.feeds.payloads.json_samples import MessageError, json_of
from sensors.feeds.payloads.mapping import TIME_UNITS, PayloadMapping, looked_up
from sensors.feeds.payloads.payload_place import PayloadPlace
from sensors.feeds.payloads.sequence_numbers import SenderNumbers
from sensors.feeds.payloads.sparkplug import NAMESPACE, RebirthRequests, SparkplugDecoder
from sensors.feeds.payloads.timestamps import LATEST_NS, moment_ns
from sensors.feeds.protocol import ChannelSamples, FeedCounts
from sensors.files.missing_values import is_missing

MOST_SAMPLE_ROWS = 100_000  # of one message
DEEPEST_PAYLOAD = 6  # levels of values in values
BIRTHS_KNOWN = 4  # of a node, so that one that comes again begins nothing
_INFINITE = frozenset({"inf", "-inf", "+inf"})
_WHOLE = re.compile(r"[+-]?[0-9]{1,20}")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


@dataclass(frozen=True, slots=True)
class Value:
    """One channel's numbers in a row."""

    name: str
    """As the sender has it."""
    numbers: tuple[float, ...]
    """Samples, in order."""
    unit: str
    """As the message has it; "" if it does not."""


class _Moment(NamedTuple):
    """What the values of one piece have in common."""

    start_ns: int
    unit: str
    rate: float | None
    number: str  # of the message or row; "" if there is none


class MappedReader:
    """Reads the messages of one feed by a mapping.

    Parameters
    ----------
    mapping : PayloadMapping
        Where the messages have what.
    listed : collection of str
        Names of the layout's channels; values of other names are given too, and counted there.
    counts : FeedCounts
        Takes what is lost, late or duplicate.
    sampling_rate : float or None
        Of lists, if no message has it [Hz].
    rebirths : RebirthRequests, optional
        Takes Sparkplug B nodes whose birth certificates did not come; None: none is asked.
    """

    def __init__(
        self,
        mapping: PayloadMapping,
        listed: Collection[str],
        counts: FeedCounts,
        sampling_rate: float | None = None,
        rebirths: RebirthRequests | None = None,
    ) -> None:
        self._mapping = mapping
        self._listed = frozenset(listed)
        self._rate = sampling_rate or mapping.sampling_rate
        self._only = re.compile(mapping.only)
        self._rename = dict(each.split("=", 1) for each in mapping.rename if "=" in each)
        self._counts, self._numbers = counts, SenderNumbers(counts)
        self._sparkplug = SparkplugDecoder(rebirths)
        self._unwrapped: BoundedDict[tuple[str, int], int] = BoundedDict()  # by sender and session
        self._births: BoundedDict[str, tuple[int, ...]] = (
            BoundedDict()
        )  # of a node, the newest last

    def read(self, payload: bytes, topic: str) -> Iterator[ChannelSamples]:
        """The samples of a message, one piece a time and unit.

        Parameters
        ----------
        payload : bytes
            The message as it came.
        topic : str
            Under which it came.

        Raises
        ------
        MessageError
            If it has none where the mapping expects them.
        """
        mapping = self._mapping
        if mapping.decode == "json":
            message = json_of(payload)
        else:
            message = self._sparkplug.decoded(topic, payload)
        session = self._session(message, topic)
        groups: dict[_Moment, list[Value]] = {}
        follows: dict[str, bool | None] = {"": None}
        rows = list(self._rows(message, topic))
        for place in rows:
            values = list(self._values(place))
            number = self._number_of(place)
            if values:
                start_ns, rate = self._timing(place, self._count_samples(values))
            elif number:  # all its values are text or truth values: it is not missing
                start_ns, rate = _time_ns(place, mapping), None
            else:
                continue
            if number not in follows:
                follows[number] = self._follows(number, topic, session, start_ns)
                if follows[number] is None:
                    continue
            elif number and follows[number] is None:
                continue  # a row of a message that is late or came twice
            for value in values:
                groups.setdefault(_Moment(start_ns, value.unit, rate, number), []).append(value)
        if len(follows) == 1:  # no row had a number
            self._count_without_rows(message, topic, session)
        if rows and mapping.decode == "json" and not any(p.has(mapping.values) for p in rows):
            raise MessageError(f"no values at {' or '.join(mapping.values)}")
        yield from self._pieces(groups, follows, topic)

    def learn(self, payload: bytes, topic: str) -> None:
        """Take the names of a birth certificate of before, and neither samples nor number."""
        if self._mapping.decode != "json":
            self._sparkplug.decoded(topic, payload)

    def _session(self, message: Any, topic: str) -> int:
        """Which start of its sender a message is of: a node counts from its birth certificate on,
        which may come twice. 0: no certificate came, or there is no such thing."""
        if self._mapping.decode != "sparkplug-b":
            return 0
        sender = _sender(topic, self._mapping)
        births = self._births.renewed(sender) or (0,)
        if not _is_node_birth(topic):
            return births[-1]
        born: int = message.get("timestamp", births[-1] + 1)
        if born not in births:
            self._births.put(sender, (*births[1 - BIRTHS_KNOWN :], born))
        return born

    def _count_without_rows(self, message: Any, topic: str, session: int) -> None:
        """Take note of the number of a message without rows (a device's death)."""
        numbered = tuple(path for path in self._mapping.sequence if path.startswith("^"))
        place = PayloadPlace(message, message, "", topic)
        if place.first(numbered) is None:
            return
        number = self._number_of(place)
        with suppress(MessageError):  # without a time it cannot be told from another start
            self._follows(number, topic, session, _time_ns(place, self._mapping))

    def _rows(self, message: Any, topic: str) -> Iterator[PayloadPlace]:
        found = PayloadPlace(message, message, "", topic).first(self._mapping.rows)
        if found is None:
            raise MessageError(f"nothing at {' or '.join(self._mapping.rows)}")
        keyed = self._mapping.time == ("$key",) and isinstance(found, dict)
        if keyed:
            rows = list(found.items())
        else:
            rows = [("", each) for each in (found if isinstance(found, list) else [found])]
        if len(rows) > MOST_SAMPLE_ROWS:
            raise MessageError(f"{len(rows)} rows; at most {MOST_SAMPLE_ROWS}")
        carried: dict[str, Any] = {}
        for key, row in rows:
            if self._mapping.carry and isinstance(row, dict):
                carried |= {each: row[each] for each in self._mapping.carry if each in row}
                yield PayloadPlace(message, carried | row, key, topic)
            else:
                yield PayloadPlace(message, row, key, topic)

    def _values(self, place: PayloadPlace) -> Iterator[Value]:
        """Every number of a row that has a name, with its unit."""
        mapping = self._mapping
        found = place.first(mapping.values)
        units = place.first(mapping.unit)
        base = place.first(mapping.name_base) or ""
        value_base = number_in(place.first(mapping.value_base)) or 0
        if not _is_number(value_base):
            raise MessageError(f"{value_base!r:.20} is no number to add to values")
        named = list(self._named(place, found, base))
        for at, (name, content) in enumerate(named):
            own = str(content.get("unit", "")) if isinstance(content, dict) else ""
            given = units[at] if isinstance(units, list) and at < len(units) else units
            unit = own or (given if isinstance(given, str) else "")
            if mapping.only and not self._only.fullmatch(name):
                continue
            full = f"{base}{name}"
            channel = self._rename.get(full, full)
            samples = self._samples(channel, self._unwrap(content), place.topic)
            if samples is None:
                continue
            if value_base:
                samples = tuple(each + value_base for each in samples)
            yield Value(channel, samples, unit)

    def _named(self, place: PayloadPlace, found: Any, base: str) -> Iterator[tuple[str, Any]]:
        """Names and values of what is found at the path of the values."""
        mapping = self._mapping
        if found is None:
            return
        if isinstance(found, dict):
            for name, content in self._flattened(found, "", 0):
                yield from self._by_place(name, content, base)
            return
        items = found if isinstance(found, list) else [found]
        names = self._names_of(place, len(items))
        if isinstance(names, list):
            if len(names) != len(items):
                raise MessageError(f"{len(items)} values for {len(names)} names")
            yield from zip(map(str, names), items, strict=True)
        elif names is not None or base:
            yield str(names or ""), found
        elif mapping.names and mapping.decode == "json":
            raise MessageError(f"{len(items)} values and no names at {' or '.join(mapping.names)}")
        elif not mapping.names:
            yield from self._named_by_path(place, found)

    def _names_of(self, place: PayloadPlace, count: int) -> Any:
        """Names that the mapping lists itself, or that a path leads to; None if there are none."""
        written = self._mapping.names
        are_listed = all(self._is_listed(name) for name in written)
        if len(written) == count > 1 and are_listed:
            return list(written)
        names = place.first(written)
        if len(written) == 1 and are_listed and not isinstance(names, str | list):
            return written[0]
        if names is None and len(written) == count > 1:
            return list(written)
        return names

    def _named_by_path(self, place: PayloadPlace, found: Any) -> Iterator[tuple[str, Any]]:
        """Values without names: a list's numbers are channels `path.0`, `path.1`, …, unless the
        layout lists `path`."""
        mapping = self._mapping
        path = next(each for each in mapping.values if place.first((each,)) is not None)
        if path in {*mapping.time, *mapping.sequence, *mapping.sequence_of, *mapping.rate}:
            return
        name = path.removeprefix("^")
        if isinstance(found, list) and not self._is_listed(name):
            for at, content in enumerate(found):
                yield _name_at(name, at), content
        else:
            yield name, found

    def _by_place(self, name: str, content: Any, base: str) -> Iterator[tuple[str, Any]]:
        """A list of a named value is its samples, unless the layout lists `name.0` or another
        place of it, or it has lists itself."""
        if isinstance(content, list) and content and not self._is_listed(base + name):
            places = [_name_at(name, at) for at in range(len(content))]
            if all(isinstance(each, list) for each in content) or any(
                self._is_listed(base + each) for each in places
            ):
                yield from zip(places, content, strict=True)
                return
        yield name, content

    def _is_listed(self, name: str) -> bool:
        """Whether the layout lists what a name of the sender stands for."""
        return self._rename.get(name, name) in self._listed

    def _count_samples(self, values: list[Value]) -> int:
        """Samples of a row: those of the layout's channels, if it has any of them."""
        listed = [len(each.numbers) for each in values if each.name in self._listed]
        return max(listed) if listed else min(len(each.numbers) for each in values)

    def _samples(self, channel: str, content: Any, topic: str) -> tuple[float, ...] | None:
        """The numbers of a value; text counts as one for channels of the layout alone, since others
        may be serial numbers and versions."""
        samples = _numbers(content)
        if samples is not None or channel not in self._listed:
            return samples
        items = content if isinstance(content, list) else [content]
        numbers = [number_in(each) for each in items]
        if not isinstance(content, list) and (content is None or numbers[0] is math.nan):
            return None  # no sample was taken
        samples = _numbers(numbers)
        if samples is None:
            self._counts.refuse(f"{topic}: {channel} is {content!r:.40}, which is no number")
        return samples

    def _flattened(
        self, values: dict[str, Any], prefix: str, depth: int
    ) -> Iterator[tuple[str, Any]]:
        """Names and values, those of inner objects as "outer.inner"."""
        mapping = self._mapping
        words = {path for paths in (mapping.time, mapping.sequence, mapping.rate) for path in paths}
        words |= {path.removeprefix("^") for path in words}
        for key, content in values.items():
            name = f"{prefix}{key}"
            if name in words and name not in self._listed:
                continue
            if isinstance(content, dict) and self._unwrap(content) is content:
                if depth < DEEPEST_PAYLOAD:
                    yield from self._flattened(content, f"{name}.", depth + 1)
            else:
                yield name, content

    def _unwrap(self, content: Any) -> Any:
        """The number in an object that holds one; the object itself if it does not."""
        if not isinstance(content, dict):
            return content
        for path in self._mapping.value:
            inner = looked_up(content, path)
            if inner is not None and not isinstance(inner, dict):
                return inner
        return content

    def _timing(self, place: PayloadPlace, count: int) -> tuple[int, float | None]:
        """Time of a row's first sample [ns], and the rate of several [Hz]."""
        mapping = self._mapping
        time_ns = _time_ns(place, mapping)
        rate = number_in(place.first(mapping.rate))
        rate = self._rate if rate is None else rate
        if rate is not None and not (_is_number(rate) and LOWEST_RATE <= rate <= HIGHEST_RATE):
            raise MessageError(f"rate is {rate!r:.20}; {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz")
        if count > 1 and rate is None:
            raise MessageError(
                f"{count} samples and no rate; the mapping's `rate` has its path, or "
                "`sampling_rate` the figure [Hz]"
            )
        if mapping.stamp == "last" and count > 1 and rate is not None:
            time_ns -= round((count - 1) * 1e9 / rate)
        return time_ns, None if rate is None else float(rate)

    def _number_of(self, place: PayloadPlace) -> str:
        """What distinguishes the numbered messages or rows; "": there are no numbers."""
        number = number_in(place.first(self._mapping.sequence))
        if number is None:
            return ""
        if not _is_number(number) or number != int(number) or not 0 <= number < 2**63:
            raise MessageError(f"the sequence is {number!r:.20}, no whole number")
        return f"{place.first(self._mapping.sequence_of) or ''}#{int(number)}"

    def _follows(self, number: str, topic: str, session: int, time_ns: int) -> bool | None:
        """Whether it is directly behind its sender's last; None: late or twice, and counted."""
        owner, _, written = number.rpartition("#")
        sender = _sender(topic, self._mapping) + (f" {owner}" if owner else "")
        sequence, modulus = int(written), self._mapping.sequence_modulus
        if modulus:
            last = self._unwrapped.renewed((sender, session)) or 0
            half = modulus // 2  # the nearest number that is written so
            if not _is_node_birth(topic):  # which is the first of its session, also a second time
                sequence = max(sequence, last + (sequence - last + half) % modulus - half)
            self._unwrapped.put((sender, session), max(sequence, last))
        return self._numbers.follows(sender, sequence, session, time_ns=time_ns)

    def _pieces(
        self, groups: dict[_Moment, list[Value]], follows: dict[str, bool | None], topic: str
    ) -> Iterator[ChannelSamples]:
        """The first piece of a numbered message follows the last one of the topic, if it does."""
        own_numbers = _sender(topic, self._mapping) == topic
        stream = _stream(topic, self._mapping)
        for moment, values in groups.items():
            for length in sorted({len(each.numbers) for each in values}):
                same = {each.name: each.numbers for each in values if len(each.numbers) == length}
                follow = follows.pop(moment.number, None) if own_numbers else None
                samples = np.array(list(same.values())).T.reshape(length, len(same))
                yield ChannelSamples(
                    stream, tuple(same), samples, moment.start_ns, moment.rate, follow, moment.unit
                )


def _sender(topic: str, mapping: PayloadMapping) -> str:
    """Whose numbers a message has: with Sparkplug B an edge node counts for all its devices."""
    levels = topic.split("/")
    if mapping.decode == "sparkplug-b" and len(levels) > 3:
        return "/".join((levels[1], levels[3]))
    return topic


def _is_node_birth(topic: str) -> bool:
    """Whether a topic is of a Sparkplug B node's birth certificate."""
    levels = topic.split("/")
    return levels[0] == NAMESPACE and levels[2:3] == ["NBIRTH"]


def _stream(topic: str, mapping: PayloadMapping) -> str:
    """Whose samples a message has: birth certificates and data of one device belong together."""
    levels = topic.split("/")
    if mapping.decode == "sparkplug-b" and len(levels) > 3:
        return "/".join((levels[1], *levels[3:]))
    return topic


def _time_ns(place: PayloadPlace, mapping: PayloadMapping) -> int:
    written, base = place.first(mapping.time), place.first(mapping.time_base)
    if written is None and base is None:
        raise MessageError(f"no time at {' or '.join(mapping.time)}")
    try:
        if base is not None:
            written = _sum(number_in(base), number_in(written))
        factor = TIME_UNITS[mapping.time_unit]
        if factor:
            written = number_in(written)
        unit_ns = factor or NANOSECONDS
        if _is_number(written) and written * unit_ns < mapping.earliest * NANOSECONDS:
            raise ValueError(f"{written!r:.20} counts from the message's arrival, which is no time")
        if factor and _is_number(written):
            time_ns = written * factor if isinstance(written, int) else round(written * factor)
            if not 0 <= time_ns < LATEST_NS:
                raise ValueError(f"{written!r:.30} {mapping.time_unit} is no time since 1970")
            return int(time_ns)
        return moment_ns(written)
    except (ValueError, OverflowError) as error:
        raise MessageError(f"time: {error}") from error


def _sum(base: Any, offset: Any) -> Any:
    if not _is_number(base) or not (offset is None or _is_number(offset)):
        raise ValueError(f"{base!r:.20} + {offset!r:.20} is no time")
    return base + (offset or 0)


def number_in(content: Any) -> Any:
    """The number that a text is, NaN where it says that there is none; anything else as it is."""
    if not isinstance(content, str):
        return content
    text = content.strip()
    if is_missing(text) or text.lower() in _INFINITE:
        return math.nan
    if _WHOLE.fullmatch(text):
        return int(text)
    return float(text) if _DECIMAL.fullmatch(text) else content


def _name_at(name: str, at: int) -> str:
    """Of a place in a list."""
    return f"{name}.{at}" if name else str(at)


def _is_number(content: Any) -> bool:
    return (
        isinstance(content, int | float)
        and not isinstance(content, bool)
        and math.isfinite(content)
        and abs(content) < 2**63
    )


def _numbers(content: Any) -> tuple[float, ...] | None:
    """The numbers of a value, NaN for null in a list; None if it is text or a truth value."""
    items = content if isinstance(content, list) else [content]
    if not items or not all(each is None or _is_float(each) for each in items):
        return None
    if not isinstance(content, list) and content is None:
        return None
    return tuple(
        math.nan if each is None or not math.isfinite(each) else float(each) for each in items
    )


def _is_float(content: Any) -> bool:
    if isinstance(content, bool):
        return False
    return isinstance(content, float) or (isinstance(content, int) and abs(content) < 2**63)
