"""How a feed is named: a URL that gives protocol, place and options.

    mqtt://[USER@]HOST[:1883]/TOPIC[?OPTIONS]     mqtts:// with TLS, port 8883
    seedlink://HOST[:18000]/NET.STA[,NET.STA…]    seedlinks:// with TLS, port 18500
    opcua://[USER@]HOST[:4840][/PATH][?OPTIONS]   the variables of an OPC UA server
    udp://[HOST]:PORT
    scada+mqtt://HOST/TOPIC                       what the controller reports, as JSON
    scada+opcua://HOST?wind_speed=NODE            …, as variables of its OPC UA server
    scada+csv:FILE                                …, or as a CSV file that grows

A topic may have + and #. OPTIONS are key=value, joined by &. Secrets are never part of the URL:
they come from the environment (PILEWATCH_FEED_PASSWORD, PILEWATCH_FEED_KEY) or from a file that an
option names (password-file, key-file).
"""

import difflib
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote

from sensors.feeds.protocol import FeedError

_COMMON = ("rate", "wait")
_SECURITY = ("ca", "cert", "key", "password-file")
_OPCUA = ("interval", "security", "policy", "cert", "key", "server", "password-file")
_SCADA = (
    *("time", "state", "wind_speed", "rotor_speed", "pitch", "yaw", "power", "water_level"),
    "water_level_zero",
)
OPTIONS = {  # by scheme
    "mqtt": (
        *_COMMON,
        *_SECURITY,
        "qos",
        "mqtt",
        "format",
        "client",
        "key-file",
        "mapping",
        "rebirth",
    ),
    "seedlink": (*_COMMON, "ca"),
    "udp": (*_COMMON, "key-file"),
    "opcua": (*_COMMON, *_OPCUA, "nodes", "stamp"),
    "scada+opcua": (*_OPCUA, *_SCADA[1:]),
    "scada+mqtt": (*_SECURITY, "qos", "mqtt", "client", *_SCADA),
    "scada+csv": ("from", *_SCADA),
}
PORTS = {"mqtt": 1883, "mqtts": 8883, "seedlink": 18000, "seedlinks": 18500, "opcua": 4840}

_PARTS = re.compile(r"(?P<host>\[[^\]]*\]|[^:/]*)(:(?P<port>[^/]*))?(/(?P<path>.*))?")


@dataclass(frozen=True, slots=True)
class FeedAddress:
    """A feed's URL, taken apart."""

    text: str
    """As it was given."""
    scheme: str
    """"mqtt", "seedlink", "opcua", "udp", "scada+mqtt", …"""
    host: str = ""
    port: int = 0
    path: str = ""
    """Topic, stations or file."""
    user: str = ""
    tls: bool = False
    options: Mapping[str, str] = field(default_factory=dict)

    def number(self, option: str, default: float | None = None) -> float | None:
        """Return a positive number among the options. Raises FeedError for what is none."""
        written = self.options.get(option)
        if written is None:
            return default
        try:
            value = float(written)
        except ValueError:
            value = 0.0
        if not 0 < value < float("inf"):
            raise FeedError(f"{self.text}: {option}={written} is no positive number")
        return value

    def one_of(self, option: str, choices: tuple[str, ...]) -> str:
        """Return one of a few words among the options; the first where it is not given.

        Raises FeedError for another.
        """
        written = self.options.get(option, choices[0])
        if written not in choices:
            raise FeedError(f"{self.text}: {option}={written} is none of {', '.join(choices)}")
        return written

    def secret(self, name: str) -> str:
        """Return a password or key: from the file that the option NAME-file names, else from the
        environment (PILEWATCH_FEED_NAME); "" where there is none.

        Raises FeedError for a file that cannot be read or is empty.
        """
        path = self.options.get(f"{name}-file")
        if path is None:
            return os.environ.get(f"PILEWATCH_FEED_{name.upper()}", "")
        try:
            secret = Path(path).read_text("utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            reason = getattr(error, "strerror", None) or "not UTF-8"
            raise FeedError(f"{self.text}: {name}-file {path} cannot be read: {reason}") from error
        if not secret:
            raise FeedError(f"{self.text}: {name}-file {path} is empty; a {name} is needed")
        return secret


def is_feed(text: str) -> bool:
    """Whether a text begins as the address of a feed does."""
    scheme, _ = _without_tls(text.partition(":")[0])
    return scheme in OPTIONS and (text.startswith("scada+csv:") or "://" in text)


def parsed(text: str) -> FeedAddress:
    """Return the parts of a feed's URL. Raises FeedError for one that cannot be understood."""
    scheme, colon, rest = text.partition(":")
    kind, tls = _without_tls(scheme)
    if kind not in OPTIONS or not colon:
        raise FeedError(
            f"{text!r} is no feed; one begins with mqtt://, mqtts://, seedlink://, opcua://, "
            "udp://, scada+mqtt://, scada+opcua:// or scada+csv:"
        )
    rest, _, query = rest.partition("?")
    options = _options(text, kind, query)
    if kind == "scada+csv":
        path = unquote(rest.removeprefix("//"))
        if not path:
            raise FeedError(f"{text}: which file? scada+csv:FILE")
        return FeedAddress(text, kind, path=path, options=options)
    if not rest.startswith("//"):
        raise FeedError(f"{text}: write {scheme}://{rest}")
    user, _, place = rest.removeprefix("//").rpartition("@")
    if ":" in user:
        raise FeedError(
            f"{kind}://{user.partition(':')[0]}:…@{place}: everybody on this machine can read a "
            "password in a command; put it into PILEWATCH_FEED_PASSWORD or into a file "
            "(?password-file=FILE)"
        )
    found = _PARTS.fullmatch(place)
    assert found is not None
    port = _port(text, found["port"], PORTS.get(kind.removeprefix("scada+") + "s" * tls))
    host, path = found["host"].strip("[]"), unquote(found["path"] or "")
    _check(text, kind, host, path)
    return FeedAddress(text, kind, host, port, path, unquote(user), tls, options)


def _without_tls(scheme: str) -> tuple[str, bool]:
    """Return the scheme without its last s, and whether that s means TLS; OPC UA's own as ours."""
    if scheme == "opc.tcp":
        return "opcua", False
    tls = scheme.endswith(("mqtts", "seedlinks"))
    return (scheme[:-1] if tls else scheme), tls


def _options(text: str, kind: str, query: str) -> dict[str, str]:
    options = {}
    for each in filter(None, query.split("&")):
        key, _, value = each.partition("=")
        if key not in OPTIONS[kind]:
            close = difflib.get_close_matches(key, OPTIONS[kind], n=1)
            advice = f"did you mean {close[0]!r}?" if close else f"{', '.join(OPTIONS[kind])}"
            raise FeedError(f"{text}: there is no option {key!r}; {advice}")
        options[key] = unquote(value)
    return options


def _port(text: str, written: str | None, default: int | None) -> int:
    if not written and default is not None:
        return default
    if not written or not written.isdecimal() or int(written) > 65535:
        raise FeedError(f"{text}: port {written or ''!r} is none; 1 to 65535")
    return int(written)


def _check(text: str, kind: str, host: str, path: str) -> None:
    if kind == "udp":
        if path:
            raise FeedError(f"{text}: a port has no {path!r}; udp://HOST:PORT")
        return
    if not host:
        raise FeedError(f"{text}: which machine? {kind}://HOST/…")
    if not path and not kind.endswith("opcua"):
        what = "stations, e.g. /XX.TOWER" if kind == "seedlink" else "topic, e.g. /tower/#"
        raise FeedError(f"{text}: which {what}?")
