"""What the pipeline survives, with real processes: `python -m tests.benchmarks trials NAME`.

link         a cable cut for 2 s, for 20 s, and for longer than the publisher's cache; silently and
             with both ends told. Blocks lost, and what the session says of it
frozen       a subscriber that is stopped for 9 s: how long the publisher's puts take, blocks lost
router       a router between both that is killed and back: blocks lost
fuzz         10 000 random, forged and damaged messages on every stream of a running session: do its
             nodes live, is its memory flat; then a coverage-guided fuzzer on the decoder, where
             atheris is installed
certificates a shore station with certificates and access control: who gets in, and whose words
kill         a session in processes; its parts, the measuring unit too, are killed one after the
             other. Blocks missing from the recording; the posteriors beside the undisturbed ones
disk         a session whose files the system lets grow to a size only: what was recorded until
             then, the posterior beside that of a session with room
farm         200 turbines, eight channels at 40 Hz, into one recorder for 5 min: losses, latency
day          24 h of blocks in recording parts and replayed as one: growth of memory, losses
truncation   a recording cut at random bytes, and with flipped bytes: chunks that come back
"""

import argparse
import importlib.util
import random
import resource
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.recording.errors import RecordingError
from pipeline.recording.reader import read_messages
from pipeline.recording.salvage import salvage
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.recording.settings import RecordingSettings
from pipeline.scenario import scenario_from_text
from pipeline.sources.recorded_stream import recorded_stream
from pipeline.sources.sources import record_simulation, simulated
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import biaxial_layout
from tests.benchmarks._disk_trial import disk_trial
from tests.benchmarks._farm_trial import farm_trial
from tests.benchmarks._fuzz_trial import fuzz_decoder, fuzz_trial
from tests.benchmarks._kill_trial import kill_trial
from tests.benchmarks._link_trials import block_of_noise, cut_trial, frozen_trial, router_trial
from tests.benchmarks._relay import Cut
from tests.benchmarks._security_trial import security_trial
from tests.benchmarks.transport import Load

SCENARIO = """
title = "A small tower for what must survive"
seed = 5

[sensors]  # two levels: what survives does not depend on how many channels there are
elevations = [80.0, 145.0]

[simulation]
duration = {duration}
transient = 60.0

[turbine]
description = "iea15mw_monopile"

[oma]
window_duration = 60.0
hop = 60.0

[updating.pairing]
search_draws = 100
refined = 2

[structure.uncertain]  # what survives does not depend on how many structures are compared
flooding = "exact"
blade_model = "exact"
tube_shear = "exact"
"""


def _blocks(paths: Sequence[Path]) -> Iterator[AccelerationBlock]:
    for path in paths:
        for message in read_messages(path, (AccelerationBlock,)):
            assert isinstance(message, AccelerationBlock)
            yield message


def recorded(folder: Path, *, duration: float) -> Path:
    """So many seconds of a small tower."""
    path = folder / "source.mcap"
    scenario = scenario_from_text(SCENARIO.format(duration=duration), "trial.toml")
    record_simulation(simulated(scenario), path)
    return path


@dataclass(frozen=True, slots=True)
class DamageOutcome:
    """What came back of damaged recordings."""

    files: int
    crashes: int  # exceptions other than RecordingError
    fewer: int  # files of which less came back than their complete chunks held
    unnoticed: int  # files read to the end as if nothing had happened


def damage_trial(
    folder: Path, recording: Path, *, cuts: int, flips: int, seed: int
) -> DamageOutcome:
    """Salvage of a recording cut at random bytes; reading and salvage with one byte flipped."""
    whole = recording.read_bytes()
    generator = random.Random(seed)
    n_blocks = sum(1 for _ in _blocks([recording]))
    crashes = fewer = unnoticed = 0
    path, target = folder / "damaged.mcap", folder / "salvaged.mcap"
    counts = []
    for _ in range(cuts):
        length = generator.randrange(8, len(whole))
        path.write_bytes(whole[:length])
        counts.append((length, _salvaged(path, target)))
    in_order = [count for _, count in sorted(counts)]
    fewer += in_order != sorted(in_order) or in_order[-1] > n_blocks
    crashes += sum(count < 0 for count in in_order)
    for _ in range(flips):
        damaged = bytearray(whole)
        damaged[generator.randrange(8, len(whole))] ^= generator.randrange(1, 256)
        path.write_bytes(damaged)
        try:
            read = [block.samples.tobytes() for block in _blocks([path])]
        except RecordingError:
            pass
        else:  # an index or the summary was hit, which readers of the data do not need
            unnoticed += read != [block.samples.tobytes() for block in _blocks([recording])]
        crashes += _salvaged(path, target) < 0
    return DamageOutcome(cuts + flips, crashes, fewer, unnoticed)


def _salvaged(path: Path, target: Path) -> int:
    """Blocks that come back; −1 for a crash."""
    target.unlink(missing_ok=True)
    try:
        salvage(path, target)
        return sum(1 for _ in _blocks([target]))
    except RecordingError:
        return 0
    except Exception:  # noqa: BLE001  # a crash is what is looked for
        return -1


@dataclass(frozen=True, slots=True)
class DayOutcome:
    """A long stream through recorder and replay."""

    blocks: int  # recorded
    lost: int  # of them that did not come back
    memory_growth: float  # of the resident memory, from a twelfth of each pass to its end [-]
    seconds: float  # CPU time [s]


def day_trial(folder: Path, *, hours: float, part: float) -> DayOutcome:
    """Blocks of eight channels at 40 Hz, recorded in parts of `part` [s], and all replayed."""
    n_blocks = round(hours * 3600)
    started = time.process_time()
    now_ns = [0]
    first = block_of_noise()
    recorder = SessionRecorder(
        folder / "session.mcap",
        metadata={},
        clock=lambda: now_ns[0],
        settings=RecordingSettings(rotate_after=part),
        free=lambda _: 10**12,
    )
    writing = Memory(n_blocks // 12)
    recorder.handle(biaxial_layout("trial-1", turbine="t1", unit="tower", elevations=(41.0, 145.0)))
    for sequence in range(n_blocks):
        now_ns[0] = first.start_ns + sequence * NANOSECONDS
        shifted = np.roll(first.samples, sequence, axis=0)
        recorder.handle(
            replace(
                first,
                sequence=sequence,
                first_sample=sequence * len(first.samples),
                start_ns=now_ns[0],
                samples=shifted,
            )
        )
        writing.note(sequence)
    recorder.close()
    reading, expected, lost = Memory(n_blocks // 12), 0, 0
    for message in recorded_stream(folder):
        if isinstance(message, AccelerationBlock):
            lost += message.sequence - expected
            expected = message.sequence + 1
            reading.note(message.sequence)
    lost += n_blocks - expected
    growth = max(writing.growth, reading.growth)
    return DayOutcome(n_blocks, lost, growth, time.process_time() - started)


class Memory:
    """Resident memory of this process after a beginning and at the end of a pass."""

    def __init__(self, settled: int) -> None:
        self._settled = settled
        self._before = self._now = 0

    def note(self, number: int) -> None:
        """Look, once in a while."""
        if number == self._settled:
            self._before = resident_bytes()
        if number % 1000 == 999:
            self._now = resident_bytes()

    @property
    def growth(self) -> float:
        """Relative [-]."""
        return self._now / self._before - 1.0 if self._before and self._now else 0.0


def resident_bytes() -> int:
    """Memory of this process that is not swapped out."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def link_trials(_folder: Path, _seed: int) -> None:
    """Cables that are cut."""
    for how, duration, rate in CUTS:
        outcome = cut_trial(duration=duration, rate=rate, how=how)
        print(f"{how} cut of {duration:g} s at {rate:g} blocks/s: {outcome}")


CUTS: tuple[tuple[Cut, float, float], ...] = (
    ("silent", 2.0, 100.0),
    ("reset", 2.0, 100.0),
    ("silent", 20.0, 50.0),
    ("reset", 20.0, 50.0),
    ("silent", 20.0, 100.0),  # more than the cache holds
    ("reset", 20.0, 100.0),
)


def frozen_trials(_folder: Path, _seed: int) -> None:
    """A reader that stands still."""
    print(frozen_trial(duration=9.0, rate=100.0))


def router_trials(_folder: Path, _seed: int) -> None:
    """A router that goes and comes back."""
    for away in (1.0, 5.0):
        print(f"router away for {away:g} s: {router_trial(away=away, rate=100.0)}")


def disk_trials(folder: Path, _seed: int) -> None:
    """A disk that is full."""
    print(disk_trial(folder, recorded(folder, duration=600.0), kilobytes=400))


def fuzz_trials(folder: Path, seed: int) -> None:
    """A flood of nonsense."""
    outcome = fuzz_trial(folder, examples=10_000, rate=1000.0, seed=seed, rounds=5)
    print(outcome)
    print(
        f"memory after the warm-up: {100 * outcome.memory_growth:+.1f} %, "
        f"{outcome.growth_of_a_thousand:+.3f} MB a thousand messages"
    )
    if importlib.util.find_spec("atheris") is not None:
        fuzz_decoder(seconds=60)


def security_trials(folder: Path, _seed: int) -> None:
    """Those who may and those who may not."""
    print(security_trial(folder))


def kill_trials(folder: Path, seed: int) -> None:
    """Parts that are killed."""
    parts = ("recorder", "identification", "source", "updating", "viewer") * 2
    recording = recorded(folder, duration=1800.0)
    print(kill_trial(folder, recording, speed=10.0, kills=parts, seed=seed))


def farm_trials(folder: Path, _seed: int) -> None:
    """A farm in real time."""
    print(farm_trial(folder, Load(turbines=200, channels=8, rate=40.0, seconds=300)))


def day_trials(folder: Path, _seed: int) -> None:
    """A day of one tower."""
    print(day_trial(folder, hours=24.0, part=3600.0))


def truncation_trials(folder: Path, seed: int) -> None:
    """Recordings that are cut and damaged."""
    print(damage_trial(folder, recorded(folder, duration=120.0), cuts=200, flips=200, seed=seed))


TRIALS: dict[str, Callable[[Path, int], None]] = {
    "link": link_trials,
    "frozen": frozen_trials,
    "router": router_trials,
    "kill": kill_trials,
    "disk": disk_trials,
    "fuzz": fuzz_trials,
    "certificates": security_trials,
    "truncation": truncation_trials,
    "farm": farm_trials,
    "day": day_trials,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one trial and print what it shows."""
    parser = argparse.ArgumentParser(prog="trials", description=__doc__)
    parser.add_argument("name", choices=TRIALS)
    parser.add_argument("--seed", type=int, default=2026)
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as temporary:
        TRIALS[chosen.name](Path(temporary), chosen.seed)
    print(f"peak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB")
