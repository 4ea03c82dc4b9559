"""A run that is asked to end does so within ten seconds of wall time, whatever a unit sends."""

import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.recording.rotation import close_leftovers, parts_of
from pipeline.recording.session_recorder import blocks_in
from pipeline.transport.zenoh_bus import ZenohBus, peer_of
from pipeline.transport.zenoh_settings import free_endpoint
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from tests.benchmarks._fuzz_trial import wait_for_nodes
from tests.pipeline.example_messages import LAYOUT, block

WITHIN = 10.0  # [s]
FLOODED = 12.0  # before the signal [s]
WIDE = biaxial_layout(
    "wide", turbine="flood", unit="tower", elevations=tuple(10.0 + n for n in range(45))
)


@contextmanager
def flood(endpoint: str, *, long: bool) -> Iterator[None]:
    """Blocks of 90 channels as fast as they go: of one second, or of 5 MB, and some beyond."""
    stopping = threading.Event()

    def send() -> None:
        rng = np.random.default_rng(1)
        n_samples = 12_000 if long else 40
        samples = rng.normal(size=(n_samples, len(WIDE.channels))).astype(np.float32)
        with closing(ZenohBus(peer_of(endpoint))) as bus:
            for layout in (WIDE, LAYOUT):
                assert isinstance(layout, SensorLayout)
                bus.publish(layout)
            for number in range(10**6):
                if stopping.is_set():
                    return
                sent = replace(
                    block(number, turbine="flood"),
                    layout_id="wide",
                    first_sample=number * n_samples,
                    start_ns=block(0).start_ns + round(number * n_samples / 40.0 * 1e9),
                    samples=samples + np.float32(1e-3 * number),
                )
                bus.publish(sent)
                bus.publish(block(number))

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        stopping.set()
        sender.join()


def close_and_count(folder: Path) -> int:
    """Blocks in the recording, a part that was cut closed as the next run closes it."""
    first = folder / "session.mcap"
    list(close_leftovers(first))
    return sum(blocks_in(part) for part in parts_of(first))


@pytest.mark.nightly  # it measures wall time, which a loaded machine lengthens
@pytest.mark.parametrize("way", [[], ["--processes"]])
@pytest.mark.parametrize("long", [False, True])
def test_a_run_ends_within_ten_seconds_while_a_unit_floods_it(
    tmp_path: Path, way: list[str], long: bool
) -> None:
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--no-rrd", *way]
    command += ["--scenario", "parked", "--listen", endpoint, "--out", str(tmp_path)]
    session = subprocess.Popen(command, stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    try:
        wait_for_nodes(endpoint)
        with flood(endpoint, long=long):
            time.sleep(FLOODED)
            session.send_signal(signal.SIGTERM)
            asked = time.monotonic()
            exit_code = session.wait(60.0)
            taken = time.monotonic() - asked
    finally:
        session.kill()
        session.wait()
    assert taken <= WITHIN
    assert (tmp_path / "summary.json").exists()
    assert close_and_count(tmp_path) > 0
    assert exit_code == 0
