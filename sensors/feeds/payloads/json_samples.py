"""JSON messages → samples.

    one sample of several channels    {"time": 1700000000.025, "ax": 0.12, "ay": -0.03}
    several at a rate                 {"time": 1700000000, "rate": 40, "values": {"ax": [0.1, …]}}
    of one channel, on topic …/ax     {"time": 1700000000, "rate": 40, "value": [0.1, …]}
    several in one message            [{"time": …, "ax": …}, {"time": …, "ax": …}]

time       of the first sample: s (or ms, µs, ns) since 1970, or ISO 8601; also "timestamp", "t"
rate       [Hz]; needed for lists. Single samples give it by their times
sequence   counts the messages, one by one, so that lost ones are known
session    a number that is another one whenever the sender starts
unit       of the samples, e.g. "g"; the layout's word goes before
"""

import json
import math
from collections.abc import Collection, Iterator, Mapping
from typing import Any

import numpy as np

from sensors.arrays import FloatArray
from sensors.feeds.payloads.frame import HIGHEST_RATE, LOWEST_RATE
from sensors.feeds.payloads.sequence_numbers import SenderNumbers
from sensors.feeds.payloads.timestamps import moment_ns
from sensors.feeds.protocol import ChannelSamples, FeedCounts
from sensors.files.missing_values import is_missing

LARGEST_JSON = 2**20  # [bytes]
_TIMES = ("time", "timestamp", "t")
_RATES = ("rate", "sampling_rate", "fs")
_SEQUENCES = ("sequence", "seq")
_OTHERS = ("session", "unit", "value", "values")
_WORDS = frozenset((*_TIMES, *_RATES, *_SEQUENCES, *_OTHERS))


class MessageError(ValueError):
    """A message that cannot be read; one sentence states why."""


def json_of(payload: bytes) -> Any:
    """What a payload holds. Raises MessageError where it is no JSON, or a megabyte and more."""
    if len(payload) > LARGEST_JSON:
        raise MessageError(f"{len(payload)} bytes; at most {LARGEST_JSON}")
    try:
        return json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"no JSON: {payload[:40]!r}") from error


class JsonReader:
    """Reads the JSON messages of one feed.

    Parameters
    ----------
    listed : collection of str
        Names of the channels that the layout has.
    counts : FeedCounts
        Takes what is lost, late, duplicate or malformed.
    """

    def __init__(self, listed: Collection[str], counts: FeedCounts) -> None:
        self._listed = frozenset(listed)
        self._numbers = SenderNumbers(counts)

    def read(self, payload: bytes, topic: str) -> Iterator[ChannelSamples]:
        """The samples of a message. Raises MessageError."""
        said = json_of(payload)
        for each in said if isinstance(said, list) else [said]:
            if not isinstance(each, dict):
                raise MessageError(f"{each!r:.40} is no sample; an object is")
            piece = self._piece(each, topic)
            if piece is not None:
                yield piece

    def _piece(self, said: Mapping[str, Any], topic: str) -> ChannelSamples | None:
        time_ns = time_in(said)
        rate = _number(said, _RATES)
        if rate is not None and not LOWEST_RATE <= rate <= HIGHEST_RATE:
            raise MessageError(f"rate is {rate:g}; {LOWEST_RATE:g} to {HIGHEST_RATE:g} Hz")
        names, samples = self._samples(said, topic)
        if len(samples) > 1 and rate is None:
            raise MessageError(f"{len(samples)} samples and no rate")
        follows = None
        sequence = _number(said, _SEQUENCES)
        if sequence is not None:
            session = int(_number(said, ("session",)) or 0)
            follows = self._numbers.follows(topic, int(sequence), session, time_ns=time_ns)
            if follows is None:
                return None
        unit = said.get("unit", "")
        return ChannelSamples(topic, names, samples, time_ns, rate, follows, str(unit))

    def _samples(self, said: Mapping[str, Any], topic: str) -> tuple[tuple[str, ...], FloatArray]:
        """Names, and samples (n, n_names)."""
        values = said.get("values", said.get("value"))
        if isinstance(values, dict):
            columns = values
        elif values is not None:
            columns = {named_by(topic, self._listed): values}
        else:
            columns = {key: value for key, value in said.items() if key not in _WORDS}
            columns = {  # numbers written as text are those of listed channels alone
                key: value
                for key, value in columns.items()
                if key in self._listed or not isinstance(value, str)
            }
        if not columns:
            raise MessageError("no values in it")
        read = [_column(name, value) for name, value in columns.items()]
        lengths = {len(column) for column in read}
        if len(lengths) > 1:
            raise MessageError(f"channels of {min(lengths)} and {max(lengths)} samples")
        return tuple(columns), np.array(read).T.reshape(-1, len(read))


def named_by(topic: str, listed: Collection[str]) -> str:
    """The channel that a topic stands for: as much of its end as the layout lists as a name, or
    its last level."""
    levels = topic.split("/")
    ends = ("/".join(levels[i:]) for i in range(len(levels)))
    return next((end for end in ends if end in listed), levels[-1])


def time_in(said: Mapping[str, Any]) -> int:
    """When a message's first sample was taken [ns]. Raises MessageError."""
    for key in _TIMES:
        if key in said:
            try:
                return moment_ns(said[key])
            except ValueError as error:
                raise MessageError(f"{key}: {error}") from error
    raise MessageError("no time in it; samples carry their instrument's time")


def _number(said: Mapping[str, Any], keys: tuple[str, ...]) -> float | int | None:
    for key in keys:
        if key in said:
            value = said[key]
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise MessageError(f"{key} is {value!r:.40}, which is no number")
            if not math.isfinite(value) or abs(value) >= 2**63:
                raise MessageError(f"{key} is {value!r:.40}")
            return value
    return None


def _column(name: str, value: Any) -> list[float]:
    values = value if isinstance(value, list) else [value]
    try:
        column = [math.nan if is_missing(each) else float(each) for each in values]
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"{name!r:.40} is {value!r:.40}, which is no number") from error
    return [each if math.isfinite(each) else math.nan for each in column]
