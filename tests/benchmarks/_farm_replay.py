"""A recorded farm replayed at ten times real time through a whole session, in processes.

recording of 20 turbines ══► identification ×2 ══► updating ×2 ══► recorder     one process each

The lag of a window is from its last block's arrival at the recorder to its posterior's.
"""

import resource
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.messages import FoundationPosterior, WindowRejected
from pipeline.recording.reader import decoded, recorded_messages
from pipeline.recording.rotation import parts_of
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.scenario import scenario_from_text
from pipeline.sources.sources import record_simulation, replayed, simulated
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.arrays import FloatArray

WINDOW = 600.0  # [s]
OUTLIER = 7  # number of the turbine with 15 % less k22
SCENARIO = """
title = "A farm of one design: ln k spreads by 2 %, turbine {outlier} has 15 % less k22"
seed = {seed}

[turbine]
springs_sign = "{sign}"

[simulation]
duration = {duration}
noise_share = 0.03

[farm]
turbines = {turbines}
log_std = 0.02

[[farm.members]]
number = {outlier}
stiffness = [1.0, 0.85, 1.0]
"""


@dataclass(frozen=True, slots=True)
class ReplayCase:
    """What is replayed, and how fast."""

    turbines: int = 20
    windows: int = 3
    seed: int = 1
    speed: float = 10.0
    shards: int = 2
    sign: str = "published"


def recording_of(case: ReplayCase, folder: Path) -> Path:
    """The recording, simulated unless it was put in the folder before."""
    path = folder / f"farm-{case.sign}-{case.turbines}-{case.windows}-{case.seed}.mcap"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        text = SCENARIO.format(
            seed=case.seed,
            duration=WINDOW * case.windows,
            turbines=case.turbines,
            sign=case.sign,
            outlier=min(OUTLIER, case.turbines),
        )
        record_simulation(simulated(scenario_from_text(text, "farm.toml")), path)
    return path


@dataclass(frozen=True, slots=True, eq=False)
class ReplayOutcome:
    """What a session made of the replay."""

    posteriors: tuple[FoundationPosterior, ...]  # in the order of their coming
    lags: FloatArray  # of each [s]
    rejected: tuple[str, ...]
    busy: dict[str, float]  # node → time spent in its messages [s]
    cpu: float  # of all processes, the source's too [s]
    wall: float  # [s]
    lost: int  # blocks


def replay(case: ReplayCase, recording: Path, out: Path) -> ReplayOutcome:
    """Run the session and read what it recorded."""
    began, before = time.monotonic(), _cpu()
    options = SessionOptions(
        out=out, speed=case.speed, way="processes", rrd=False, shards=case.shards
    )
    session = run_session(replayed(recording), options)
    wall, cpu = time.monotonic() - began, _cpu() - before
    came: dict[tuple[str, int], int] = {}  # turbine, beginning of a block → its coming [ns]
    posteriors, lags, rejected = [], [], []
    for part in parts_of(out / "session.mcap"):
        for each in recorded_messages(part):
            if each.message_type is AccelerationBlock:
                came[each.key.split("/")[1], each.publish_time] = each.log_time
            elif each.message_type is WindowRejected:
                rejected.append(decoded(part, each))
            elif each.message_type is FoundationPosterior:
                posterior = decoded(part, each)
                assert isinstance(posterior, FoundationPosterior)
                last_block = came[posterior.turbine, posterior.time_ns - NANOSECONDS]
                lags.append((each.log_time - last_block) / NANOSECONDS)
                posteriors.append(posterior)
    return ReplayOutcome(
        posteriors=tuple(posteriors),
        lags=np.array(lags),
        rejected=tuple(
            f"{e.turbine}: {e.reason}" for e in rejected if isinstance(e, WindowRejected)
        ),
        busy={name: status.busy_s for name, status in session.summary.main.statuses.items()},
        cpu=cpu,
        wall=wall,
        lost=session.figures["stream"]["lost"],
    )


def _cpu() -> float:
    """Of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def print_replay(case: ReplayCase, recording: Path) -> None:
    """The table: in time or not, and where the time goes."""
    with tempfile.TemporaryDirectory() as out:
        found = replay(case, recording, Path(out))
    expected, period = case.turbines * case.windows, WINDOW / case.speed
    merge_by_time = int((found.lags < period).sum())
    p50, p99 = np.percentile(found.lags, [50, 99])
    per_window = found.cpu / expected
    print(
        f"{case.turbines} turbines, {case.windows} windows each, at {case.speed:g} × real time, "
        f"{2 * case.shards} working processes, seed {case.seed}"
    )
    print(
        f"posteriors {len(found.posteriors)} of {expected}, in time (within {period:g} s) "
        f"{merge_by_time}; rejected windows {len(found.rejected)}; blocks lost {found.lost}"
    )
    print(f"lag p50 {p50:.1f} s, p99 {p99:.1f} s, longest {found.lags.max():.1f} s")
    print(
        f"CPU a window {per_window:.2f} s, everything counted, the processes' start too: "
        f"{WINDOW / per_window:.0f} turbines a core at real time; {found.cpu / found.wall:.2f} "
        f"cores used over {found.wall:.0f} s"
    )
    for name, busy in sorted(found.busy.items()):
        print(f"  {name}: busy {busy / expected:.3f} s a window")
    for reason in found.rejected:
        print(f"  {reason}")
