"""How a Zenoh session is set up: by a few settings, or by the file that zenohd reads too."""

import json
import re
import socket
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh

from pipeline.transport.errors import TransportError
from sensors.constants import HIGHEST_PORT, LOOPBACK

ANY_LOCAL_PORT = f"tcp/{LOOPBACK}:0"
LARGEST_MESSAGE = 16 * 2**20  # that a link takes in [bytes]: twice what the codec does
FIRST_RETRY_MS = 100  # to connect to a hub that is not there yet
LONGEST_RETRY_MS = 1000
PEM_BEGINS = b"-----BEGIN "
CERTIFICATE_FILES = (  # of transport/link/tls
    "root_ca_certificate",
    "listen_private_key",
    "listen_certificate",
    "connect_private_key",
    "connect_certificate",
)
WITH_PORT = ("tcp", "tls", "udp", "quic", "ws")  # protocols whose endpoints are a host and a port

_MESSAGE_OF_ERROR = re.compile(r'msg: "(.*)", location', re.DOTALL)
_SOURCE_OF_ERROR = re.compile(r"( at /\S+?:\d+\.?| \(os error \d+\))")  # inside zenoh's own code


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """How one session finds the others. Endpoints are like "tcp/127.0.0.1:7447"."""

    mode: Literal["peer", "client", "router"] = "peer"
    listen: tuple[str, ...] = ()
    """None: a peer takes any free port of the loopback interface."""
    connect: tuple[str, ...] = ()
    scouting: bool = False
    """Find other sessions by multicast."""
    config_file: Path | None = None
    """Zenoh's own JSON5; the settings above are laid over it."""
    local: str = ""
    """An endpoint on this machine that is listened on too, for nodes of its own."""

    @property
    def role(self) -> str:
        """The mode that the session will have: the file's where there is one.

        Raises TransportError for a file that is no configuration.
        """
        if self.config_file is None:
            return self.mode
        return str(json.loads(configuration_file(self.config_file).get_json("mode")) or "peer")

    @property
    def endpoints(self) -> tuple[str, ...]:
        """What is connected to."""
        if self.connect or self.config_file is None:
            return self.connect
        return _in_file(configuration_file(self.config_file), "connect/endpoints")


def is_endpoint(text: str) -> bool:
    """Whether Zenoh can connect to an endpoint, or listen at it, as far as its text tells."""
    protocol, _, rest = text.partition("/")
    address = re.split("[?#]", rest)[0]  # without metadata and configuration
    if protocol not in WITH_PORT:
        return bool(protocol and address)
    host, _, port = address.rpartition(":")
    return bool(host) and port.isdecimal() and int(port) <= HIGHEST_PORT


def hub(endpoint: str) -> ZenohSettings:
    """Return the one session that listens where all others look."""
    return ZenohSettings(listen=(endpoint,))


def peer_of(endpoint: str) -> ZenohSettings:
    """Return a session that finds the others through the hub at this endpoint."""
    return ZenohSettings(connect=(endpoint,))


def free_endpoint() -> str:
    """Return a loopback endpoint that nothing listens on at this moment."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return f"tcp/{LOOPBACK}:{probe.getsockname()[1]}"


def configuration(settings: ZenohSettings) -> zenoh.Config:
    """Return Zenoh's configuration. Raises TransportError where a file of it cannot be used."""
    config = zenoh.Config()
    if settings.config_file is not None:
        config = configuration_file(settings.config_file)
        _require_certificates(settings.config_file, config)
    for entry, value in _entries(settings).items():
        config.insert_json5(entry, json.dumps(value))
    return config


def _entries(settings: ZenohSettings) -> dict[str, Any]:
    """Return what is laid over Zenoh's defaults, or over the file where it leaves no choice."""
    entries: dict[str, Any] = {
        "timestamping/enabled": True,  # what is cached needs its time
        "transport/link/rx/max_message_size": LARGEST_MESSAGE,
    }
    listen = settings.listen
    if settings.local:
        if not listen and settings.config_file is not None:
            listen = _in_file(configuration_file(settings.config_file), "listen/endpoints")
        listen = (*listen, settings.local)
    if listen:
        entries["listen/endpoints"] = listen
    if settings.connect:
        entries["connect/endpoints"] = settings.connect
    if settings.config_file is not None:
        return entries
    if not listen and settings.mode != "client":
        entries["listen/endpoints"] = [ANY_LOCAL_PORT]
    return entries | {
        "mode": settings.mode,
        "scouting/multicast/enabled": settings.scouting,
        "connect/retry": {
            "period_init_ms": FIRST_RETRY_MS,
            "period_max_ms": LONGEST_RETRY_MS,
            "period_increase_factor": 2,
        },
    }


def configuration_file(path: Path) -> zenoh.Config:
    """Return the configuration in a file. Raises TransportError where it is none."""
    if not path.is_file():
        raise TransportError(f"there is no Zenoh configuration {path}")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise TransportError(
            f"{path} is no Zenoh configuration: {without_source(str(error))}"
        ) from error


def _require_certificates(path: Path, config: zenoh.Config) -> None:
    """Raise TransportError for a certificate or key that a file names and that cannot be read.

    Zenoh connects without it, and reports that no session answers.
    """
    files = json.loads(config.get_json("transport/link/tls"))
    for entry in CERTIFICATE_FILES:
        name = files.get(entry)
        if name is None:
            continue
        try:
            is_pem = PEM_BEGINS in Path(name).read_bytes()
        except OSError as error:
            raise TransportError(
                f"cannot read {name}: {error.strerror}; {path} names it ({entry}), and the user "
                "that the command runs as must be able to read it"
            ) from error
        if not is_pem:
            raise TransportError(
                f"{name} has no certificate or key (PEM); {path} names it ({entry})"
            )


def _in_file(config: zenoh.Config, key: str) -> tuple[str, ...]:
    """Endpoints of a configuration, which Zenoh also allows to differ by mode."""
    endpoints = json.loads(config.get_json(key))
    if isinstance(endpoints, dict):
        endpoints = endpoints.get(json.loads(config.get_json("mode")) or "peer") or []
    return tuple(str(each) for each in endpoints or [])


def explained(settings: ZenohSettings, error: str) -> str:
    """Return Zenoh's error in words that name what to change."""
    if "Address already in use" in error:
        return (
            f"cannot listen on {_listed(settings.listen)}: the port is in use; "
            "stop the other program or choose another endpoint"
        )
    if "Unable to connect" in error:
        return (
            f"no Zenoh session answers at {_listed(settings.endpoints)}; a client needs a router, "
            "and one with TLS needs certificates that it knows"
            if settings.config_file is not None
            else f"no Zenoh session answers at {_listed(settings.connect)}; a client needs a router"
        )
    if "No peer specified" in error:
        return "a client needs to know its router: --connect ENDPOINT, e.g. tcp/192.168.1.10:7447"
    return f"cannot open a Zenoh session: {without_source(error)}"


def _listed(endpoints: tuple[str, ...]) -> str:
    return ", ".join(endpoints) or "the endpoints of its configuration file"


def without_source(error: str) -> str:
    """Return Zenoh's error without the places in its source."""
    message = _MESSAGE_OF_ERROR.search(error)
    return " ".join(_SOURCE_OF_ERROR.sub("", message[1] if message else error).split())
