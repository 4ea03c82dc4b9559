"""Messages as vendors write them: one stream of known samples in ten shapes."""

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

RATE = 40  # [Hz]
START_MS = 1_709_294_400_000  # 2024-03-01T12:00:00Z
NAMES = ("ax", "ay")
SAMPLES = np.round(np.random.default_rng(7).normal(size=(40, 2)), 4)  # (n, 2) [m/s²]

Messages = list[tuple[str, bytes]]


@dataclass(frozen=True, slots=True)
class Shape:
    """One vendor's."""

    preset: str
    messages: Callable[[], Messages]
    names: tuple[str, str] = NAMES
    numbered: bool = False
    """Whether lost messages are known by their numbers."""


def time_ms(index: int) -> int:
    """Of a sample [ms since 1970-01-01 UTC]."""
    return START_MS + index * 1000 // RATE


def iso(index: int, zone: str = "Z") -> str:
    """Of a sample."""
    text = datetime.fromtimestamp(time_ms(index) / 1000, UTC).isoformat(timespec="milliseconds")
    return text.replace("+00:00", zone)


def encoded(content: Any) -> bytes:
    return json.dumps(content).encode()


def each(build: Callable[[int, float, float], Any], topic: str = "tower/data") -> Messages:
    """One message a sample."""
    rows = SAMPLES.tolist()
    return [(topic, encoded(build(i, x, y))) for i, (x, y) in enumerate(rows)]


def csijson() -> Messages:
    """Ten rows a message."""
    head = {
        "transaction": 0,
        "signature": 38611,
        "environment": {"station_name": "tower", "table_name": "Accel", "model": "CR6"},
        "fields": [
            {"name": n, "type": "xsd:float", "units": "m/s^2", "process": "Smp"} for n in NAMES
        ],
    }
    rows = [
        {"time": iso(i, ""), "no": 100 + i, "vals": row} for i, row in enumerate(SAMPLES.tolist())
    ]
    return [
        ("cs/v2/data/cr6/1/Accel/cj", encoded({"head": head, "data": rows[i : i + 10]}))
        for i in range(0, 40, 10)
    ]


def geojson() -> Messages:
    """Campbell's GeoJSON: observations by time."""
    rows = {iso(i): row for i, row in enumerate(SAMPLES.tolist())}
    keys = list(rows)
    return [
        (
            "cs/v2/data/cr1000x/1234/Accel/cg",
            encoded(
                {
                    "type": "Feature",
                    "geometry": {"type": "Point", "coordinates": [None, None, None]},
                    "properties": {
                        "loggerID": "CR1000X_1234",
                        "observationNames": list(NAMES),
                        "observationUnits": ["m/s^2", "m/s^2"],
                        "observations": {key: rows[key] for key in keys[i : i + 4]},
                    },
                }
            ),
        )
        for i in range(0, 40, 4)
    ]


def wise() -> Messages:
    return each(
        lambda i, x, y: {
            **{"s": i + 1, "t": iso(i), "q": 192, "c": 1, "ai1": x, "ai_st1": 1, "ai2": y},
            **{"ai_st2": 1, "di1": True},
        },
        "Advantech/00D0C9FAC09A/data",
    )


def teltonika() -> Messages:
    return each(
        lambda i, x, y: {
            "state": {"reported": {"ts": time_ms(i), "pr": 0, "latlng": "0,0", "ax": x, "ay": y}}
        },
        "352093081452251/data",
    )


def telegraf() -> Messages:
    """Ten metrics a message."""
    rows = [
        {
            "fields": {"ax": x, "ay": y},
            "name": "accel",
            "tags": {"host": "edge", "unit": "m/s^2"},
            "timestamp": time_ms(i),
        }
        for i, (x, y) in enumerate(SAMPLES.tolist())
    ]
    return [("telegraf/edge", encoded({"metrics": rows[i : i + 10]})) for i in range(0, 40, 10)]


def senml() -> Messages:
    """Base name, base time and base unit in the first record (RFC 8428, section 5)."""
    messages = []
    for begin in range(0, 40, 8):
        pack: list[dict[str, Any]] = [{"bn": "tower/", "bt": START_MS / 1000, "bu": "m/s^2"}]
        for i in range(begin, begin + 8):
            for name, value in zip(NAMES, SAMPLES[i].tolist(), strict=True):
                pack.append({"n": name, "t": i / RATE, "v": value})
        messages.append(("senml", encoded(pack)))
    return messages


def opcua() -> Messages:
    return each(
        lambda i, x, y: {
            "MessageId": f"m{i}",
            "MessageType": "ua-data",
            "PublisherId": "plc-1",
            "Messages": [
                {
                    "DataSetWriterId": 62541,
                    "SequenceNumber": 17 + i,
                    "MetaDataVersion": {"MajorVersion": 1, "MinorVersion": 0},
                    "Timestamp": iso(i),
                    "Payload": {
                        "ax": {"Value": {"Type": 11, "Body": x}, "SourceTimestamp": iso(i)},
                        "ay": {"Value": y, "SourceTimestamp": iso(i)},
                    },
                }
            ],
        },
        "opcua/json/data/plc-1",
    )


def thingsboard() -> Messages:
    """Four entries a message."""
    rows = [
        {"ts": time_ms(i), "values": {"ax": x, "ay": y}}
        for i, (x, y) in enumerate(SAMPLES.tolist())
    ]
    return [("v1/devices/me/telemetry", encoded(rows[i : i + 4])) for i in range(0, 40, 4)]


def nested() -> Messages:
    """Half a second a message, each channel an object with its unit."""
    return [
        (
            "site/tower",
            encoded(
                {
                    "header": {"device": "d-7", "time": iso(i), "rate": RATE, "seq": i // 20},
                    "data": {
                        "acc": {
                            name: {"unit": "m/s^2", "value": SAMPLES[i : i + 20, at].tolist()}
                            for at, name in enumerate(("x", "y"))
                        }
                    },
                }
            ),
        )
        for i in range(0, 40, 20)
    ]


def varint(number: int) -> bytes:
    written = b""
    while number > 127:
        written += bytes([number & 127 | 128])
        number >>= 7
    return written + bytes([number])


def field(number: int, content: int | bytes | float) -> bytes:
    """A protocol buffers field; a float is a double."""
    if isinstance(content, float):
        return varint(number << 3 | 1) + struct.pack("<d", content)
    if isinstance(content, int):
        return varint(number << 3) + varint(content)
    return varint(number << 3 | 2) + varint(len(content)) + content


def sparkplug_metric(value: float, at_ms: int, *, name: str = "", alias: int = 0) -> bytes:
    named = field(1, name.encode()) if name else b""
    return field(
        2, named + field(2, alias) + field(3, at_ms) + field(4, 10) + field(13, float(value))
    )


def sparkplug() -> Messages:
    """A birth certificate with names, then data by alias; the numbers pass 255."""
    birth = field(1, time_ms(0)) + b"".join(
        sparkplug_metric(SAMPLES[0, at], time_ms(0), name=name, alias=at + 1)
        for at, name in enumerate(NAMES)
    )
    messages = [("spBv1.0/farm/DBIRTH/edge/tower", birth + field(3, 230))]
    for i in range(1, 40):
        data = field(1, time_ms(i)) + b"".join(
            sparkplug_metric(SAMPLES[i, at], time_ms(i), alias=at + 1) for at in range(2)
        )
        messages.append(("spBv1.0/farm/DDATA/edge/tower", data + field(3, (230 + i) % 256)))
    return messages


SHAPES = (
    Shape("csijson", csijson, numbered=True),
    Shape("campbell-geojson", geojson),
    Shape("wise", wise, ("ai1", "ai2"), numbered=True),
    Shape("teltonika", teltonika),
    Shape("telegraf", telegraf),
    Shape("senml", senml, ("tower/ax", "tower/ay")),
    Shape("opcua-pubsub-json", opcua, numbered=True),
    Shape("thingsboard", thingsboard),
    Shape("nested", nested, ("acc.x", "acc.y"), numbered=True),
    Shape("sparkplug-b", sparkplug, numbered=True),
)
