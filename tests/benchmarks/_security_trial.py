"""Who gets in and what of it gets through: a shore station with certificates and access control.

    unit t1/tower ──tls──► [shore: a live session, a router] ◄──tls── viewer, nodes elsewhere
    stranger, no certificate, wrong key, another unit's key        asked how it does

The station is a process of its own (`pilewatch run --source live --zenoh-config shore.json5`).
"""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.deploy.access import parse_unit, write_configurations
from pipeline.deploy.certificates import Identity, make_certificates
from pipeline.monitoring.status import ENDPOINT_FILE, STATUS_KEY
from pipeline.transport.bus import Inbox
from pipeline.transport.errors import TransportError
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, asked
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from tests.pipeline.example_messages import LAYOUT, block, status

NAMES = ["shore", "t1.tower", "t2.tower", "viewer", "compute"]
PATIENCE = 60.0  # for what another process does [s]


@dataclass(frozen=True, slots=True)
class SecurityOutcome:
    """What a shore station let in."""

    refused: dict[str, bool]  # who tried to connect → whether it was refused
    own_blocks: int  # of the unit that may, as the station says
    foreign_blocks: int  # of another unit, sent with the first one's certificate
    viewer_heard: int  # blocks of the unit that the viewer received
    viewer_said: int  # of the viewer's words that the station took
    forged_statuses: int  # of nodes of the station, sent by the unit
    node_statuses: int  # of a node on another machine, sent by that machine
    node_blocks: int  # of a unit, sent by that machine
    told_connections: tuple[str, ...]  # names in certificates, as `pilewatch status` shows them
    exit_code: int


def security_trial(folder: Path, *, n_blocks: int = 20) -> SecurityOutcome:
    """Everybody tries."""
    port = _free_port()
    ours, foreign = folder / "ours", folder / "foreign"
    for place in (ours, foreign):
        make_certificates(place, NAMES, host="localhost")
        units = [parse_unit("t1/tower"), parse_unit("t2/tower")]
        write_configurations(place, units, ["viewer"], ["compute"], host="localhost", port=port)
    with station(ours / "shore.json5", folder / "out") as shore:
        refused = {who: not _gets_in(path) for who, path in strangers(ours, foreign).items()}
        with (
            closing(_bus(ours / "t1.tower.json5")) as unit,
            closing(_bus(ours / "viewer.json5")) as viewer,
            closing(_bus(ours / "compute.json5")) as compute,
        ):
            heard = Inbox()
            viewer.subscribe([AccelerationBlock], heard)
            unit.publish(LAYOUT)
            for sequence in range(n_blocks):
                unit.publish(block(sequence))
                unit.publish(block(sequence, turbine="t2"))
            unit.publish(status("forged"))
            viewer.publish(block(n_blocks, turbine="t3"))
            compute.publish(block(n_blocks, turbine="t4"))
            compute.publish(status("elsewhere"))
            received = _received(heard, n_blocks)
            told = _until(
                folder / "out",
                lambda told: _count(told, "t1") >= n_blocks and _statuses(told, "elsewhere") > 0,
            )
        shore.send_signal(signal.SIGTERM)
        exit_code = shore.wait(PATIENCE)
    return SecurityOutcome(
        refused=refused,
        own_blocks=_count(told, "t1"),
        foreign_blocks=_count(told, "t2"),
        viewer_heard=received,
        viewer_said=_count(told, "t3"),
        forged_statuses=_statuses(told, "forged"),
        node_statuses=_statuses(told, "elsewhere"),
        node_blocks=_count(told, "t4"),
        told_connections=tuple(sorted(told["connections"])),
        exit_code=exit_code,
    )


def strangers(ours: Path, foreign: Path) -> dict[str, Path]:
    """Configurations of those who must not get in."""
    proper = json.loads(_without_comment(ours / "t1.tower.json5"))
    # a unit waits for its shore; whoever is refused would wait for ever
    proper["connect"] = {"endpoints": proper["connect"]["endpoints"]}
    attempts = {"certificate of another authority": _with_tls(proper, foreign, "t1.tower")}
    attempts["no certificate"] = _with_tls(proper, ours, None)
    mixed = _with_tls(proper, ours, "t1.tower")
    mixed["transport"]["link"]["tls"]["connect_private_key"] = str(Identity("t2.tower").key(ours))
    attempts["key of another unit"] = mixed
    written = {}
    for number, (who, configuration) in enumerate(attempts.items()):
        written[who] = foreign / f"stranger-{number}.json5"
        written[who].write_text(json.dumps(configuration))
    return written


def _with_tls(configuration: dict[str, Any], folder: Path, name: str | None) -> dict[str, Any]:
    changed: dict[str, Any] = json.loads(json.dumps(configuration))
    tls = changed["transport"]["link"]["tls"]
    for entry in [each for each in tls if each.startswith(("connect_", "listen_"))]:
        del tls[entry]
    if name is None:
        tls["enable_mtls"] = False
        return changed
    tls["connect_certificate"] = str(Identity(name).certificate(folder))
    tls["connect_private_key"] = str(Identity(name).key(folder))
    return changed


def _without_comment(path: Path) -> str:
    return path.read_text().partition("\n")[2]


def _gets_in(path: Path) -> bool:
    try:
        ZenohBus(ZenohSettings(config_file=path)).close()
    except TransportError:
        return False
    return True


def _bus(path: Path) -> ZenohBus:
    return ZenohBus(ZenohSettings(config_file=path))


def _received(inbox: Inbox, wanted: int) -> int:
    count = 0
    while count < wanted and (message := inbox.get(timeout=PATIENCE / 4)) is not None:
        count += message.turbine == "t1"
    return count


def _count(told: dict[str, Any], turbine: str) -> int:
    key = f"pilewatch/{turbine}/tower/acceleration"
    return sum(each["messages"] for each in told["streams"] if each["key"] == key)


def _statuses(told: dict[str, Any], node: str) -> int:
    return sum(each["node"] == node for each in told["nodes"])


@contextmanager
def station(configuration: Path, out: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """A shore station in a process of its own, ready to be asked."""
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--no-rrd"]
    command += ["--scenario", "parked"]
    process = subprocess.Popen(
        [*command, "--zenoh-config", str(configuration), "--out", str(out)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        _until(out, lambda told: len(told["nodes"]) >= 4)
        yield process
    finally:
        process.kill()
        process.wait()


def _until(out: Path, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """What the station tells once it fulfils a condition."""
    deadline = time.monotonic() + PATIENCE
    told: dict[str, Any] = {}
    while time.monotonic() < deadline:
        try:
            (answer,) = asked((out / ENDPOINT_FILE).read_text().strip(), f"{STATUS_KEY}/*")
            told = json.loads(answer)
        except (OSError, InputError, ValueError):
            pass
        else:
            if condition(told):
                return told
        time.sleep(0.2)
    raise RuntimeError(f"the station did not come that far: {told}")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
