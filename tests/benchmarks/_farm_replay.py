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
from numpy.typing import NDArray

from pipeline.fleet.farm import Farm, pooled_farm
from pipeline.fleet.farm_pooling import FarmError
from pipeline.messages import FoundationPosterior, FoundationTruth, WindowRejected
from pipeline.recording.parts import parts_of
from pipeline.recording.reader import decoded, read_messages, recorded_messages
from pipeline.scenario import scenario_from_text
from pipeline.session import SessionOptions, run_session
from pipeline.sources import record_simulation, replayed, simulated
from sensors.blocks import NANOSECONDS, AccelerationBlock

FloatArray = NDArray[np.float64]
WINDOW = 600.0  # [s]
OUTLIER = 7  # number of the turbine with 15 % less k22
SCENARIO = """
title = "A farm of one design: ln k spreads by 2 %, turbine {outlier} has 15 % less k22"
seed = {seed}

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


def recording_of(case: ReplayCase, folder: Path) -> Path:
    """The recording, simulated unless it was put in the folder before."""
    path = folder / f"farm-{case.turbines}-{case.windows}-{case.seed}.mcap"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        text = SCENARIO.format(
            seed=case.seed,
            duration=WINDOW * case.windows,
            turbines=case.turbines,
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
    truths: dict[str, FloatArray]  # turbine → (3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]

    def after(self, windows: int) -> list[FoundationPosterior]:
        """The posterior of each turbine after so many windows."""
        return [each for each in self.posteriors if each.n_windows == windows]


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
        busy={name: status.busy_s for name, status in session.summary.statuses.items()},
        cpu=cpu,
        wall=wall,
        lost=session.figures["stream"]["lost"],
        truths=_truths(recording),
    )


def _cpu() -> float:
    """Of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


def _truths(recording: Path) -> dict[str, FloatArray]:
    found = {}
    for truth in read_messages(recording, (FoundationTruth,)):
        assert isinstance(truth, FoundationTruth)
        found[truth.turbine] = np.array([truth.k11, truth.k22, truth.k12])
    return found


def print_replay(case: ReplayCase, folder: Path) -> None:
    """The table: in time or not, where the time goes, and what pooling gains."""
    recording = recording_of(case, folder)
    with tempfile.TemporaryDirectory() as out:
        found = replay(case, recording, Path(out))
    expected, period = case.turbines * case.windows, WINDOW / case.speed
    in_time = int((found.lags < period).sum())
    p50, p99 = np.percentile(found.lags, [50, 99])
    per_window = found.cpu / expected
    print(
        f"{case.turbines} turbines, {case.windows} windows each, at {case.speed:g} × real time, "
        f"{2 * case.shards} working processes, seed {case.seed}"
    )
    print(
        f"posteriors {len(found.posteriors)} of {expected}, in time (within {period:g} s) "
        f"{in_time}; rejected windows {len(found.rejected)}; blocks lost {found.lost}"
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
    _print_farm(found, case)


def _print_farm(found: ReplayOutcome, case: ReplayCase) -> None:
    """Pooled: every turbine's first window, then everything."""
    for windows in sorted({1, case.windows}):
        try:
            farm = pooled_farm(found.after(windows))
        except FarmError as error:
            print(error)
            continue
        truths = np.array([found.truths[each.turbine] for each in farm.turbines])
        own, pooled = (_errors(farm, truths, own=which) for which in (True, False))
        alone, helped = np.median(own, axis=0), np.median(pooled, axis=0)
        overall = 1 - np.median(pooled) / np.median(own)
        outlying = [each.text for each in farm.turbines if each.outlying]
        print(
            f"after {windows} windows: median error % alone {_three(100 * alone)}, pooled "
            f"{_three(100 * helped)}; falls by {_three(100 * (1 - helped / alone), 0)} %, all "
            f"springs together {100 * overall:.0f} %"
        )
        print(f"  outliers: {'; '.join(outlying) or 'none'}")


def _errors(farm: Farm, truths: FloatArray, *, own: bool) -> FloatArray:
    """(n_turbines, 3) |median / truth − 1|."""
    medians = [[k.median for k in (each.own if own else each.pooled)] for each in farm.turbines]
    return np.abs(np.array(medians) / truths - 1)


def _three(values: FloatArray, digits: int = 2) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
