"""Services, images and the compose file: hardened, watched, and what their tools accept."""

import json
import re
import shutil
import socket
import subprocess
import tomllib
from importlib.resources import files
from pathlib import Path

import pytest
import typer

from pipeline.cli import app
from pipeline.runtime.watchdog import Watchdog, WatchdogNode
from tests.pipeline.example_messages import block

EXAMPLES = Path(str(files("pipeline.deploy") / "examples"))
UNITS = sorted(path.name for path in EXAMPLES.glob("*.service"))
MOST_EXPOSED = 4.0  # of systemd-analyze security, 0 to 10


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_the_watchdog_is_notified_while_messages_come_and_not_more_often_than_needed(
    tmp_path: Path,
) -> None:
    path, clock = str(tmp_path / "notify"), Clock()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(path)
        systemd.settimeout(5)
        node = WatchdogNode(Watchdog({"NOTIFY_SOCKET": path, "WATCHDOG_USEC": "20000000"}, clock))
        for second in range(25):
            clock.now = float(second)
            node.handle(block(second))
        heard = [systemd.recv(100) for _ in range(3)]
        systemd.setblocking(False)
        with pytest.raises(BlockingIOError):
            systemd.recv(100)

    assert heard == [b"READY=1\nWATCHDOG=1", b"WATCHDOG=1", b"WATCHDOG=1"]


def test_without_systemd_nothing_is_sent() -> None:
    Watchdog({}).alive()
    Watchdog({"NOTIFY_SOCKET": "/nowhere/at/all"}).alive()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_is_hardened(unit: str) -> None:
    command = ["systemd-analyze", "security", "--offline=true", str(EXAMPLES / unit)]
    done = subprocess.run(command, capture_output=True, text=True)
    found = re.search(r"exposure level for .*: ([0-9.]+)", done.stdout)

    assert found is not None, done.stderr
    assert float(found[1]) <= MOST_EXPOSED


@pytest.mark.parametrize("unit", ["pilewatch-shore.service", "pilewatch-feed@.service"])
def test_a_unit_is_started_again_when_its_messages_stop(unit: str) -> None:
    text = (EXAMPLES / unit).read_text()

    assert "Type=notify" in text
    assert re.search(r"^WatchdogSec=\d+$", text, re.MULTILINE)


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_whose_shore_is_not_there_yet_is_started_again_for_ever(unit: str) -> None:
    """By default systemd gives up after five starts in ten seconds."""
    text = (EXAMPLES / unit).read_text()
    kept_off = re.findall(r"^RestartPreventExitStatus=(.*)$", text, re.MULTILINE)

    assert kept_off == ["2"]
    assert "\nRestart=always\n" in text
    assert "\nStartLimitIntervalSec=0\n" in text.partition("[Service]")[0]


def test_the_compose_file_brings_up_a_session_with_prometheus_and_grafana() -> None:
    yaml = pytest.importorskip("yaml")
    compose = yaml.safe_load((EXAMPLES / "compose-session.yaml").read_text())
    services = compose["services"]

    assert set(services) == {"session", "prometheus", "grafana"}
    assert all(each.startswith("127.0.0.1:") for each in services["session"]["ports"])
    for service in services.values():
        for volume in service["volumes"]:
            source = volume.split(":")[0]
            assert (EXAMPLES / source).exists() if "." in source else source in compose["volumes"]
    provided = yaml.safe_load((EXAMPLES / "grafana-dashboards.yaml").read_text())
    folder = provided["providers"][0]["options"]["path"]
    assert any(f":{folder}/" in each for each in services["grafana"]["volumes"])
    containerfile = EXAMPLES.parents[2] / services["session"]["build"]["dockerfile"]
    assert containerfile.is_file()
    scraped = yaml.safe_load((EXAMPLES / "prometheus.yaml").read_text())
    port = services["session"]["command"][services["session"]["command"].index("--metrics") + 1]
    assert json.dumps(scraped).count(f"127.0.0.1:{port}") == 1


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed")
def test_promtool_accepts_the_alert_rules() -> None:
    rules = str(EXAMPLES / "pilewatch-alerts.yaml")
    assert subprocess.run(["promtool", "check", "rules", rules]).returncode == 0


def instructions(containerfile: str) -> list[tuple[str, str]]:
    """Instruction and its argument, continued lines joined."""
    lines = [line for line in containerfile.splitlines() if line and not line.startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    pairs = [line.strip().partition(" ") for line in joined.splitlines()]
    return [(name, argument.strip()) for name, _, argument in pairs]


@pytest.mark.parametrize("image", ["Containerfile.shore", "Containerfile.edge"])
def test_an_image_has_the_extras_commands_and_stages_that_it_names(image: str) -> None:
    found = instructions((EXAMPLES / image).read_text())
    assert {name for name, _ in found} <= {
        *("FROM", "COPY", "RUN", "ENV", "USER", "WORKDIR", "VOLUME", "STOPSIGNAL"),
        *("HEALTHCHECK", "ENTRYPOINT", "CMD"),
    }
    stages = [text.split()[2] for name, text in found if name == "FROM" and " AS " in text]
    copied = [text for name, text in found if name == "COPY" and "--from=" in text]
    assert [re.findall(r"--from=(\w+)", text) for text in copied] == [stages]
    assert [text for name, text in found if name == "USER"][-1] == "pilewatch"
    runs = " ".join(text for _, text in found)
    ((folder, extras),) = re.findall(r"/src((?:/\w+)*)\[([\w,]+)\]", runs)
    project = tomllib.loads((EXAMPLES.parents[2] / f".{folder}/pyproject.toml").read_text())[
        "project"
    ]
    assert set(extras.split(",")) <= set(project["optional-dependencies"])
    start = {name: json.loads(text) for name, text in found if name in ("ENTRYPOINT", "CMD")}
    program, command, *_ = [*start["ENTRYPOINT"], *start.get("CMD", [])]
    assert program in project["scripts"]
    assert command in typer.main.get_command(app).commands  # type: ignore[attr-defined]
