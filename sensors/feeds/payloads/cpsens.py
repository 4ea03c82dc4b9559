"""CP-SENS: accelerations of HBK acquisition units as binary MQTT messages.

    cpsens/DAQ/MODULE/CHANNEL/acc/raw/data       a descriptor, then the samples
    cpsens/DAQ/MODULE/CHANNEL/acc/raw/metadata   JSON, retained or every few seconds

Descriptor, byte by byte (from the metadata's own "Descriptor" table):

    offset  bytes
      0     2   descriptor length   uint16, 28 [bytes]
      2     2   metadata version    uint16
      4     8   seconds since epoch uint64
     12     8   nanoseconds         uint64
     20     8   samples from DAQ start  uint64: number of the message's first sample
     28     2   element size        uint16, in descriptors of 32 bytes
     30     2   columns             uint16, in descriptors of 32 bytes

What is known of it: little endian from HBK's own units, big endian from some others, found here by
the length that comes out; the samples have the descriptor's order (little endian behind one of 32
bytes). "Data.Type" names the samples' C type. "Nanoseconds" is not always the fraction of a second;
where it is not, the time is "TimeAtAquisitionStart" (spelt so) plus the number of the first sample
by the rate. Units without a clock send zeros: their samples are timed by their arrival, and marked
as of a clock that is not synchronised. The sampling rate is that of the last step of the "Analysis
chain".

Sources: INTO-CPS-Association/example-shm, docs on HBK metadata (CP-SENS); the topics and the
metadata of the cpsns tools.
"""

import math
import struct
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, BlockStatus
from sensors.bounded_dict import BoundedDict
from sensors.feeds.payloads.frame import HIGHEST_RATE, LOWEST_RATE
from sensors.feeds.payloads.json_samples import MessageError, json_of, named_by
from sensors.feeds.payloads.sequence_numbers import SenderNumbers
from sensors.feeds.payloads.timestamps import LATEST_NS
from sensors.feeds.protocol import ChannelSamples, FeedCounts

_FIXED = "HHQQQ"
DESCRIPTOR_BYTES = struct.calcsize(f"<{_FIXED}")  # 28
LONGEST_DESCRIPTOR = 256  # [bytes]; what comes out larger was read in the wrong order
_TYPES = {"float": "f4", "double": "f8", "short": "i2", "int": "i4", "long": "i4"}  # bytes as in C
_ENDINGS = ("/data", "/metadata")


@dataclass(frozen=True, slots=True)
class ChannelMetadata:
    """What a channel reports of itself."""

    sampling_rate: float
    """Sampling rate [Hz]."""
    dtype: str = "f4"
    """Of the samples, without byte order."""
    unit: str = ""
    names: tuple[str, ...] = ()
    """That a layout may know it by."""
    started_ns: int | None = None
    """Acquisition start [ns since 1970-01-01 UTC]."""


@dataclass(frozen=True, slots=True)
class Descriptor:
    """What stands before the samples."""

    order: str
    """"<" or ">"."""
    length: int
    """Length [bytes]."""
    time_ns: int | None
    """Of the first sample; None: not given [ns since 1970-01-01 UTC]."""
    first_sample: int
    """Since the acquisition's start."""
    columns: int


def is_cpsens(topic: str, payload: bytes) -> bool:
    """Whether a message is one of these by its topic and its first bytes."""
    if topic.endswith("/metadata"):
        return payload[:1] == b"{"
    return topic.endswith("/data") and _order(payload) is not None


class CpSensReader:
    """Reads the messages of one feed.

    Parameters
    ----------
    listed : collection of str
        Names of the channels that the layout has.
    counts : FeedCounts
        Takes what is lost, late or duplicate.
    sampling_rate : float or None
        Of channels that send no metadata [Hz].
    clock : callable
        → arrival time [ns since 1970], for units without a clock.
    """

    def __init__(
        self,
        listed: Collection[str],
        counts: FeedCounts,
        *,
        sampling_rate: float | None,
        clock: Callable[[], int],
    ) -> None:
        self._listed = frozenset(listed)
        self._numbers = SenderNumbers(counts)
        self._default = ChannelMetadata(sampling_rate) if sampling_rate else None
        self._clock = clock
        self._metadata: BoundedDict[str, ChannelMetadata] = BoundedDict()  # by channel's topic
        self._arrival: BoundedDict[str, tuple[int, int]] = BoundedDict()  # number and time [ns]

    def read(self, payload: bytes, topic: str) -> ChannelSamples | None:
        """The samples of a message; None of metadata and of what is counted instead.

        Raises MessageError.
        """
        base = _without(topic, _ENDINGS)
        if topic.endswith("/metadata"):
            self._metadata.put(base, metadata_of(json_of(payload)))
            return None
        metadata = self._metadata.renewed(base) or self._default
        if metadata is None:
            raise MessageError("no metadata yet: its sampling rate is not known; or say ?rate=")
        descriptor = descriptor_of(payload)
        samples = _samples(payload, descriptor, metadata)
        first, n_samples = descriptor.first_sample, len(samples)
        time_ns, status = self._time(base, descriptor, metadata)
        if not 0 <= time_ns < LATEST_NS:
            raise MessageError(f"sample {first} of an acquisition at {time_ns} ns since 1970")
        follows: bool | None = None
        if first % n_samples == 0:  # messages of one length: their number
            follows = self._numbers.follows(base, first // n_samples, time_ns=time_ns)
            if follows is None:
                return None
        return ChannelSamples(
            base,
            self._names(base, metadata, descriptor.columns),
            samples,
            time_ns,
            metadata.sampling_rate,
            follows,
            metadata.unit,
            status,
        )

    def _names(self, base: str, metadata: ChannelMetadata, columns: int) -> tuple[str, ...]:
        """What the layout calls the channel, or else its topic."""
        channel = _without(base, ("/acc/raw",))
        topics = named_by(channel, self._listed)
        known = (*metadata.names, f"{base}/data", base, topics)
        name = next((each for each in known if each in self._listed), channel)
        if columns == 1:
            return (name,)
        return tuple(f"{channel}/{number + 1}" for number in range(columns))

    def _time(
        self, base: str, descriptor: Descriptor, metadata: ChannelMetadata
    ) -> tuple[int, BlockStatus]:
        since = round(descriptor.first_sample * NANOSECONDS / metadata.sampling_rate)
        if descriptor.time_ns is not None:
            return descriptor.time_ns, BlockStatus.OK
        if metadata.started_ns is not None:
            return metadata.started_ns + since, BlockStatus.OK
        before, time_ns = self._arrival.renewed(base) or (-1, 0)
        if descriptor.first_sample < before or before < 0:  # the first, or a restart
            time_ns = self._clock() - since
        self._arrival.put(base, (descriptor.first_sample, time_ns))
        return time_ns + since, BlockStatus.CLOCK_UNSYNCHRONISED


def metadata_of(said: Any) -> ChannelMetadata:
    """What a metadata message reports. Raises MessageError where it gives no sampling rate."""
    if not isinstance(said, dict):
        raise MessageError("metadata that is no object")
    rate = _rate(said)
    data, sensor = _part(said, "Data"), _part(said, "Sensor")
    names = (_part(said, "Engineering").get("channelName"), sensor.get("S/N"))
    return ChannelMetadata(
        rate,
        _dtype(str(data.get("Type", "float"))),
        str(data.get("Unit", "")),
        tuple(str(name) for name in names if name),
        _started(_part(said, "TimeAtAquisitionStart")),
    )


def _rate(said: Mapping[str, Any]) -> float:
    chain = said.get("Analysis chain") or [{}]
    last = chain[-1] if isinstance(chain, list) and isinstance(chain[-1], dict) else {}
    rate = last.get("Sampling", _part(said, "DataChunk").get("Fs"))
    if isinstance(rate, bool) or not isinstance(rate, int | float):
        raise MessageError("metadata without the Sampling of its last step in the Analysis chain")
    if not LOWEST_RATE <= rate <= HIGHEST_RATE:
        raise MessageError(f"metadata with a Sampling of {rate} Hz")
    return float(rate)


def _dtype(named: str) -> str:
    if named not in _TYPES:
        raise MessageError(f"metadata with samples of type {named!r:.20}; {', '.join(_TYPES)}")
    return _TYPES[named]


def _started(told: Mapping[str, Any]) -> int | None:
    seconds, rest = told.get("Seconds"), told.get("Nanosec", 0)
    if not isinstance(seconds, int) or not isinstance(rest, int) or seconds <= 0:
        return None
    time_ns = seconds * NANOSECONDS + rest
    return time_ns if 0 < time_ns < LATEST_NS else None


def _part(said: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    part = said.get(key)
    return part if isinstance(part, dict) else {}


def descriptor_of(payload: bytes) -> Descriptor:
    """The descriptor of a data message. Raises MessageError where there is none."""
    order = _order(payload)
    if order is None:
        raise MessageError(f"no CP-SENS descriptor in {payload[:4]!r}…")
    length, _, seconds, rest, first = struct.unpack_from(order + _FIXED, payload)
    time_ns = seconds * NANOSECONDS + rest if seconds and rest < NANOSECONDS else None
    if (time_ns or 0) >= LATEST_NS or first >= 2**62:
        raise MessageError(f"a descriptor of {seconds} s since 1970, sample {first}")
    columns = 1
    if length >= DESCRIPTOR_BYTES + 4:
        columns = struct.unpack_from(f"{order}HH", payload, DESCRIPTOR_BYTES)[1]
    return Descriptor(order, length, time_ns, first, columns or 1)


def _order(payload: bytes) -> str | None:
    """The byte order in which the descriptor's length is one."""
    if len(payload) < DESCRIPTOR_BYTES:
        return None
    for order in "<>":
        length = struct.unpack_from(f"{order}H", payload)[0]
        if DESCRIPTOR_BYTES <= length <= min(LONGEST_DESCRIPTOR, len(payload)):
            return order
    return None


def _samples(payload: bytes, descriptor: Descriptor, metadata: ChannelMetadata) -> Any:
    """(n_samples, n_columns)"""
    order = "<" if descriptor.length >= DESCRIPTOR_BYTES + 4 else descriptor.order
    dtype = np.dtype(order + metadata.dtype)
    size = len(payload) - descriptor.length
    row = dtype.itemsize * descriptor.columns
    if size < row or size % row:
        raise MessageError(f"{size} bytes of samples; a multiple of {row} is needed")
    samples = np.frombuffer(payload, dtype, offset=descriptor.length).astype(np.float64)
    samples[~np.isfinite(samples)] = math.nan
    return samples.reshape(-1, descriptor.columns)


def _without(text: str, endings: tuple[str, ...]) -> str:
    for ending in endings:
        text = text.removesuffix(ending)
    return text
