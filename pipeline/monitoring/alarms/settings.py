"""Whom to tell and how often: a TOML file of its own, so that no recording holds an address.

    [notices]
    reminder = 86400.0            # told again after so long while it lasts [s]; 0: never

    [[webhook]]
    url = "https://example.org/hook"

    [[mqtt]]
    host = "broker.example.org"

    [[mail]]
    host = "smtp.example.org"
    sender = "pilewatch@example.org"
    recipients = ["engineer@example.org"]

Passwords and tokens are read from the environment; the file names the variables.
"""

import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from sensors.errors import InputError
from sensors.settings import settings_from_table

KINDS = ("change", "gap", "silence", "sensor", "untrusted", "refused", "node", "recorder")


class AlarmError(InputError):
    """A notices file that cannot be right; the message names file, section and key."""


@dataclass(frozen=True, slots=True)
class AlarmLogSettings:
    """Section [notices]: what is worth a notice, and how often it is told."""

    kinds: tuple[str, ...] = KINDS
    reminder: float = 86_400.0  # told again after so long, while it lasts unacknowledged [s]
    settle: float = 900.0  # what comes back within this is the same notice [s]
    shortest_gap: float = 60.0  # of missing measurements that is worth a notice [s]

    def __post_init__(self) -> None:
        for kind in self.kinds:
            if kind not in KINDS:
                raise AlarmError(f"kinds has {kind!r}; there are {', '.join(KINDS)}")
        for name in ("reminder", "settle", "shortest_gap"):
            if not getattr(self, name) >= 0:
                raise AlarmError(f"{name} is {getattr(self, name)}; it must not be negative")


@dataclass(frozen=True, slots=True)
class WebhookSettings:
    """A section [[webhook]]: every telling is POSTed as JSON."""

    url: str
    token_environment: str = ""  # variable with a token, sent as `Authorization: Bearer …`
    timeout: float = 10.0  # [s]

    def __post_init__(self) -> None:
        if urlsplit(self.url).scheme not in ("http", "https") or not urlsplit(self.url).netloc:
            raise AlarmError(f"url is {self.url!r}; it is like https://example.org/hook")
        _require_set(self.token_environment, "token_environment")


@dataclass(frozen=True, slots=True)
class MqttSettings:
    """A section [[mqtt]]: every telling is published as JSON under topic/TURBINE/KIND."""

    host: str
    port: int = 1883
    topic: str = "pilewatch/notices"
    user: str = ""
    password_environment: str = ""  # variable with the password
    tls: bool = False  # the broker's certificate is checked by the system's authorities
    timeout: float = 10.0  # [s]

    def __post_init__(self) -> None:
        _require_port(self.port)
        _require_set(self.password_environment, "password_environment")
        if not self.topic or any(letter in self.topic for letter in "#+"):
            raise AlarmError(f"topic is {self.topic!r}; one to publish on has no # and no +")


@dataclass(frozen=True, slots=True)
class MailSettings:
    """A section [[mail]]: every telling is a short e-mail."""

    host: str
    sender: str
    recipients: tuple[str, ...]
    port: int = 587
    starttls: bool = True
    user: str = ""
    password_environment: str = ""
    timeout: float = 30.0  # [s]

    def __post_init__(self) -> None:
        _require_port(self.port)
        _require_set(self.password_environment, "password_environment")
        if not self.recipients:
            raise AlarmError("recipients is empty; at least one address is needed")
        for address in (self.sender, *self.recipients):
            if "@" not in address or any(letter in address for letter in "\r\n"):
                raise AlarmError(f"{address!r} is no e-mail address")
        if self.user and not self.starttls and self.host not in ("localhost", "127.0.0.1"):
            raise AlarmError("user without starttls: a password would travel readable")


@dataclass(frozen=True, slots=True)
class AlarmSettings:
    """The whole file."""

    notices: AlarmLogSettings = field(default_factory=AlarmLogSettings)
    webhook: tuple[WebhookSettings, ...] = ()
    mqtt: tuple[MqttSettings, ...] = ()
    mail: tuple[MailSettings, ...] = ()


_CHANNELS: dict[str, type] = {
    "webhook": WebhookSettings,
    "mqtt": MqttSettings,
    "mail": MailSettings,
}


def load_notices(path: Path) -> AlarmSettings:
    """The file's settings. Raises AlarmError: it cannot be read, an unknown key, a wrong value,
    a variable of the environment that is not set."""
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise AlarmError(f"--notices {path} cannot be read: {reason}") from error
    except tomllib.TOMLDecodeError as error:
        raise AlarmError(f"{path}: not valid TOML: {error}") from error
    return notices_settings(table, str(path))


def notices_settings(table: Mapping[str, Any], origin: str) -> AlarmSettings:
    """The settings that a table describes; `origin` names it in errors. Raises AlarmError."""
    unknown = [key for key in table if key not in ("notices", *_CHANNELS)]
    if unknown:
        known = ", ".join(("[notices]", *(f"[[{name}]]" for name in _CHANNELS)))
        raise AlarmError(f"{origin}: unknown section {unknown[0]!r}; it takes {known}")
    book = settings_from_table(
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
        raise AlarmError(f"{origin} names nobody to tell: add [[webhook]], [[mqtt]] or [[mail]]")
    return AlarmSettings(notices=book, **channels)


def secret(variable: str) -> str:
    """What a variable of the environment holds; "" where none is named."""
    return os.environ.get(variable, "") if variable else ""


def _require_set(variable: str, key: str) -> None:
    if variable and variable not in os.environ:
        raise AlarmError(f"{key} names {variable}, which is not set in the environment")


def _require_port(port: int) -> None:
    if not 0 < port < 65_536:
        raise AlarmError(f"port is {port}; it is 1 to 65535")
