"""Where alarm messages go and how often: a TOML file of its own, so that no recording holds an
address.

    [notices]
    reminder = 86400.0            # repeated after so long while the alarm lasts [s]; 0: never

    [[webhook]]
    url = "https://example.org/hook"

    [[mqtt]]
    host = "broker.example.org"

    [[mail]]
    host = "smtp.example.org"     # STARTTLS on port 587; port = 465 and tls = true: TLS at once
    sender = "pilewatch@example.org"
    recipients = ["engineer@example.org"]

    [[heartbeat]]
    url = "https://example.org/ping"   # raises the alarm there when the pings end

Passwords and tokens are read from the environment; the file names the variables. `ca` names the
file of a private authority.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from pipeline.state.books import WITHOUT_POSTERIOR
from sensors.errors import InputError
from sensors.settings import settings_from_table, toml_table

KINDS = (
    *("change", "gap", "silence", "sensor", "clock", "untrusted", "refused", "node"),
    *("recorder", "books", "no-posterior", "delivery", "threshold"),
)
MOST_SHARE = 2.0  # of a threshold: one above is most likely meant in percent [-]
THRESHOLDS = ("k11_below", "k22_below", "k12_below")  # keys
TLS_PORT = 465  # SMTP with TLS from the first byte (RFC 8314)


class AlarmError(InputError):
    """A notices file that cannot be right; the message names file, section and key."""


@dataclass(frozen=True, slots=True)
class AlarmLogSettings:
    """Section [notices]: what raises an alarm, and how often its message is repeated."""

    kinds: tuple[str, ...] = KINDS
    """Kinds of alarms that are sent."""
    reminder: float = 86_400.0
    """Time after which an unacknowledged alarm that lasts is repeated [s]; 0: never."""
    settle: float = 900.0
    """A condition that returns within this time is the same alarm [s]."""
    shortest_gap: float = 60.0
    """Shortest gap of the measurements that raises an alarm [s]."""
    windows_without_posterior: int = WITHOUT_POSTERIOR
    """Windows answered on end without a posterior that raise an alarm."""
    undelivered: float = 300.0
    """Time after which a channel that does not deliver raises an alarm by the others [s]."""
    k11_below: float = 0.0
    """Median of k11 over nominal, of a trusted posterior, below which an alarm is raised [-]; 0:
    none."""
    k22_below: float = 0.0
    """The same of k22 [-]."""
    k12_below: float = 0.0
    """The same of k12 [-]."""

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in KINDS:
                raise AlarmError(f"kinds has {kind!r}; there are {', '.join(KINDS)}")
        for name in ("reminder", "settle", "shortest_gap", "undelivered", *THRESHOLDS):
            if not getattr(self, name) >= 0:
                raise AlarmError(f"{name} is {getattr(self, name)}; it must not be negative")
        for name in THRESHOLDS:
            if not (share := getattr(self, name)) <= MOST_SHARE:
                raise AlarmError(
                    f"{name} is {share}; it is a share of nominal, 0.95 for 95 %, at most "
                    f"{MOST_SHARE:g}"
                )
        if self.windows_without_posterior < 1:
            raise AlarmError(
                f"windows_without_posterior is {self.windows_without_posterior}; at least 1 is "
                "needed"
            )


@dataclass(frozen=True, slots=True)
class WebhookSettings:
    """A section [[webhook]]: every message is POSTed as JSON."""

    url: str
    """Final address, http or https; redirects are not followed."""
    token_environment: str = ""
    """Variable with a token, sent as `Authorization: Bearer …`."""
    timeout: float = 10.0
    """Deadline of a whole delivery [s]."""
    ca: str = ""
    """PEM file of the authority of the server's certificate; "": the system's authorities."""

    def __post_init__(self) -> None:
        _require_url(self.url)
        _require_set(self.token_environment, "token_environment")
        _require_file(self.ca)
        _require_timeout(self.timeout)


@dataclass(frozen=True, slots=True)
class HeartbeatSettings(WebhookSettings):
    """A section [[heartbeat]]: a ping whose absence raises an alarm at the receiver."""

    period: float = 300.0
    """Time between two pings [s]."""

    def __post_init__(self) -> None:
        WebhookSettings.__post_init__(self)
        if not 1 <= self.period <= 86_400:
            raise AlarmError(f"period is {self.period} s; a heartbeat needs 1 to 86400 s")


@dataclass(frozen=True, slots=True)
class MqttSettings:
    """A section [[mqtt]]: every message is published as JSON under topic/TURBINE/KIND."""

    host: str
    """Name or address of the broker."""
    port: int = 1883
    """Port of the broker; with TLS mostly 8883."""
    topic: str = "pilewatch/notices"
    """First levels of the topic."""
    user: str = ""
    """User at the broker; empty: none."""
    password_environment: str = ""
    """Variable with the password."""
    tls: bool = False
    """Whether the link is encrypted and the broker's certificate checked."""
    timeout: float = 10.0
    """Deadline of a whole delivery [s]."""
    ca: str = ""
    """PEM file of the authority of the broker's certificate; "": the system's authorities."""

    def __post_init__(self) -> None:
        _require_port(self.port)
        _require_set(self.password_environment, "password_environment")
        _require_file(self.ca)
        _require_timeout(self.timeout)
        if not self.topic or any(letter in self.topic for letter in "#+"):
            raise AlarmError(f"topic is {self.topic!r}; one to publish on has no # and no +")
        if self.ca and not self.tls:
            raise AlarmError("ca without tls = true: no certificate would be checked")


@dataclass(frozen=True, slots=True)
class MailSettings:
    """A section [[mail]]: every message is a short e-mail."""

    host: str
    """Name or address of the mail server."""
    sender: str
    """Address of the sender."""
    recipients: tuple[str, ...]
    """Addresses of the recipients."""
    port: int = 587
    """Port of the mail server: 587 with STARTTLS, 465 with `tls`."""
    starttls: bool = True
    """Whether the link is encrypted after its first lines; a server that cannot gets nothing."""
    user: str = ""
    """User at the mail server; empty: none."""
    password_environment: str = ""
    """Variable with the password."""
    timeout: float = 30.0
    """Deadline of a whole delivery [s]."""
    tls: bool = False
    """Whether the link is encrypted from its first byte, in place of STARTTLS."""
    ca: str = ""
    """PEM file of the authority of the server's certificate; "": the system's authorities."""

    def __post_init__(self) -> None:
        _require_port(self.port)
        _require_set(self.password_environment, "password_environment")
        _require_file(self.ca)
        _require_timeout(self.timeout)
        if not self.recipients:
            raise AlarmError("recipients is empty; at least one address is needed")
        for address in (self.sender, *self.recipients):
            if "@" not in address or any(letter in address for letter in "\r\n"):
                raise AlarmError(f"{address!r} is no e-mail address")
        encrypted = self.starttls or self.tls
        if self.user and not encrypted and self.host not in ("localhost", "127.0.0.1"):
            raise AlarmError("user without starttls or tls: a password would travel readable")
        if self.port == TLS_PORT and not self.tls:
            raise AlarmError("port 465 speaks TLS from the first byte; add tls = true")


@dataclass(frozen=True, slots=True)
class AlarmSettings:
    """The whole file."""

    notices: AlarmLogSettings = field(default_factory=AlarmLogSettings)
    """Section [notices]."""
    webhook: tuple[WebhookSettings, ...] = ()
    """Sections [[webhook]]."""
    mqtt: tuple[MqttSettings, ...] = ()
    """Sections [[mqtt]]."""
    mail: tuple[MailSettings, ...] = ()
    """Sections [[mail]]."""
    heartbeat: tuple[HeartbeatSettings, ...] = ()
    """Sections [[heartbeat]]."""


_CHANNELS: dict[str, type] = {
    "webhook": WebhookSettings,
    "mqtt": MqttSettings,
    "mail": MailSettings,
    "heartbeat": HeartbeatSettings,
}


def load_notices(path: Path) -> AlarmSettings:
    """Read a notices file.

    Raises
    ------
    AlarmError
        If it cannot be read, or has an unknown key, a wrong value or a variable of the environment
        that is not set.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise AlarmError(f"--notices {path} cannot be read: {reason}") from error
    return notices_settings(toml_table(text, str(path), AlarmError), str(path))


def notices_settings(table: Mapping[str, Any], origin: str) -> AlarmSettings:
    """Return the settings of a table; `origin` names it in errors. Raises AlarmError."""
    unknown = [key for key in table if key not in ("notices", *_CHANNELS)]
    if unknown:
        known = ", ".join(("[notices]", *(f"[[{name}]]" for name in _CHANNELS)))
        raise AlarmError(f"{origin}: unknown section {unknown[0]!r}; it takes {known}")
    log = settings_from_table(
        AlarmLogSettings, table.get("notices", {}), f"{origin} [notices]", AlarmError
    )
    channels: dict[str, tuple[Any, ...]] = {}
    for name, settings in _CHANNELS.items():
        given = table.get(name, [])
        if not isinstance(given, list):
            raise AlarmError(f"{origin}: write [[{name}]] in two brackets: there may be several")
        channels[name] = tuple(
            settings_from_table(settings, each, f"{origin} [[{name}]] {number}", AlarmError)
            for number, each in enumerate(given, start=1)
        )
    if not any(channels.values()):
        raise AlarmError(
            f"{origin} names no receiver: add {' or '.join(f'[[{name}]]' for name in _CHANNELS)}"
        )
    return AlarmSettings(notices=log, **channels)


def secret(variable: str) -> str:
    """Return the value of a variable of the environment; "" if none is named."""
    return os.environ.get(variable, "") if variable else ""


def _require_set(variable: str, key: str) -> None:
    if variable and variable not in os.environ:
        raise AlarmError(f"{key} names {variable}, which is not set in the environment")
    if any(letter in secret(variable) for letter in "\r\n"):
        raise AlarmError(f"{key} names {variable}, whose value has a line break")


def _require_port(port: int) -> None:
    if not 0 < port < 65_536:
        raise AlarmError(f"port is {port}; it is 1 to 65535")


def _require_timeout(timeout: float) -> None:
    if not 0 < timeout <= 3600:
        raise AlarmError(f"timeout is {timeout} s; a deadline is above 0 and at most 3600 s")


def _require_url(url: str) -> None:
    try:
        parts = urlsplit(url)
        known = parts.scheme in ("http", "https") and bool(parts.hostname) and parts.port != 0
    except ValueError:
        known = False
    if not known:
        raise AlarmError(f"url is {url!r}; it is like https://example.org/hook")


def _require_file(ca: str) -> None:
    if ca and not Path(ca).is_file():
        raise AlarmError(f"ca is {ca!r}; there is no such file")
