"""The example configurations, on other ports: towers, routers and a shore station hear each other.

towers t1, t2 ──► farm router A ──┐
tower  t3     ──► farm router B ──┴──► shore station ◄── viewer
"""

import configparser
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, closing, contextmanager
from importlib.resources import files
from pathlib import Path

import pytest
from typer.testing import CliRunner

from pipeline.cli import app
from pipeline.messages import NodeStatus, WindowRejected
from pipeline.nodes.sharding import Shard, ShardedNode
from pipeline.run.endpoints import bus_options, meeting_point
from pipeline.runtime.node_thread import NodeThread
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint
from pipeline.transport.zenoh_settings import configuration
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import block
from tests.pipeline.nodes.test_by_turbine import Teller
from tests.pipeline.transport.test_bus import PATIENCE, take

EXAMPLES = Path(str(files("pipeline.deploy") / "examples"))
ROLES = {
    "one-machine": "router",
    "tower-unit": "client",
    "shore-station": "router",
    "farm-router": "router",
    "viewer": "client",
}


def example(
    folder: Path, name: str, number: int = 0, *, listen: str = "", connect: str = ""
) -> ZenohSettings:
    """An example with other endpoints than the file's."""
    text = (EXAMPLES / f"{name}.json5").read_text()
    for key, endpoint in (("listen", listen), ("connect", connect)):
        if endpoint:
            pattern = rf'({key}: \{{\s*endpoints: \[)"[^"]*"'
            text, found = re.subn(pattern, rf'\1"{endpoint}"', text)
            assert found == 1
    path = folder / f"{name}-{number}.json5"
    path.write_text(text)
    return ZenohSettings(config_file=path)


@pytest.mark.parametrize("name", ROLES)
def test_every_example_is_a_configuration_that_stays_on_this_machine(name: str) -> None:
    path = EXAMPLES / f"{name}.json5"
    settings = ZenohSettings(config_file=path)
    assert settings.role == ROLES[name]
    configuration(settings)
    endpoints = re.findall(r'"(t(?:cp|ls)/[^"]+)"', path.read_text())
    assert endpoints
    assert all(endpoint.startswith("tcp/127.0.0.1:") for endpoint in endpoints)


def test_a_farm_behind_routers_is_heard_on_the_shore_and_by_a_viewer(tmp_path: Path) -> None:
    shore_at, a_at, b_at = free_endpoint(), free_endpoint(), free_endpoint()
    meeting = meeting_point(example(tmp_path, "shore-station", listen=shore_at))
    with ExitStack() as stack:

        def opened(settings: ZenohSettings) -> ZenohBus:
            return stack.enter_context(closing(ZenohBus(settings)))

        opened(meeting.hub)
        node, viewer = (
            opened(meeting.nodes),
            opened(example(tmp_path, "viewer", connect=shore_at)),
        )
        inboxes = Inbox(), Inbox()
        for bus, inbox in zip((node, viewer), inboxes, strict=True):
            bus.subscribe([AccelerationBlock], inbox)
        for number, at in enumerate((a_at, b_at)):
            opened(example(tmp_path, "farm-router", number, listen=at, connect=shore_at))
        towers = {
            turbine: opened(example(tmp_path, "tower-unit", number, connect=at))
            for number, (turbine, at) in enumerate((("t1", a_at), ("t2", a_at), ("t3", b_at)))
        }
        for sequence in range(20):
            for turbine, tower in towers.items():
                tower.publish(block(sequence, turbine=turbine))
        for inbox in inboxes:
            heard = take(inbox, 60)
            assert Counter(each.turbine for each in heard) == {"t1": 20, "t2": 20, "t3": 20}


def test_two_hosts_share_a_farm_through_the_shores_router(tmp_path: Path) -> None:
    """Each shard is a client of the router, as on a host of its own; every turbine is answered
    once, by its own shard, and a listener on the shore hears all answers."""
    shore_at, turbines = free_endpoint(), ("t1", "t2", "t3", "t4")
    meeting = meeting_point(example(tmp_path, "shore-station", listen=shore_at))
    with ExitStack() as stack:
        hub = stack.enter_context(closing(ZenohBus(meeting.hub)))
        answers, statuses = Inbox(), Inbox()
        hub.subscribe([WindowRejected], answers)
        hub.subscribe([NodeStatus], statuses)
        client = ZenohSettings(mode="client", connect=(shore_at,))
        shards = [
            NodeThread(ShardedNode(Teller(), Shard(n, 2, turbines)), lambda: ZenohBus(client), "t1")
            for n in (1, 2)
        ]
        for shard in shards:
            shard.start()
            stack.callback(shard.join, 10.0)
            stack.callback(shard.ask_to_stop)
        ready: set[str] = set()
        while len(ready) < 2:
            ready.update(each.node for each in take(statuses, 1))
        for sequence in range(5):
            for turbine in turbines:
                hub.publish(block(sequence, turbine=turbine))
        heard = take(answers, 20)
    assert ready == {"identification-1-of-2", "identification-2-of-2"}
    assert Counter(each.turbine for each in heard) == dict.fromkeys(turbines, 5)


def test_a_session_in_any_mode_tells_its_nodes_how_to_find_it(tmp_path: Path) -> None:
    client = meeting_point(ZenohSettings(mode="client", connect=("tcp/127.0.0.1:1",)))
    assert client.endpoint == "tcp/127.0.0.1:1"
    assert bus_options(client.nodes) == ["--connect", "tcp/127.0.0.1:1", "--mode", "client"]
    router = meeting_point(ZenohSettings(mode="router", listen=("tcp/127.0.0.1:2",)))
    assert router.hub.listen == ("tcp/127.0.0.1:2",)
    assert router.nodes == ZenohSettings(mode="client", connect=(router.endpoint,))
    peer = meeting_point(ZenohSettings())
    assert peer.hub.listen == (peer.endpoint,)
    assert peer.nodes == ZenohSettings(mode="client", connect=(peer.endpoint,))
    path = tmp_path / "peer.json5"
    path.write_text("{mode: 'peer', connect: {endpoints: ['tcp/127.0.0.1:3']}}")
    filed = meeting_point(ZenohSettings(config_file=path))
    assert filed.hub.endpoints == ("tcp/127.0.0.1:3",)
    assert filed.hub.local == filed.endpoint
    assert bus_options(filed.nodes) == ["--connect", filed.endpoint, "--mode", "client"]
    given = bus_options(ZenohSettings(listen=("tcp/127.0.0.1:4",), config_file=path))
    assert given == ["--listen", "tcp/127.0.0.1:4", "--zenoh-config", str(path)]


def test_the_units_of_systemd_run_commands_that_exist() -> None:
    for path in EXAMPLES.glob("*.service"):
        unit = configparser.ConfigParser(strict=False, interpolation=None)
        unit.optionxform = str
        unit.read_string(path.read_text().replace("\\\n", ""))
        words = unit["Service"]["ExecStart"].split()
        options = [word for word in words if word.startswith("--")]
        told = CliRunner(env={"COLUMNS": "200"}).invoke(app, [words[1], "--help"])
        assert told.exit_code == 0
        for option in options:
            assert option.removeprefix("--no-") in told.stdout or option in told.stdout


NAMESPACE = "pilewatch-test"
TOWER = """
import sys, time
from pathlib import Path
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from tests.pipeline.example_messages import block
from tests.pipeline.nodes.test_by_turbine import Teller
bus = ZenohBus(ZenohSettings(config_file=Path(sys.argv[1])))
for sequence in range(20):
    bus.publish(block(sequence))
sys.stdin.read()
bus.close()
"""


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True)


@contextmanager
def network_of_its_own() -> Iterator[str]:
    """A network namespace, linked to this one by a cable; gives this end's address."""
    name, near, far = f"{NAMESPACE}-{os.getpid()}", f"pwa{os.getpid()}", f"pwb{os.getpid()}"
    third = os.getpid() % 250
    ip("netns", "add", name)
    try:
        ip("link", "add", near, "type", "veth", "peer", "name", far, "netns", name)
        ip("addr", "add", f"10.213.{third}.1/30", "dev", near)
        ip("link", "set", near, "up")
        for words in (
            ("addr", "add", f"10.213.{third}.2/30", "dev", far),
            ("link", "set", far, "up"),
        ):
            ip("netns", "exec", name, "ip", *words)
        yield f"10.213.{third}.1"
    finally:
        ip("netns", "del", name)


def namespaces_can_be_made() -> bool:
    if shutil.which("ip") is None or os.geteuid() != 0:
        return False
    made = subprocess.run(["unshare", "-n", "true"], capture_output=True, check=False)
    return made.returncode == 0


@pytest.mark.skipif(not namespaces_can_be_made(), reason="network namespaces need root and ip")
def test_a_tower_in_a_network_of_its_own_reaches_the_shore_over_a_cable(tmp_path: Path) -> None:
    with network_of_its_own() as address, ExitStack() as stack:
        port = free_endpoint().rpartition(":")[2]
        shore_at = f"tcp/{address}:{port}"
        shore = example(tmp_path, "shore-station", listen=shore_at)
        bus = stack.enter_context(closing(ZenohBus(shore)))
        inbox = Inbox()
        bus.subscribe([AccelerationBlock], inbox)
        tower = example(tmp_path, "tower-unit", connect=shore_at)
        command = [sys.executable, "-c", TOWER, str(tower.config_file)]
        name = f"{NAMESPACE}-{os.getpid()}"
        process = subprocess.Popen(
            ["ip", "netns", "exec", name, *command], stdin=subprocess.PIPE, cwd=Path.cwd()
        )
        try:
            heard = take(inbox, 20)
            assert [each.sequence for each in heard] == list(range(20))
        finally:
            assert process.stdin is not None
            process.stdin.close()
            process.wait(PATIENCE)
