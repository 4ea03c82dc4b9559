"""Many turbines live: memory of a session, and whether every window is answered in time.

    python -m tests.benchmarks live_farm [--turbines 100] [--windows 1] [--speed 1] [--shards 2]
        [--hurry 1] [--exact] [--write]

    publisher: 100 × 8 channels × 40 Hz ══► session in processes ══► recording

Every turbine sends another part of the shipped recording (60 min, 40 Hz, 8 channels). Memory is the
proportional set size of the session and its children, read every five seconds. A window is late
when its posterior is recorded after the next window's end. The publisher is no part of the session.
`--hurry 15` sends all but a window's last 30 s at fifteen times that speed: what memory holds and
what there is to do when all windows end at once are the same, ten minutes sooner.
"""

import argparse
import os
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.messages import FoundationPosterior, WindowRejected
from pipeline.recording.reader import read_messages, recorded_messages
from pipeline.recording.rotation import parts_of
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from tests.benchmarks._results import keep

RECORDING = Path(__file__).parents[2] / "recordings" / "parked.mcap"
WINDOW = 600  # [s]
APART = 23  # between the parts of the recording that two neighbours send [s]
CALM = 30  # of a window's end that is not sent in a hurry [s]
STARTING = 30.0  # from the first process's start to the last one's [s]
AFTER = 400.0  # for the last posteriors, at most [s]
SCENARIO = """
title = "Turbines that send the shipped recording"
[turbine]
description = "iea15mw_monopile"
[farm]
turbines = {turbines}
"""
EXACT = '[structure]\nuncertain = "exact"\n'


def main(arguments: list[str]) -> None:
    """Print memory and lags."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks live_farm")
    parser.add_argument("--turbines", type=int, default=100)
    parser.add_argument("--windows", type=int, default=1)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--shards", type=int, default=2)
    parser.add_argument("--hurry", type=float, default=1.0)
    parser.add_argument("--exact", action="store_true")
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as folder:
        figures = measured(chosen, Path(folder))
    for name, value in figures.items():
        print(f"{name}: {value}")
    if chosen.write:
        name = f"live-farm-{chosen.turbines}"
        command = (
            f"python -m tests.benchmarks live_farm --turbines {chosen.turbines} "
            f"--speed {chosen.speed:g} --hurry {chosen.hurry:g} --write"
        )
        keep(name, figures, command=command, depends=("pipeline", "sensors"))


def measured(chosen: argparse.Namespace, folder: Path) -> dict[str, Any]:
    """Run a session that hears the turbines."""
    scenario, out, endpoint = folder / "farm.toml", folder / "out", free_endpoint()
    text = SCENARIO.format(turbines=chosen.turbines) + (EXACT if chosen.exact else "")
    scenario.write_text(text, encoding="utf-8")
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--processes"]
    command += ["--no-rrd", "--scenario", str(scenario), "--listen", endpoint, "--out", str(out)]
    command += ["--shards", str(chosen.shards)]
    session = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    memory: list[dict[str, float]] = []
    done = threading.Event()
    watching = threading.Thread(target=watch, args=(session.pid, memory, done), daemon=True)
    watching.start()
    try:
        wait_for(endpoint)
        time.sleep(STARTING)
        bus, answers = ZenohBus(ZenohSettings(mode="peer", connect=(endpoint,))), Inbox()
        subscription = bus.subscribe((FoundationPosterior, WindowRejected), answers)
        seconds = chosen.windows * WINDOW + 5
        sent = publish(bus, chosen.turbines, seconds, chosen.speed, chosen.hurry)
        wait_for_answers(answers, chosen.turbines * chosen.windows)
        subscription.close()
        bus.close()
    finally:
        done.set()
        session.send_signal(signal.SIGINT)
        session.wait(120)
    lags, rejected = lags_of(out)
    period = WINDOW / chosen.speed
    expected = chosen.turbines * chosen.windows
    return {
        "turbines": chosen.turbines,
        "speed": chosen.speed,
        "hurry": chosen.hurry,
        "blocks": sent,
        "windows": expected,
        "posteriors": len(lags),
        "rejected": rejected,
        "late": expected - rejected - int((lags < period).sum()),
        "longest_lag_s": round(float(lags.max(initial=0.0)), 1),
        "largest_pss_gb": round(max(sum(each.values()) for each in memory) / 1e9, 3),
        "pss_mb_by_process": {
            name: round(value / 1e6)
            for name, value in max(memory, key=lambda each: sum(each.values())).items()
        },
        "cpu_s_of_session": round(resource_of_children(), 1),
    }


def resource_of_children() -> float:
    """CPU of the session, which has ended [s]."""
    used = os.times()
    return used.children_user + used.children_system


def publish(bus: ZenohBus, turbines: int, seconds: int, speed: float, hurry: float) -> int:
    """Send blocks of a second of every turbine at so many times real time; return their number."""
    layout, samples = recorded()
    names = [f"t{number:02d}" for number in range(1, turbines + 1)]
    for name in names:
        bus.publish(replace(layout, turbine=name))
    due, start_ns, count = time.monotonic(), time.time_ns(), 0
    for second in range(seconds):
        for place, name in enumerate(names):
            block = samples[(second + APART * place) % len(samples)]
            bus.publish(
                replace(
                    block,
                    turbine=name,
                    session="live",
                    sequence=second,
                    first_sample=second * len(block.samples),
                    start_ns=start_ns + second * NANOSECONDS,
                )
            )
            count += 1
        calm = second % WINDOW >= WINDOW - CALM or second >= seconds - CALM
        due += 1.0 / (speed if calm else speed * hurry)
        time.sleep(max(0.0, due - time.monotonic()))
    return count


def recorded() -> tuple[SensorLayout, list[AccelerationBlock]]:
    """The shipped recording's layout and blocks."""
    messages = list(read_messages(RECORDING, (SensorLayout, AccelerationBlock)))
    layout = next(each for each in messages if isinstance(each, SensorLayout))
    return layout, [each for each in messages if isinstance(each, AccelerationBlock)]


def watch(session: int, memory: list[dict[str, float]], done: threading.Event) -> None:
    """Note the memory of a process and its descendants [bytes]."""
    while not done.wait(5.0):
        memory.append({name_of(each): pss(each) for each in descendants(session)})


def name_of(process: int) -> str:
    """Its command, from `run` or `node` on, and its number."""
    try:
        words = Path(f"/proc/{process}/cmdline").read_text("utf-8").split("\0")
    except OSError:
        words = []
    node = words[words.index("node") + 1] if "node" in words else "run"
    return f"{node} {process}"


def descendants(process: int) -> Iterator[int]:
    """Yield a process and all that it started."""
    yield process
    try:
        children = Path(f"/proc/{process}/task/{process}/children").read_text("ascii").split()
    except OSError:
        return
    for child in children:
        yield from descendants(int(child))


def pss(process: int) -> float:
    """Proportional set size [bytes]; 0 of one that has ended."""
    try:
        text = Path(f"/proc/{process}/smaps_rollup").read_text("ascii")
    except OSError:
        return 0.0
    return 1024.0 * sum(int(each) for each in re.findall(r"^Pss: +(\d+)", text, re.MULTILINE))


def wait_for(endpoint: str, patience: float = 60.0) -> None:
    """Return when a session listens."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    deadline = time.monotonic() + patience
    while True:
        with closing(socket.socket()) as probe:
            if probe.connect_ex((host, int(port))) == 0:
                return
        if time.monotonic() > deadline:
            raise TimeoutError(f"{endpoint}: the session did not start")
        time.sleep(0.2)


def wait_for_answers(answers: Inbox, expected: int) -> None:
    """Return when all windows are answered, or no more are waited for."""
    deadline, count = time.monotonic() + AFTER, 0
    while count < expected and time.monotonic() < deadline:
        count += answers.get(timeout=1.0) is not None


def lags_of(out: Path) -> tuple[np.ndarray, int]:
    """Time from each posterior's last block to its recording, shape (n,) [s]; rejected windows."""
    came: dict[str, dict[int, int]] = {}
    lags, rejected = [], 0
    for part in parts_of(out / "session.mcap"):
        for each in recorded_messages(part):
            turbine = each.key.split("/")[1]
            if each.message_type is AccelerationBlock:
                came.setdefault(turbine, {})[each.publish_time] = each.log_time
            elif each.message_type is WindowRejected:
                rejected += 1
            elif each.message_type is FoundationPosterior:
                last = max(t for t in came[turbine] if t < each.publish_time)
                lags.append((each.log_time - came[turbine][last]) / NANOSECONDS)
    return np.array(lags), rejected
