"""Who may publish and read what, as Zenoh's access control: everything else is dropped.

    unit      publishes its own acceleration, layout, gap and end, and its turbine's SCADA
    viewer    reads everything and publishes nothing
    own       nodes on the shore machine itself, over loopback without TLS: everything

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
from pipeline.state.json_values import Json
from pipeline.transport.bus import key_part_complaint
from sensors.errors import InputError

SHORE = "shore"
SAYS = ["put", "delete", "declare_queryable", "reply", "liveliness_token"]
HEARS = ["declare_subscriber", "query", "liveliness_query", "declare_liveliness_subscriber"]
EVERY_KEY = ["pilewatch/**", "pilewatch/**/@adv/**", "pilewatch/@status/**"]


@dataclass(frozen=True, slots=True)
class Unit:
    """An acquisition unit that may publish."""

    turbine: str
    unit: str

    @property
    def name(self) -> str:
        """In its certificate."""
        return f"{self.turbine}.{self.unit}"

    @property
    def keys(self) -> list[str]:
        """What it may publish on."""
        unit, scada = f"pilewatch/{self.turbine}/{self.unit}", f"pilewatch/{self.turbine}/scada"
        return [f"{unit}/*", f"{unit}/*/@adv/**", scada, f"{scada}/@adv/**"]


def parse_unit(text: str) -> Unit:
    """TURBINE/UNIT. Raises InputError for anything else."""
    turbine, slash, unit = text.partition("/")
    wrong = key_part_complaint(turbine) or key_part_complaint(unit)
    if not slash or wrong:
        raise InputError(
            f"--unit {text!r} is not TURBINE/UNIT, e.g. t1/tower{': ' + wrong if wrong else ''}"
        )
    return Unit(turbine, unit)


def access_control(units: Sequence[Unit], viewers: Sequence[str]) -> Json:
    """The `access_control` section of the shore station's configuration."""
    policies = [
        _policy(unit.name, says=unit.keys, hears=EVERY_KEY, is_unit=True) for unit in units
    ] + [_policy(viewer, says=EVERY_KEY, hears=EVERY_KEY, is_unit=False) for viewer in viewers]
    own = _rule("own", SAYS + HEARS, ["ingress", "egress"], ["**", *EVERY_KEY])
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rules, _ in policies for rule in rules] + [own],
        "subjects": [{"id": name, "cert_common_names": [name]} for _, name in policies]
        + [{"id": "own", "link_protocols": ["tcp"], "interfaces": ["lo"]}],
        "policies": [
            {"rules": [rule["id"] for rule in rules], "subjects": [name]}
            for rules, name in policies
        ]
        + [{"rules": ["own"], "subjects": ["own"]}],
    }


def _policy(
    name: str, *, says: list[str], hears: list[str], is_unit: bool
) -> tuple[list[Json], str]:
    """Rules of one machine: a unit's words come in and others' wishes go out to it; a viewer's
    wishes come in and others' words go out to it."""
    came_in, goes_out = ("ingress", "egress") if is_unit else ("egress", "ingress")
    return [
        _rule(f"{name} says" if is_unit else f"{name} is told", SAYS, [came_in], says),
        _rule(f"{name} is asked" if is_unit else f"{name} asks", HEARS, [goes_out], hears),
    ], name


def _rule(name: str, messages: list[str], flows: list[str], keys: list[str]) -> Json:
    return {
        "id": name,
        "messages": messages,
        "flows": flows,
        "permission": "allow",
        "key_exprs": keys,
    }


def write_configurations(
    folder: Path, units: Sequence[Unit], viewers: Sequence[str], *, host: str, port: int
) -> list[Path]:
    """Zenoh configurations for `--zenoh-config` beside the certificates: shore.json5, one a unit,
    one a viewer. They name the certificates by the folder they lie in now."""
    endpoint = f"tls/{host}:{port}"
    shore = _session("router", folder, SHORE) | {
        "listen": {"endpoints": [endpoint]},
        "access_control": access_control(units, viewers),
    }
    written = [_written(folder, SHORE, "the shore station: routes, and lets in who may", shore)]
    for unit in units:
        client = _session("client", folder, unit.name) | {"connect": {"endpoints": [endpoint]}}
        written.append(_written(folder, unit.name, "a unit on its tower", client))
    for viewer in viewers:
        client = _session("client", folder, viewer) | {"connect": {"endpoints": [endpoint]}}
        written.append(_written(folder, viewer, "hears everything, says nothing", client))
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
