"""What a valid unit that misbehaves costs the others of a live session, in memory and in time.

    python -m tests.benchmarks misbehaving [--only FORM …] [--write]

    4 turbines × 8 channels × 40 Hz ══╗
    one unit of a fifth turbine ══════╩═► session in processes ══► recording

All send a window, all but its last half minute at fifteen times real time. Memory is the
proportional set size of the session and its children, beside that of the run without the fifth.
"""

import argparse
import json
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.messages import FoundationPosterior, ModalEstimate, WindowRejected
from pipeline.transport.bus import Inbox
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks import live_farm
from tests.benchmarks._results import keep, kept

TURBINES, HURRY, SECONDS = 4, 15.0, 605
PATIENCE = 20.0  # for an answer to the unit that misbehaves [s]
AFTER = 90.0  # for the last posteriors, at most [s]
PATIENT = 300.0  # for those that come later: half the time to the next window's end [s]
HONEST = {f"t{number:02d}" for number in range(1, TURBINES + 1)}
ANSWERS = (ModalEstimate, FoundationPosterior, WindowRejected)
Blocks = Iterator[AccelerationBlock]


def sent(n_channels: int, rate: float, length: float = 1.0) -> Blocks:
    """Noise of so many channels, in blocks of so many seconds, none of which comes twice: that
    would be refused as repeated."""
    rng, n = np.random.default_rng(1), round(rate * length)
    start_ns = time.time_ns()
    for number in range(int(SECONDS / length)):
        at = start_ns + round(number * length * NANOSECONDS)
        noise = rng.standard_normal((n, n_channels), dtype=np.float32)
        yield AccelerationBlock("t05", "tower", "s", "l", number, number * n, at, rate, noise)


def odd_sizes() -> Blocks:
    """Blocks of 1 to 4000 samples, without order."""
    rng = np.random.default_rng(2)
    for block in sent(8, 40.0):
        n = int(rng.integers(1, 4000))
        yield replace(block, samples=rng.standard_normal((n, 8)).astype(np.float32))


def strays() -> Blocks:
    """A sound unit, and every 300 s one block of another run under its name."""
    for block in sent(8, 40.0):
        yield block
        if block.sequence % 300 == 150:
            yield replace(block, session="another", sequence=7, first_sample=280)


def two_boxes() -> Blocks:
    """Two devices that send in turn under one name, the second one's clock two days behind."""
    behind = 2 * 86_400 * NANOSECONDS
    for one in sent(8, 40.0):
        yield one
        samples = one.samples[::-1].copy()
        yield replace(one, session="other", start_ns=one.start_ns - behind, samples=samples)


def wrong_stamps() -> Blocks:
    """Every block is stamped with another moment of twenty years."""
    rng = np.random.default_rng(3)
    for block in sent(8, 40.0):
        yield replace(
            block, start_ns=block.start_ns - int(rng.integers(0, 20 * 31_557_600)) * 10**9
        )


def jumping_numbers() -> Blocks:
    """Sequence numbers that jump up where no sample is missing."""
    rng, number = np.random.default_rng(4), 0
    for block in sent(8, 40.0):
        number += int(rng.integers(1, 1000))
        yield replace(block, sequence=number)


def missing_seconds() -> Blocks:
    """Every tenth second is missing by stamps and not by numbers."""
    for block in sent(8, 40.0):
        yield replace(block, start_ns=block.start_ns + block.sequence // 9 * NANOSECONDS)


def same_samples() -> Blocks:
    """The same ten seconds again and again under new numbers."""
    first: list[AccelerationBlock] = []
    for block in sent(8, 40.0):
        first += [block] if len(first) < 10 else []
        yield replace(block, samples=first[block.sequence % 10].samples)


FORMS: dict[str, Callable[[], Blocks]] = {
    "quiet": lambda: iter(()),
    "100 channels": lambda: sent(100, 40.0),
    "32 channels": lambda: sent(32, 40.0),
    "250 channels": lambda: sent(250, 40.0),
    "1000 channels": lambda: sent(1000, 40.0),
    "blocks of 7 MB": lambda: sent(8, 40.0 * 5500, 1.0),
    "16 channels at 1 kHz": lambda: sent(16, 1000.0),
    "8 channels at 10 kHz": lambda: sent(8, 10_000.0),
    "names of units": lambda: (replace(b, unit=f"u{b.sequence}") for b in sent(8, 40.0)),
    "names of turbines": lambda: (replace(b, turbine=f"bad{b.sequence}") for b in sent(8, 40.0)),
    "odd sizes": odd_sizes,
    "a stray block every 300 s": strays,
    "two boxes with one name": two_boxes,
    "wrong stamps": wrong_stamps,
    "numbers that jump": jumping_numbers,
    "every tenth second missing by the stamps": missing_seconds,
    "the same samples under new numbers": same_samples,
}


def main(arguments: list[str]) -> None:
    """Run the forms; print what each cost."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks misbehaving")
    parser.add_argument("--only", choices=[*FORMS], nargs="*", default=[*FORMS])
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    for form in chosen.only:
        with tempfile.TemporaryDirectory() as folder:
            figures = measured(FORMS[form], Path(folder))
        print(form, json.dumps(figures), flush=True)
        if chosen.write:  # form by form
            before = kept("misbehaving")
            keep(
                "misbehaving",
                (before["figures"] if before else {}) | {form: figures},
                command="python -m tests.benchmarks misbehaving --write",
                depends=("pipeline/nodes", "pipeline/oma", "pipeline/transport"),
            )


def measured(blocks: Callable[[], Blocks], folder: Path) -> dict[str, Any]:
    """Memory, answers and how long the end takes, with these blocks beside the turbines'."""
    scenario, out, endpoint = folder / "farm.toml", folder / "out", free_endpoint()
    scenario.write_text(live_farm.SCENARIO.format(turbines=TURBINES + 1), encoding="utf-8")
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--processes"]
    command += ["--no-rrd", "--scenario", str(scenario), "--listen", endpoint, "--out", str(out)]
    session = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    memory: list[dict[str, float]] = []
    done = threading.Event()
    watching = threading.Thread(target=live_farm.watch, args=(session.pid, memory, done))
    watching.start()
    try:
        live_farm.wait_for(endpoint)
        time.sleep(12.0)
        connection = ZenohSettings(mode="peer", connect=(endpoint,))
        with closing(ZenohBus(connection)) as bus, closing(ZenohBus(connection)) as bad:
            answers = Inbox()
            subscription = bus.subscribe(ANSWERS, answers)
            other = threading.Thread(target=misbehave, args=(bad, blocks()))
            other.start()
            live_farm.publish(bus, TURBINES, SECONDS, 1.0, HURRY)
            waited, rejected, of_it = wait_for_honest(answers)
            other.join()
            subscription.close()
    finally:
        done.set()
        asked = time.monotonic()
        session.send_signal(signal.SIGTERM)
        session.wait(120)
        ended = time.monotonic() - asked
        watching.join()
    totals = [sum(each.values()) for each in memory]
    largest = {
        name: max(held for each in memory for key, held in each.items() if key.startswith(name))
        for name in {key.split()[0] for each in memory for key in each}
    }
    return {
        "largest_pss_mb": round(max(totals) / 1e6),
        "largest_pss_mb_by_process": {k: round(v / 1e6) for k, v in sorted(largest.items())},
        "honest_windows_answered": sum(each <= AFTER for each in waited),
        "honest_windows_answered_later_s": [round(each) for each in waited if each > AFTER],
        "honest_windows_rejected": rejected,
        "answers_to_it": of_it,
        "ended_after_s": round(ended, 1),
    }


def misbehave(bus: ZenohBus, blocks: Blocks) -> None:
    """Send a block a second, in the turbines' pace."""
    due = time.monotonic()
    for number, block in enumerate(blocks):
        bus.publish(block)
        due += 1.0 if number % 600 >= 570 else 1.0 / HURRY
        time.sleep(max(0.0, due - time.monotonic()))


def wait_for_honest(answers: Inbox) -> tuple[list[float], list[str], list[str]]:
    """Return how long each turbine that had its answer waited for it [s], what was rejected of
    theirs, and what the other one had."""
    waited: dict[str, float] = {}
    rejected: list[str] = []
    of_it: list[str] = []
    began = time.monotonic()
    patience = began + AFTER  # for an answer to it, when the others have theirs
    while time.monotonic() < (began + PATIENT if len(waited) < TURBINES else patience):
        answer = answers.get(timeout=1.0)
        if isinstance(answer, FoundationPosterior) and answer.turbine in HONEST:
            waited.setdefault(answer.turbine, time.monotonic() - began)
        elif isinstance(answer, WindowRejected) and answer.turbine in HONEST:
            rejected.append(f"{answer.turbine}: {answer.code}, {answer.reason}")
        elif isinstance(answer, ANSWERS) and answer.turbine not in HONEST:
            of_it.append(getattr(answer, "code", type(answer).__name__))
            patience = 0.0
        if len(waited) == TURBINES:
            patience = min(patience, time.monotonic() + PATIENCE)
    return sorted(waited.values()), rejected, of_it[:3]
