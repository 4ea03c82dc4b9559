"""Sparkplug B payloads → the dict that a mapping reads.

    Payload   1 timestamp [ms]   2 metrics …   3 seq (0 to 255)
    Metric    1 name   2 alias   3 timestamp [ms]   4 datatype   7 is_null
              10 int   11 long   12 float   13 double   14 boolean   16 bytes (arrays)

A birth certificate (NBIRTH, DBIRTH) names each metric; later messages may have its alias alone.

Source: Eclipse Sparkplug Specification 3.0.0, chapter 6 and its protobuf schema; protocol buffers'
wire format (varint, 64-bit, length-delimited, 32-bit).
"""

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np

from sensors.bounded_dict import BoundedDict
from sensors.feeds.payloads.json_samples import LARGEST_JSON, MessageError

NAMESPACE = "spBv1.0"
MOST_ALIASES = 10_000  # of one node
_SIGNED_BITS = {1: 8, 2: 16, 3: 32, 4: 64}  # by datatype
_ARRAYS = {  # by datatype: of its elements, little endian
    **{22: "<i1", 23: "<i2", 24: "<i4", 25: "<i8", 26: "<u1", 27: "<u2", 28: "<u4", 29: "<u8"},
    **{30: "<f4", 31: "<f8"},
}


class SparkplugDecoder:
    """Remembers the names that nodes give their aliases."""

    def __init__(self) -> None:
        self._aliases: BoundedDict[str, BoundedDict[str, str]] = BoundedDict()  # by node and device

    def decoded(self, topic: str, payload: bytes) -> dict[str, Any]:
        """A payload as {"timestamp", "seq", "metrics": [{"name", "timestamp", "value"}]}.

        Raises
        ------
        MessageError
            If it is no Sparkplug B payload.
        """
        if len(payload) > LARGEST_JSON:
            raise MessageError(f"{len(payload)} bytes; at most {LARGEST_JSON}")
        levels = topic.split("/")
        kind = levels[2] if len(levels) > 3 and levels[0] == NAMESPACE else ""
        if kind not in ("NBIRTH", "DBIRTH", "NDATA", "DDATA", "DDEATH"):
            return {"metrics": []}  # a node's death, commands, states: no samples and no number
        source = "/".join((levels[1], *levels[3:]))
        aliases = self._aliases.renewed(source)
        if aliases is None or kind.endswith("BIRTH"):
            aliases = BoundedDict[str, str](MOST_ALIASES)
            self._aliases.put(source, aliases)
        content: dict[str, Any] = {"metrics": []}
        for field, value in _fields(payload):
            if field in (1, 3) and isinstance(value, int):
                content["timestamp" if field == 1 else "seq"] = value
            elif field == 2 and isinstance(value, bytes):
                metric = _metric(value, aliases)
                if metric is not None:
                    content["metrics"].append(metric)
        return content


def _metric(encoded: bytes, aliases: BoundedDict[str, str]) -> dict[str, Any] | None:
    """None for one without a name or a number."""
    fields = dict(_fields(encoded))
    written, alias = fields.get(1), fields.get(2)
    name = written.decode("utf-8", "replace") if isinstance(written, bytes) else ""
    if name and isinstance(alias, int):
        aliases.put(str(alias), name)
    name = name or aliases.renewed(str(alias)) or ""
    number = None if fields.get(7) else _number(fields)
    if not name and number is not None and isinstance(alias, int):
        raise MessageError(
            f"alias {alias} has no name: the birth certificate came before this feed; ask the node "
            "for another (NCMD, Node Control/Rebirth)"
        )
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
            return float(struct.unpack("<f", packed)[0])
        case {13: bytes(packed)}:
            return float(struct.unpack("<d", packed)[0])
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
