"""Sparkplug B payloads → the dict that a mapping reads.

    Payload   1 timestamp [ms]   2 metrics …   3 seq (0 to 255)
    Metric    1 name   2 alias   3 timestamp [ms]   4 datatype   7 is_null
              10 int   11 long   12 float   13 double   14 boolean   16 bytes (arrays)

A birth certificate (NBIRTH, DBIRTH) names each metric and its datatype; later messages may have its
alias alone, without either. Brokers keep no certificate: of data whose certificate came before this
feed, the node is asked for another (NCMD, Node Control/Rebirth).

Source: Eclipse Sparkplug Specification 3.0.0, chapters 5 and 6 and its protobuf schema; protocol
buffers' wire format (varint, 64-bit, length-delimited, 32-bit).
"""

import logging
import struct
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from sensors.bounded_dict import BoundedDict
from sensors.feeds.payloads.json_samples import LARGEST_JSON, MessageError

logger = logging.getLogger(__name__)

NAMESPACE = "spBv1.0"
REBIRTH_EVERY = 60.0  # of a node; twice as long whenever no certificate has come [s]
REBIRTH_AT_LEAST_EVERY = 3600.0  # [s]
MOST_REQUESTS = 100  # that wait to be sent
MOST_ALIASES = 10_000  # of one node
_SIGNED_BITS = {1: 8, 2: 16, 3: 32, 4: 64}  # by datatype
_ARRAYS = {  # by datatype: of its elements, little endian
    **{22: "<i1", 23: "<i2", 24: "<i4", 25: "<i8", 26: "<u1", 27: "<u2", 28: "<u4", 29: "<u8"},
    **{30: "<f4", 31: "<f8"},
}


class NoBirthError(MessageError):
    """Data whose birth certificate did not come."""


class RebirthRequests:
    """Which nodes are to be asked for their birth certificates.

    Parameters
    ----------
    clock : callable, optional
        Monotonic time [s].
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._asked: BoundedDict[str, tuple[float, float]] = BoundedDict()  # when, pause behind it
        self._waiting: list[tuple[str, bytes]] = []

    def want(self, topic: str) -> None:
        """Ask the node of a message, unless it was asked a while ago."""
        node = _node(topic)
        asked, pause = self._asked.renewed(node) or (-REBIRTH_AT_LEAST_EVERY, 0.0)
        now = self._clock()
        if (pause and now - asked < pause) or len(self._waiting) >= MOST_REQUESTS:
            return
        longer = min(2 * pause or REBIRTH_EVERY, REBIRTH_AT_LEAST_EVERY)
        self._asked.put(node, (now, longer))
        group, _, name = node.partition("/")
        logger.warning("%s: the node is asked for its birth certificate", node)
        self._waiting.append((f"{NAMESPACE}/{group}/NCMD/{name}", rebirth(time.time_ns() // 10**6)))

    def born(self, topic: str) -> None:
        """Take note of a certificate: when the next one is missing the node is asked at once."""
        self._asked.pop(_node(topic), None)

    def taken(self) -> list[tuple[str, bytes]]:
        """Topics and payloads to publish."""
        waiting, self._waiting = self._waiting, []
        return waiting


def rebirth(time_ms: int) -> bytes:
    """A payload that asks a node for its birth certificates.

    Parameters
    ----------
    time_ms : int
        Since 1970-01-01 UTC [ms].
    """
    name = b"Node Control/Rebirth"
    stamp = _written(time_ms)
    metric = b"\x0a" + _written(len(name)) + name + b"\x18" + stamp + b"\x20\x0b\x70\x01"
    return b"\x08" + stamp + b"\x12" + _written(len(metric)) + metric


def _node(topic: str) -> str:
    """Group and edge node of a topic, "group/node"."""
    levels = topic.split("/")
    return f"{levels[1]}/{levels[3]}"


def _written(number: int) -> bytes:
    """A number as protocol buffers have it."""
    encoded = bytearray()
    while number > 127:
        encoded.append(number & 127 | 128)
        number >>= 7
    return bytes([*encoded, number])


class _Metrics:
    """What a birth certificate says of the metrics of a node or device."""

    def __init__(self) -> None:
        self.names: BoundedDict[str, str] = BoundedDict(MOST_ALIASES)  # by alias
        self.datatypes: BoundedDict[str, int] = BoundedDict(MOST_ALIASES)  # by name


class SparkplugDecoder:
    """Remembers the names that nodes give their aliases.

    Parameters
    ----------
    rebirths : RebirthRequests, optional
        Takes the nodes whose birth certificates are missing; None: none is asked.
    """

    def __init__(self, rebirths: RebirthRequests | None = None) -> None:
        self._sources: BoundedDict[str, _Metrics] = BoundedDict()  # by node and device
        self._rebirths = rebirths

    def decoded(self, topic: str, payload: bytes) -> dict[str, Any]:
        """A payload as {"timestamp", "seq", "metrics": [{"name", "timestamp", "value"}]}.

        Parameters
        ----------
        topic : str
            Under which it came: of a node's or a device's birth or data.
        payload : bytes
            The message as it came.

        Raises
        ------
        MessageError
            If it is no Sparkplug B payload, or its birth certificate did not come.
        """
        if len(payload) > LARGEST_JSON:
            raise MessageError(f"{len(payload)} bytes; at most {LARGEST_JSON}")
        levels = topic.split("/")
        kind = levels[2] if len(levels) > 3 and levels[0] == NAMESPACE else ""
        if kind not in ("NBIRTH", "DBIRTH", "NDATA", "DDATA", "DDEATH"):
            return {"metrics": []}  # a node's death, commands, states: no samples and no number
        source = "/".join((levels[1], *levels[3:]))
        known = self._sources.renewed(source)
        if known is None or kind.endswith("BIRTH"):
            known = _Metrics()
            self._sources.put(source, known)
        if self._rebirths is not None and kind.endswith("BIRTH"):
            self._rebirths.born(topic)
        try:
            return _content(payload, known)
        except NoBirthError as error:
            if self._rebirths is None:
                raise NoBirthError(
                    f"{error}; ask the node for another (NCMD, Node Control/Rebirth)"
                ) from error
            self._rebirths.want(topic)
            raise NoBirthError(f"{error}; the node is asked for another") from error


def _content(payload: bytes, known: _Metrics) -> dict[str, Any]:
    content: dict[str, Any] = {"metrics": []}
    for field, value in _fields(payload):
        if field in (1, 3) and isinstance(value, int):
            content["timestamp" if field == 1 else "seq"] = value
        elif field == 2 and isinstance(value, bytes):
            metric = _metric(value, known)
            if metric is not None:
                content["metrics"].append(metric)
    return content


def _metric(encoded: bytes, known: _Metrics) -> dict[str, Any] | None:
    """None for one without a name or a number. Raises NoBirthError."""
    fields = dict(_fields(encoded))
    written, alias, datatype = fields.get(1), fields.get(2), fields.get(4)
    name = written.decode("utf-8", "replace") if isinstance(written, bytes) else ""
    if name and isinstance(alias, int):
        known.names.put(str(alias), name)
    name = name or known.names.renewed(str(alias)) or ""
    if isinstance(datatype, int) and name:
        known.datatypes.put(name, datatype)
    elif name:
        datatype = fields[4] = known.datatypes.renewed(name) or 0
    number = None if fields.get(7) else _number(fields)
    birth = "the birth certificate came before this feed"
    if not name and number is not None and isinstance(alias, int):
        raise NoBirthError(f"alias {alias} has no name: {birth}")
    if not datatype and not fields.get(7) and not fields.keys().isdisjoint((10, 11, 16)):
        raise NoBirthError(f"{name} is a whole number or an array of unknown type: {birth}")
    if not name or number is None:
        return None
    metric: dict[str, Any] = {"name": name, "value": number}
    if isinstance(fields.get(3), int):
        metric["timestamp"] = fields[3]
    return metric


def _number(fields: dict[int, int | bytes]) -> float | int | list[float] | None:
    datatype = fields.get(4)
    match fields:
        case {12: bytes(packed)}:
            return _floating("<f", packed)
        case {13: bytes(packed)}:
            return _floating("<d", packed)
        case {10: int(number)} | {11: int(number)}:
            bits = _SIGNED_BITS.get(datatype, 0) if isinstance(datatype, int) else 0
            number &= (1 << bits) - 1 if bits else (1 << 64) - 1
            return number - (1 << bits) if bits and number >> (bits - 1) else number
        case {16: bytes(packed)} if datatype in _ARRAYS:
            kind = np.dtype(_ARRAYS[int(datatype)])
            if len(packed) % kind.itemsize:
                raise MessageError(
                    f"an array of {len(packed)} bytes in elements of {kind.itemsize}"
                )
            return np.frombuffer(packed, kind).astype(float).tolist()
    return None


def _floating(kind: str, packed: bytes) -> float:
    """Raises MessageError: a field may claim any length."""
    if len(packed) != struct.calcsize(kind):
        raise MessageError(f"a floating-point number of {len(packed)} bytes")
    return float(struct.unpack(kind, packed)[0])


def _fields(encoded: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Numbers and contents of a message's fields. Raises MessageError."""
    at = 0
    while at < len(encoded):
        tag, at = _varint(encoded, at)
        field, wire = tag >> 3, tag & 7
        if wire == 0:
            number, at = _varint(encoded, at)
            yield field, number
            continue
        if wire == 2:
            length, at = _varint(encoded, at)
        elif wire in (1, 5):
            length = 8 if wire == 1 else 4
        else:
            raise MessageError(f"no Sparkplug B: wire type {wire}")
        if at + length > len(encoded):
            raise MessageError("no Sparkplug B: a field is cut off")
        yield field, encoded[at : at + length]
        at += length


def _varint(encoded: bytes, at: int) -> tuple[int, int]:
    """A number of up to ten bytes, and where the next field is."""
    number = 0
    for shift in range(0, 70, 7):
        if at >= len(encoded):
            raise MessageError("no Sparkplug B: a number is cut off")
        byte = encoded[at]
        at += 1
        number |= (byte & 127) << shift
        if byte < 128:
            return number, at
    raise MessageError("no Sparkplug B: a number of more than ten bytes")
