"""A tower unit is light: what its commands load, how fast they start, what they install.

The modules of `publish` and `feed` are found in a process of their own. The nightly tests make an
environment with the wheel `pilewatch-edge` alone and let it publish and feed there.
"""

import json
import os
import re
import resource
import socket
import subprocess
import sys
import threading
import time
import venv
from pathlib import Path

import numpy as np
import pytest

from sensors.feeds.payloads.frame import Frame, encoded
from tests.sensors.feeds.broker import broker, free_port, mosquitto

ROOT = Path(__file__).parents[2]
HEAVY = ("rerun", "pyarrow", "scipy", "emcee", "arviz_stats", "pandas", "matplotlib", "h5py")
START_UP = 0.4  # of the command, for its own version or help [CPU s]
RESIDENT = 80.0  # of a feed with its link and its bus [MB]
INSTALLED = 150.0  # of a unit that feeds, without pip [MB]


def loaded_by(*modules: str) -> tuple[set[str], float]:
    """Heavy packages among what importing these loads, and the process's peak [MB]."""
    code = (
        "import importlib, json, pathlib, re, sys\n"
        f"for name in {list(modules)!r}: importlib.import_module(name)\n"
        f"heavy = [name for name in {HEAVY!r} if name in sys.modules]\n"
        "status = pathlib.Path('/proc/self/status').read_text()\n"
        "peak = int(re.search(r'VmHWM:\\s+(\\d+) kB', status)[1]) / 1024\n"
        "print(json.dumps([heavy, peak]))"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                         cwd=ROOT)  # fmt: skip
    heavy, peak = json.loads(ran.stdout)
    return set(heavy), peak


@pytest.mark.parametrize(
    "modules",
    [
        ("pipeline.cli.live", "pipeline.sources.feed_publisher", "sensors.feeds.mqtt"),
        ("pipeline.cli.live", "pipeline.sources.publisher", "pipeline.sources.recorded_source"),
    ],
    ids=["feed mqtt", "publish replay"],
)
def test_a_tower_units_commands_load_nothing_heavy(modules: tuple[str, ...]) -> None:
    heavy, peak = loaded_by(*modules)
    assert heavy == set()
    assert peak < RESIDENT


def test_the_settings_of_the_updating_load_no_sampler() -> None:
    """A unit that simulates reads a whole scenario, and samples nothing."""
    heavy, _ = loaded_by("pipeline.scenario", "pipeline.sources.sources")
    assert not heavy & {"emcee", "arviz_stats", "rerun", "pyarrow"}


HELP = [["--help"], ["identify", "--help"], ["feed", "--help"]]


@pytest.mark.parametrize("arguments", HELP)
def test_the_commands_help_loads_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "import sys\n"
        f"sys.argv = ['pilewatch', *{arguments!r}]\n"
        "from pipeline.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        f"print([name for name in {HEAVY!r} if name in sys.modules], file=sys.stderr)"
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                         cwd=ROOT)  # fmt: skip
    assert "Usage" in ran.stdout
    assert ran.stderr.strip() == "[]"


@pytest.mark.nightly
@pytest.mark.parametrize("arguments", HELP)
def test_the_command_starts_at_once(arguments: list[str]) -> None:
    """CPU time; the best of five. Three workers on two cores make it half as much again."""
    spent = []
    for _ in range(5):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, "-m", "pipeline", *arguments], capture_output=True,
                       check=True, cwd=ROOT)  # fmt: skip
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spent.append(after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime)
    assert min(spent) <= START_UP


@pytest.fixture(scope="module")
def unit(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A clean environment with `pilewatch-edge[mqtt]`; its folder."""
    folder = tmp_path_factory.mktemp("edge")
    pip = [sys.executable, "-m", "pip", "-q", "--disable-pip-version-check"]
    source = ROOT / "pipeline" / "deploy" / "edge"
    made = subprocess.run([*pip, "wheel", "--no-deps", "-w", folder, source], check=False,
                          capture_output=True, text=True)  # fmt: skip
    if made.returncode:
        pytest.skip(f"a wheel cannot be built here: {made.stderr.strip().splitlines()[-1]}")
    (wheel,) = folder.glob("pilewatch_edge-*.whl")
    venv.create(folder / "env", with_pip=False)
    python = folder / "env" / "bin" / "python"
    into = [*pip, "--python", python, "install", f"{wheel}[mqtt]"]
    subprocess.run(into, check=True, capture_output=True)
    return folder


def size_of(folder: Path) -> float:
    """[MB]"""
    return sum(file.stat().st_size for file in folder.rglob("*") if file.is_file()) / 2**20


def in_unit(unit: Path, *arguments: str) -> subprocess.Popen[str]:
    """The command in the clean environment, started."""
    command = unit / "env" / "bin" / "pilewatch"
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.Popen([command, *arguments], stdout=subprocess.PIPE, text=True,
                            stderr=subprocess.PIPE, cwd=unit, env=clean)  # fmt: skip


def peak_of(process: subprocess.Popen[str]) -> float:
    """Largest resident size until it ends [MB]."""
    peak = 0.0
    status = Path(f"/proc/{process.pid}/status")
    while process.poll() is None:
        found = re.search(r"VmHWM:\s+(\d+) kB", status.read_text()) if status.exists() else None
        peak = max(peak, int(found[1]) / 1024) if found else peak
        time.sleep(0.1)
    return peak


LAYOUT = 'turbine = "t1"\n[[channels]]\nname = "ax"\nelevation = 9.0\ndirection = [1, 0, 0]\n'


@pytest.mark.nightly
def test_a_unit_is_small_and_names_what_it_leaves_out(unit: Path) -> None:
    assert size_of(unit / "env") < INSTALLED
    helped = in_unit(unit, "--help")
    helped.communicate(timeout=60)
    assert helped.returncode == 0
    refused = in_unit(unit, "run", "--source", "simulate:parked")
    _, said = refused.communicate(timeout=60)
    assert refused.returncode == 2
    assert "a tower unit (pilewatch-edge)" in " ".join(said.split())
    assert "Traceback" not in said


@pytest.mark.nightly
def test_a_unit_feeds_an_instrument_within_its_memory(unit: Path) -> None:
    """Over UDP, which needs no broker: ten frames of a second, all published."""
    (unit / "tower.toml").write_text(LAYOUT)
    port = free_port()
    fed = in_unit(unit, "feed", f"udp://127.0.0.1:{port}", "--layout", "tower.toml", "--for", "8")
    sender = threading.Thread(target=_send_frames, args=(port,), daemon=True)
    sender.start()
    peak = peak_of(fed)
    said, complaint = fed.communicate(timeout=60)
    assert fed.returncode == 0, complaint
    assert re.search(r"[1-9]\d* blocks of t1 published", said)
    assert 20 < peak < RESIDENT


def _send_frames(port: int) -> None:
    begin = time.time_ns()
    samples = np.ones((40, 1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        for second in range(60):
            start = begin + second * 10**9
            link.sendto(encoded(Frame(second, begin, start, 40.0, samples, ("ax",))),
                        ("127.0.0.1", port))  # fmt: skip
            time.sleep(0.1)


@pytest.mark.nightly
@pytest.mark.skipif(mosquitto() is None, reason="mosquitto is not installed")
def test_a_unit_feeds_from_a_broker_within_its_memory(unit: Path, tmp_path: Path) -> None:
    (unit / "tower.toml").write_text(LAYOUT)
    with broker(tmp_path) as running:
        address = f"mqtt://127.0.0.1:{running.port}/tower/#"
        fed = in_unit(unit, "feed", address, "--layout", "tower.toml", "--for", "6")
        peak = peak_of(fed)
        _, complaint = fed.communicate(timeout=60)
    assert fed.returncode == 0, complaint
    assert 20 < peak < RESIDENT
