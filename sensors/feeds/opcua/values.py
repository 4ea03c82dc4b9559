"""OPC UA data values → samples, by their source time stamps."""

import logging
import math
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, BlockStatus
from sensors.acquisition.scada import ScadaSample
from sensors.bounded_dict import BoundedDict
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.scada import RisingTimes, ScadaReader
from sensors.feeds.payloads.timestamps import LATEST_NS
from sensors.feeds.protocol import ChannelSamples, FeedCounts

logger = logging.getLogger(__name__)

OVERFLOW = (
    0x480  # bits of a status code: a data value, before which the server's queue dropped some
)
WAITING = 0x80320000  # BadWaitingForInitialData (OPC 10000-6, annex A.2)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


class ValueReader:
    """Reads the data values of one server's variables.

    Parameters
    ----------
    counts : FeedCounts
        Takes what is lost, duplicate, late or no number.
    sampling_rate : float or None
        Of values that are arrays [Hz].
    stamp : {"first", "last"}
        Which sample of an array its time stamp is of.
    """

    def __init__(self, counts: FeedCounts, sampling_rate: float | None, stamp: str) -> None:
        self.newest_ns: dict[str, int] = {}  # time of the last value of each channel [ns]
        self._counts, self._rate, self._stamp = counts, sampling_rate, stamp
        self._unstamped: set[str] = set()
        self._read_before: dict[str, int] = {}  # values that come again: up to when [ns]

    def read(self, name: str, value: Any) -> Iterator[ChannelSamples]:
        """Yield the samples of a channel's data value; where it brings none, they are counted.

        A bad value is NaN: its time is known, its sample is not.
        """
        self._counts.received += 1
        if self._is_overflow(value):
            self._counts.lost += 1
        if value.StatusCode.value == WAITING or (stamp_ns(value) is None and _is_bad(value)):
            return  # nothing was ever measured
        time_ns = self._time_ns(name, value)
        if time_ns is None or self._is_old(name, time_ns):
            return
        samples = samples_of(value)
        if samples is None:
            self._counts.refuse(f"{name} is {content_of(value)!r:.40}, which is no number")
            return
        if len(samples) > 1 and self._rate is None:
            self._counts.refuse(f"{name}: arrays of {len(samples)} samples need the option rate=")
            return
        self.newest_ns[name] = time_ns
        if self._stamp == "last" and self._rate is not None:
            time_ns -= round((len(samples) - 1) * NANOSECONDS / self._rate)
        fault = BlockStatus.SENSOR_FAULT if value.StatusCode.is_bad() else BlockStatus.OK
        yield ChannelSamples(
            name, (name,), samples.reshape(-1, 1), time_ns, self._rate, status=fault
        )

    def _time_ns(self, name: str, value: Any) -> int | None:
        """The source's time stamp, else the server's [ns since 1970-01-01 UTC]; None, and counted,
        where there is neither."""
        time_ns = stamp_ns(value)
        if time_ns is None:
            self._counts.refuse(f"{name}: {_stamps_in_words(value)}")
        elif _time_of(value.SourceTimestamp) is None and name not in self._unstamped:
            self._unstamped.add(name)
            logger.warning("%s has no source time stamps; the server's are used", name)
        return time_ns

    def pass_over_known(self) -> None:
        """Values up to the newest may come again: a subscription repeats a history's end."""
        self._read_before = dict(self.newest_ns)

    def _is_old(self, name: str, time_ns: int) -> bool:
        """Whether a value repeats the last one: a subscription begins with the present value."""
        if time_ns <= self._read_before.get(name, -1) or time_ns == self.newest_ns.get(name):
            self._counts.duplicate += 1
            return True
        self._read_before.pop(name, None)
        return False

    @staticmethod
    def _is_overflow(value: Any) -> bool:
        return bool(value.StatusCode.value & OVERFLOW == OVERFLOW)


def stamp_ns(value: Any) -> int | None:
    """Return a data value's source time stamp, else the server's [ns since 1970-01-01 UTC]; None
    where neither is a time since 1970."""
    source_ns = _time_of(value.SourceTimestamp)
    return _time_of(value.ServerTimestamp) if source_ns is None else source_ns


def _time_of(stamp: datetime | None) -> int | None:
    """None also for the year 1601, which means that there is no time (OPC 10000-6 5.2.2.5)."""
    time_ns = -1 if stamp is None else nanoseconds_of(stamp)
    return time_ns if 0 <= time_ns < LATEST_NS else None


def _is_bad(value: Any) -> bool:
    return bool(value.StatusCode.is_bad())


def _stamps_in_words(value: Any) -> str:
    """Why the value of a data value has no time."""
    stamps = (("source", value.SourceTimestamp), ("server", value.ServerTimestamp))
    given = [f"the {kind}'s is {stamp:%Y-%m-%d %H:%M}" for kind, stamp in stamps if stamp]
    return f"a value without a time stamp since 1970{': ' if given else ''}{', '.join(given)}"


def nanoseconds_of(moment: datetime) -> int:
    """Return a time [ns since 1970-01-01 UTC]; UTC where it names no zone."""
    since = (moment if moment.tzinfo else moment.replace(tzinfo=UTC)) - _EPOCH
    return (since.days * 86_400 + since.seconds) * NANOSECONDS + since.microseconds * 1000


def moment_of(time_ns: int) -> datetime:
    """The inverse of `nanoseconds_of`, to a microsecond."""
    return datetime.fromtimestamp(time_ns // NANOSECONDS, UTC).replace(
        microsecond=time_ns % NANOSECONDS // 1000
    )


def content_of(value: Any) -> Any:
    """Return what a data value holds."""
    return None if value.Value is None else value.Value.Value


def samples_of(value: Any) -> np.ndarray | None:
    """The numbers of a data value, shape (n,); one NaN if it is bad, None if it is no number."""
    content = content_of(value)
    if value.StatusCode.is_bad() or content is None:
        length = len(content) if isinstance(content, list) and content else 1
        return np.full(length, math.nan)
    items = content if isinstance(content, list) else [content]
    if not items or any(isinstance(each, bool) for each in items):
        return None
    if not all(isinstance(each, int | float) for each in items):
        return None
    return np.array(items, dtype=np.float64)


class ScadaValueReader:
    """Reads the variables of a controller that an address names.

    Parameters
    ----------
    reader : ScadaReader
        Knows which figure each variable is.
    counts : FeedCounts
        Takes what is late, duplicate or no figure.
    """

    def __init__(self, reader: ScadaReader, counts: FeedCounts) -> None:
        self.newest_ns: dict[str, int] = {}  # stays empty: no history is read
        self._reader, self._counts = reader, counts
        self._times: BoundedDict[str, RisingTimes] = BoundedDict()

    def pass_over_known(self) -> None:
        """Nothing to do: late and duplicate reports are left out by their times."""

    def read(self, name: str, value: Any) -> Iterator[ScadaSample]:
        """Yield the report that a data value is; a bad one is none."""
        self._counts.received += 1
        if _is_bad(value):
            return
        time_ns = stamp_ns(value)
        if time_ns is None:
            self._counts.refuse(f"{name}: {_stamps_in_words(value)}")
            return
        times = self._times.renewed(name)
        if times is None:
            times = RisingTimes(self._counts)
            self._times.put(name, times)
        try:
            sample = self._reader.sample({"time": time_ns, name: content_of(value)})
        except MessageError as error:
            self._counts.refuse(f"{name}: {error}")
            return
        yield from times.taken(sample)
