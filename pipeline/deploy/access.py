"""Who may publish and read what, as Zenoh's access control: everything else is dropped.

    unit      publishes its own acceleration, layout, gap and end, and its turbine's SCADA; it alone
              reads which of its blocks the shore has recorded, which the shore alone publishes
    node      a machine with nodes of identification or updating: publishes their results and
              status, reads what a viewer reads
    viewer    reads everything else and publishes nothing
    own nodes on the shore machine itself, over loopback without TLS: everything

Rules name kinds of messages, keys and a direction as the router sees it: what comes in from a unit
must be allowed, and so must what goes out to it (subscriptions, requests for what was
missed). What a publisher keeps for late subscribers is asked for on keys with /@adv/, which no
wildcard of ordinary keys matches. Source: https://zenoh.io/docs/manual/access-control
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.deploy.certificates import AUTHORITY, Identity
from sensors.acquisition.key_parts import named_key_part_error
from sensors.errors import InputError
from sensors.json_values import Json

SHORE = "shore"
SENDS = ["put", "delete", "declare_queryable", "reply", "liveliness_token"]
RECEIVES = ["declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"]
PUBLISHED = ("acceleration", "layout", "gap", "end")  # by a unit, on keys of its own
OWN = "own nodes"  # with a space, so that no machine has the same name
ACKNOWLEDGED = "recorded"  # by the shore, on a unit's keys
COMPUTED = (
    "modal-estimate",
    "stabilisation-diagram",
    "window-rejected",
    "foundation-posterior",
    "foundation-event",
    "status/*",
)  # by nodes of identification and updating, of any turbine
# Of a service, whose machine may start before the shore; a viewer's command fails at once.
WAITS_FOR_ITS_SHORE: Json = {
    "timeout_ms": -1,
    "exit_on_failure": False,
    "retry": {"period_init_ms": 500, "period_max_ms": 10000, "period_increase_factor": 2},
}
EVERY_KEY = ["pilewatch/**", "pilewatch/**/@adv/**", "pilewatch/@status/**"]


@dataclass(frozen=True, slots=True)
class Unit:
    """An acquisition unit that may publish."""

    turbine: str
    unit: str

    @property
    def name(self) -> str:
        """Name in the unit's certificate."""
        return f"{self.turbine}.{self.unit}"

    @property
    def keys(self) -> list[str]:
        """What it may publish on."""
        own = [f"pilewatch/{self.turbine}/{self.unit}/{kind}" for kind in PUBLISHED]
        return _with_caches([*own, f"pilewatch/{self.turbine}/scada"])

    @property
    def acknowledged(self) -> list[str]:
        """Keys on which it reads which of its blocks are recorded."""
        return _with_caches([f"pilewatch/{self.turbine}/{self.unit}/{ACKNOWLEDGED}"])


def _with_caches(keys: Sequence[str]) -> list[str]:
    """Keys, and where what their publishers keep is asked for."""
    return [each for key in keys for each in (key, f"{key}/@adv/**")]


def parse_unit(text: str) -> Unit:
    """TURBINE/UNIT. Raises InputError for anything else."""
    turbine, slash, unit = text.partition("/")
    wrong = named_key_part_error(turbine) or named_key_part_error(unit)
    if not slash or wrong:
        raise InputError(
            f"--unit {text!r} is not TURBINE/UNIT, e.g. t1/tower{': ' + wrong if wrong else ''}"
        )
    return Unit(turbine, unit)


def access_control(
    units: Sequence[Unit], viewers: Sequence[str], nodes: Sequence[str] = ()
) -> Json:
    """Return the `access_control` section of the shore station's configuration."""
    policies = [
        (
            _publishing(each.name, each.keys) + _acknowledged(each.name, each.acknowledged),
            each.name,
        )
        for each in units
    ]
    policies += [(_publishing(each, _computed_keys()) + _reading(each), each) for each in nodes]
    policies += [(_reading(each), each) for each in viewers]
    own = _rule(OWN, SENDS + RECEIVES, ["ingress", "egress"], ["**", *EVERY_KEY])
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rules, _ in policies for rule in rules] + [own],
        "subjects": [{"id": name, "cert_common_names": [name]} for _, name in policies]
        + [{"id": OWN, "link_protocols": ["tcp"], "interfaces": ["lo"]}],
        "policies": [
            {"rules": [rule["id"] for rule in rules], "subjects": [name]}
            for rules, name in policies
        ]
        + [{"rules": [OWN], "subjects": [OWN]}],
    }


def _publishing(name: str, keys: list[str]) -> list[Json]:
    """Let a machine's messages in, and others' requests out to it."""
    return [
        _rule(f"{name} publishes", SENDS, ["ingress"], keys),
        _rule(f"{name} is asked", RECEIVES, ["egress"], EVERY_KEY),
    ]


def _reading(name: str) -> list[Json]:
    """Let a machine's requests in and others' messages out to it, except what is recorded."""
    to_all = _with_caches([f"pilewatch/*/*/{ACKNOWLEDGED}"])
    return [
        _rule(f"{name} receives", SENDS, ["egress"], EVERY_KEY),
        _rule(f"{name} asks", RECEIVES, ["ingress"], EVERY_KEY),
        *_acknowledged(name, to_all, "deny"),
    ]


def _computed_keys() -> list[str]:
    """Keys on which nodes of identification and updating publish."""
    return _with_caches([f"pilewatch/*/{kind}" for kind in COMPUTED])


def _acknowledged(name: str, keys: list[str], permission: str = "allow") -> list[Json]:
    """That a machine may, or may not, read keys on which others publish. What is denied outweighs
    what is allowed."""
    return [
        _rule(f"{name} is acknowledged", SENDS, ["egress"], keys) | {"permission": permission},
        _rule(f"{name} asks what is recorded", RECEIVES, ["ingress"], keys)
        | {"permission": permission},
    ]


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> Json:
    return {
        "id": name,
        "messages": messages,
        "flows": flows,
        "permission": "allow",
        "key_exprs": keys,
    }


def write_configurations(
    folder: Path,
    units: Sequence[Unit],
    viewers: Sequence[str],
    nodes: Sequence[str] = (),
    *,
    host: str,
    port: int,
) -> list[Path]:
    """Zenoh configurations for `--zenoh-config` beside the certificates: shore.json5, one a unit,
    a viewer, a machine with nodes. They name the certificates by the folder they lie in now."""
    endpoint = f"tls/[{host}]:{port}" if ":" in host else f"tls/{host}:{port}"  # IPv6
    shore = _session("router", folder, SHORE) | {
        "listen": {"endpoints": [endpoint]},
        "access_control": access_control(units, viewers, nodes),
    }
    written = [_written(folder, SHORE, "the shore station: routes, and lets in who may", shore)]
    clients = {unit.name: "a unit on its tower" for unit in units}
    clients |= dict.fromkeys(nodes, "nodes of identification and updating")
    clients |= dict.fromkeys(viewers, "receives everything, sends nothing")
    for name, comment in clients.items():
        link = {"endpoints": [endpoint]} | ({} if name in viewers else WAITS_FOR_ITS_SHORE)
        client = _session("client", folder, name) | {"connect": link}
        written.append(_written(folder, name, comment, client))
    return written


def _session(mode: str, folder: Path, name: str) -> Json:
    identity, whole = Identity(name), folder.resolve()
    key, certificate = str(identity.key(whole)), str(identity.certificate(whole))
    return {
        "mode": mode,
        "scouting": {"multicast": {"enabled": False}},
        "timestamping": {"enabled": True},
        "transport": {
            "link": {
                "tls": {
                    "enable_mtls": True,
                    "verify_name_on_connect": True,
                    "root_ca_certificate": str(Identity(AUTHORITY).certificate(whole)),
                    "listen_private_key": key,
                    "listen_certificate": certificate,
                    "connect_private_key": key,
                    "connect_certificate": certificate,
                }
            }
        },
    }


def _written(folder: Path, name: str, comment: str, configuration: Json) -> Path:
    path = folder / f"{name}.json5"
    path.write_text(f"// {comment}\n{json.dumps(configuration, indent=2)}\n", encoding="utf-8")
    return path
