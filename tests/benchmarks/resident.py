"""Does the resident memory of a run's processes grow after its warm-up?

    python -m tests.benchmarks resident [--minutes 120] [--readings FILE] [--write]
    python -m tests.benchmarks resident --of FILE [--write]      figures of readings that are kept

    publisher: 4 turbines × 8 channels × 40 Hz at 10 × ══► session in processes ══► files, pictures

Every process of the session is read every five seconds. What it holds after the first quarter of
an hour is averaged over two minutes (two windows of each turbine); the slope is that of the line
through the averages, its standard error that of least squares, larger where neighbours resemble
each other: by sqrt((1 + r) / (1 - r)) with r the residuals' correlation from one to the next.

What fills by windows or by time has filled after fifty minutes at 10 ×: twenty estimates of a
turbine that a publisher keeps (`streams`), 36 windows one by one (`updating/state`), and the index
of a recording's part, which ends after an hour of real time. The slope is given from there on, too.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint
from sensors.arrays import FloatArray
from tests.benchmarks._results import keep
from tests.benchmarks.live_farm import SCENARIO, descendants, name_of, publish, wait_for

TURBINES, SPEED = 4, 10.0
WARM_UP = 900.0  # [s]
FILLED = 3000.0  # by when all that is bounded has filled [s]
AVERAGED = 120.0  # [s]
STARTING = 30.0  # [s]
Reading = tuple[float, dict[str, float]]  # time [s], process → resident [MB]


def main(arguments: list[str]) -> None:
    """Print the slopes."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks resident")
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--readings", type=Path, help="a file that keeps them as they come")
    parser.add_argument("--of", type=Path, help="readings of a run before, on the same commit")
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    if chosen.of:
        readings = json.loads(chosen.of.read_text("utf-8"))
    else:
        with tempfile.TemporaryDirectory() as folder:
            readings = session_of(chosen.minutes, Path(folder), chosen.readings)
    figures = figures_of(readings)
    print(json.dumps(figures, indent=1))
    if chosen.write:
        command = f"python -m tests.benchmarks resident --minutes {chosen.minutes:g} --write"
        keep("resident", figures, command=command, depends=("pipeline", "sensors"))


def session_of(minutes: float, folder: Path, kept: Path | None) -> list[Reading]:
    """Run a session that hears the turbines; return what its processes held."""
    scenario, endpoint = folder / "farm.toml", free_endpoint()
    scenario.write_text(SCENARIO.format(turbines=TURBINES), encoding="utf-8")
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--processes"]
    command += ["--scenario", str(scenario), "--listen", endpoint, "--out", str(folder / "out")]
    session = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    readings: list[Reading] = []
    done = threading.Event()
    watching = threading.Thread(target=watch, args=(session.pid, readings, done, kept), daemon=True)
    try:
        wait_for(endpoint)
        time.sleep(STARTING)
        bus = ZenohBus(ZenohSettings(mode="peer", connect=(endpoint,)))
        watching.start()
        publish(bus, TURBINES, round(60 * minutes * SPEED), SPEED, 1.0)
        bus.close()
    finally:
        done.set()
        session.send_signal(signal.SIGINT)
        session.wait(120)
    return readings


def watch(session: int, readings: list[Reading], done: threading.Event, kept: Path | None) -> None:
    """Read the session's processes every five seconds."""
    started = time.monotonic()
    while not done.wait(5.0):
        held = {name_of(each).split()[0]: resident(each) for each in descendants(session)}
        readings.append((time.monotonic() - started, held))
        if kept:
            kept.write_text(json.dumps(readings), encoding="utf-8")


def resident(process: int) -> float:
    """Memory of a process that is in RAM [MB]; 0 of one that has ended."""
    try:
        text = Path(f"/proc/{process}/status").read_text("ascii")
    except OSError:
        return 0.0
    return next((float(each.split()[1]) / 1e3 for each in text.splitlines() if "VmRSS" in each), 0)


def figures_of(readings: list[Reading]) -> dict[str, Any]:
    """Slope of each process after the warm-up, and its standard error [MB/h]."""
    times = np.array([time_s for time_s, _ in readings])
    names = [name for name in readings[-1][1] if all(name in held for _, held in readings)]
    found: dict[str, Any] = {"minutes": round(times[-1] / 60, 1), "turbines": TURBINES}
    for name in names:
        held = np.array([each[name] for _, each in readings])
        slope, error = slope_of(times[times > WARM_UP], held[times > WARM_UP])
        found[name] = {
            "slope_mb_h": round(slope, 2),
            "standard_error_mb_h": round(error, 2),
            "after_warm_up_mb": round(float(held[times > WARM_UP][0]), 1),
            "at_the_end_mb": round(float(held[-1]), 1),
        }
        if times[-1] > FILLED + 3 * AVERAGED:
            late = slope_of(times[times > FILLED], held[times > FILLED])
            found[name]["slope_after_50_minutes_mb_h"] = round(late[0], 2)
            found[name]["its_standard_error_mb_h"] = round(late[1], 2)
    return found


def slope_of(times: FloatArray, held: FloatArray) -> tuple[float, float]:
    """Slope of the line through two-minute averages, and its standard error [MB/h]."""
    piece = ((times - times[0]) // AVERAGED).astype(int)
    pieces = range(piece[-1])  # the last is not whole
    hours = np.array([times[piece == each].mean() for each in pieces]) / 3600
    mean = np.array([held[piece == each].mean() for each in pieces])
    line = np.polyfit(hours, mean, 1)
    left = mean - np.polyval(line, hours)
    spread = np.sqrt(left @ left / (len(hours) - 2))
    alike = np.clip(left[1:] @ left[:-1] / max(left @ left, 1e-12), 0.0, 0.95)
    error = spread / (hours.std() * np.sqrt(len(hours))) * np.sqrt((1 + alike) / (1 - alike))
    return float(line[0]), float(error)
