"""Seeded histories of one turbine: kills, reboots, clock steps, cuts, strays; then the audit.

    seed → units' boots, clocks and links → blocks as they arrive
         → identification and updating, killed and started again → what is recorded → books

Time is the blocks': nothing sleeps. A history that fails is run again with single disturbances left
out, until none can be; its seed and what is left of it are printed.

    python -m tests.pipeline.histories --seeds 1000 --from 5000 --write
"""

import argparse
import json
import logging
import sys
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from pipeline.messages import (
    FoundationPosterior,
    Message,
    ModalEstimate,
    Mode,
    StabilisationDiagram,
    WindowRejected,
)
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.node import NodeSnapshot, NodeStatistics
from pipeline.nodes.updating import AnsweredWindows, UpdatingNode
from pipeline.oma import window_identification
from pipeline.oma.identification import Identification
from pipeline.oma.settings import OmaSettings
from pipeline.runtime.snapshots import SnapshotFolder
from pipeline.state.books import Books
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._results import is_old, keep, kept
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, START
from tests.pipeline.oma.conftest import structure
from tests.pipeline.state.test_posterior_json import POSTERIOR

SETTINGS = OmaSettings(window_duration=60.0, hop=60.0)
LENGTH = 540  # of a history [s]
YEAR = 31_557_600  # [s]


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Something that happens at a second of the history."""

    kind: str
    at: int
    """[s] since the beginning."""
    size: int = 0
    """Of a step or a pause [s], of a cut [blocks]."""


@dataclass(slots=True)
class Outcome:
    """What is on disk in the end."""

    recorded: list[Message] = field(default_factory=list)
    fates: dict[tuple[object, ...], str] = field(default_factory=dict)
    """Windows by their origins: "" identified, else the code."""
    frequencies: dict[tuple[object, ...], float] = field(default_factory=dict)
    """Of identified windows: a digest of their samples."""
    posterior: int = 0
    """Windows in the posterior."""
    silent: list[str] = field(default_factory=list)
    """Windows without a disturbance that have no estimate."""

    @property
    def violations(self) -> list[str]:
        """Of the books, and of the windows."""
        books = Books()
        for message in self.recorded:
            books.handle(message)
        return [*books.violations(), *self.silent]


def disturbances(seed: int) -> tuple[Disturbance, ...]:
    """What happens in the history of a seed."""
    rng = np.random.default_rng(seed)

    def moment() -> int:
        return int(rng.integers(5, LENGTH - 5))

    steps = [1, -1, 30, -30, 1800, -1800, 7200, -7200, YEAR, -YEAR, 12 * YEAR, -20 * YEAR]
    found = [Disturbance("kill", moment()) for _ in range(rng.integers(0, 4))]
    found += [Disturbance("kill updating", moment()) for _ in range(rng.integers(0, 2))]
    found += [
        Disturbance("step", moment(), int(rng.choice(steps))) for _ in range(rng.integers(0, 3))
    ]
    found += [
        Disturbance("cut", moment(), int(rng.integers(1, 90))) for _ in range(rng.integers(0, 2))
    ]
    found += [
        Disturbance(
            str(rng.choice(["reboot", "reboot same name"])), moment(), int(rng.integers(1, 200))
        )
        for _ in range(rng.integers(0, 2))
    ]
    found += [Disturbance("stray", moment()) for _ in range(rng.integers(0, 4))]
    found += [Disturbance("repeat", moment()) for _ in range(rng.integers(0, 3))]
    found += [Disturbance("swap", moment()) for _ in range(rng.integers(0, 3))]
    if rng.random() < 0.3:
        found.append(Disturbance("drift", 0, int(rng.integers(100, 2500))))
    return tuple(sorted(found, key=lambda each: each.at))


@cache
def samples() -> np.ndarray:
    """Two channels of a structure with two modes, one row a second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    whole = known.ambient_response(sampling_rate=RATE, duration=float(LENGTH), seed=2)
    return whole.astype(np.float32).reshape(LENGTH, round(RATE), 2)


def arrivals(history: tuple[Disturbance, ...]) -> Iterator[tuple[int, AccelerationBlock]]:
    """Second of the history → blocks that arrive, in their order."""
    session, boots, sequence, clock = "s", 0, 0, 0.0
    drift = sum(each.size for each in history if each.kind == "drift") * 1e-6
    cut_until = -1
    waiting: AccelerationBlock | None = None
    for second in range(LENGTH):
        now = [each for each in history if each.at == second]
        for each in now:
            if each.kind == "step":
                clock += each.size
            elif each.kind.startswith("reboot"):
                boots, sequence, clock = boots + 1, 0, clock + each.size
                session = session if each.kind == "reboot same name" else f"s{boots}"
            elif each.kind == "cut":
                cut_until = min(second + each.size, LENGTH - 10)  # and what is missing is reported
        stamp = START + round((second * (1 + drift) + clock) * NANOSECONDS)
        block = AccelerationBlock(
            "t1", "tower", session, "layout-1", sequence, sequence * round(RATE),
            max(stamp, 0), RATE, samples()[second],
        )  # fmt: skip
        sequence += 1
        if second < cut_until:
            continue
        if any(each.kind == "stray" for each in now):
            yield second, replace(block, session="another run", sequence=7, first_sample=140)
        swaps = any(each.kind == "swap" for each in now) and waiting is None
        if swaps:
            waiting = block
            continue
        yield second, block
        if waiting is not None:
            yield second, waiting
            waiting = None
        if any(each.kind == "repeat" for each in now):
            yield second, block


def digest(samples: np.ndarray, *_: object, **__: object) -> Identification:
    """Stands in for `identify`: one mode, whose frequency is a digest of the window's samples, so
    that windows agree where their samples do."""
    frequency = 1.0 + zlib.crc32(np.ascontiguousarray(samples).tobytes()) / 2**32
    n_channels = samples.shape[1]
    mode = Mode(
        "", frequency, 1e-3, 0.01, 1e-3, np.ones(n_channels), np.zeros((2 + n_channels, 1)), 1
    )
    return Identification((mode,), (), None)


def identify_by_digests(replaced: Callable[[object, str, object], object]) -> None:
    """Let every window's identification be its digest. replaced: as `monkeypatch.setattr`."""
    replaced(window_identification, "identify", digest)


class CountingUpdating:
    """An updating that answers every window once, and says how many it has."""

    statistics = NodeStatistics()

    def __init__(self) -> None:
        self.revision = 0
        self.windows = 0
        self._answered = AnsweredWindows()
        self._answers: tuple[FoundationPosterior, ...] = ()

    def handle(self, message: Message) -> tuple[Message, ...]:
        if not isinstance(message, ModalEstimate):
            return ()
        if message in self._answered:
            return tuple(each for each in self._answers if each.origins == message.origins)
        self.windows += 1
        self._answered.add(message)
        answer = replace(
            POSTERIOR, turbine="t1", n_windows=self.windows, origins=message.origins,
            window=message.window, time_ns=message.end_ns,
        )  # fmt: skip
        self._answers = (*self._answers, answer)[-10:]
        self.revision += 1
        return (answer,)

    def finish(self) -> Iterator[Message]:
        return iter(())

    def snapshot(self) -> NodeSnapshot:
        state = {"windows": self.windows, "answered": self._answered.state()}
        return NodeSnapshot(json.dumps(state).encode(), self._answers)

    def restore(self, snapshot: NodeSnapshot, past: list[Message]) -> Iterator[Message]:
        state = json.loads(snapshot.state)
        self.windows = state["windows"]
        self._answered.resume(state["answered"])
        self._answers = tuple(e for e in snapshot.messages if isinstance(e, FoundationPosterior))
        unanswered = [e for e in past if isinstance(e, ModalEstimate) and e not in self._answered]
        return (answer for each in unanswered for answer in self.handle(each))


def lived(history: tuple[Disturbance, ...], folder: Path) -> Outcome:
    """Run a history and give what it leaves."""
    outcome, known = Outcome(), set()
    kills = {each.at for each in history if each.kind == "kill"}
    updating_kills = {each.at for each in history if each.kind == "kill updating"} | kills

    def record(message: Message) -> None:
        payload = encode(message)
        if payload not in known:
            known.add(payload)
            outcome.recorded.append(message)

    def identification(past: list[Message]) -> IdentificationNode:
        return IdentificationNode(
            SETTINGS, store=SnapshotFolder(folder / "tracks", "identification"), past=past
        )

    def updating(past: list[Message]) -> UpdatingNode:
        made = UpdatingNode(lambda _: CountingUpdating(), store=SnapshotFolder(folder), past=past)  # type: ignore[arg-type, return-value]
        return made

    first, second_node = identification([]), updating([])
    record(LAYOUT)
    for answer in first.handle(LAYOUT):
        record(answer)
    last = 0
    for second, block in arrivals(history):
        for killed in sorted(kill for kill in updating_kills if last < kill <= second):
            if killed in kills:
                first = identification(list(outcome.recorded))
            second_node = updating([m for m in outcome.recorded if isinstance(m, ModalEstimate)])
        last = max(last, second)
        record(block)
        for answer in first.handle(block):
            if isinstance(answer, StabilisationDiagram):
                continue
            record(answer)
            for reply in second_node.handle(answer) if isinstance(answer, ModalEstimate) else ():
                record(reply)
    _judge(outcome, history)
    answers = [m for m in outcome.recorded if isinstance(m, FoundationPosterior)]
    outcome.posterior = max((m.n_windows for m in answers), default=0)
    return outcome


def _judge(outcome: Outcome, history: tuple[Disturbance, ...]) -> None:
    """Fates of the windows; those that are whole and have no estimate are silent."""
    for message in outcome.recorded:
        if isinstance(message, ModalEstimate | WindowRejected):
            known = outcome.fates.get(message.origins)
            identified = isinstance(message, ModalEstimate)
            fate = "" if identified else message.code
            if identified:
                outcome.frequencies[message.origins] = message.modes[0].frequency
            outcome.fates[message.origins] = fate if known is None else known
    drift = max((abs(each.size) for each in history if each.kind == "drift"), default=0) * 1e-6
    for boot, first, clean in whole_windows(history):
        # each window before it was longer or shorter by the drift, and rounded to a sample
        n_before = first // round(SETTINGS.hop * RATE)
        moved = (first * drift + n_before) * (drift > 0)
        fates = [
            fate
            for origins, fate in outcome.fates.items()
            if _boot_of(origins[0], history) == boot
            and abs(origins[0].first_sample - first) <= moved
        ]
        if not fates:
            outcome.silent.append(f"boot {boot}, window from sample {first}: no answer")
        elif clean and fates != [""]:
            outcome.silent.append(f"boot {boot}, window from sample {first}: {fates}")


def _boot_of(origin: object, history: tuple[Disturbance, ...]) -> tuple[str, int]:
    return origin.session, origin.boot  # type: ignore[attr-defined]


def whole_windows(
    history: tuple[Disturbance, ...],
) -> Iterator[tuple[tuple[str, int], int, bool]]:
    """Windows that a later block of the same boot has completed: whether nothing disturbed them."""
    session, number, began, boots = "s", 0, 0, 0
    seconds: dict[tuple[str, int], tuple[int, int]] = {}
    reboots = [each for each in history if each.kind.startswith("reboot")]
    ends = [each.at for each in reboots] + [LENGTH]
    for each, end in zip([None, *reboots], ends, strict=True):
        if each is not None:
            boots += 1
            began = each.at
            number = number + 1 if each.kind == "reboot same name" else 0
            session = session if each.kind == "reboot same name" else f"s{boots}"
        seconds[session, number] = (began, end)
    steps = [each.at for each in history if each.kind == "step"]
    cuts = [(each.at, each.at + each.size) for each in history if each.kind == "cut"]
    swaps = [each.at for each in history if each.kind == "swap"]
    width = round(SETTINGS.window_duration)
    drift = max((abs(each.size) for each in history if each.kind == "drift"), default=0) * 1e-6
    before = -1  # number of the last block that was heard of the boot before
    for boot, (first, end) in seconds.items():
        heard = [s for s in range(first, end) if not any(a <= s < b for a, b in cuts)]
        if len(heard) < 12:
            continue  # too few blocks to be taken for a boot
        if boot[1] and heard[0] - first > before:
            continue  # its numbers go on behind those before: a clock that was set looks the same
        last = heard[-1]
        before = last - first
        for window, begin in enumerate(range(first, end, width)):
            done = begin + width
            if done > last - 6:
                break
            clean = not any(a < done and b > begin for a, b in cuts)
            # of a unit whose clock is fast, a window begins before its nominal instant
            early = (done - first) * drift
            clean = clean and not any(begin - early < step < done for step in steps)
            clean = clean and not any(begin - 2 <= swap < done + 2 for swap in swaps)
            yield boot, window * width * round(RATE), clean


def outcome_of(
    seed: int, history: tuple[Disturbance, ...] | None = None
) -> tuple[Outcome, Outcome]:
    """A seed's history, and the same without kills."""
    chosen = disturbances(seed) if history is None else history
    calm = tuple(each for each in chosen if not each.kind.startswith("kill"))
    with (
        patch.object(window_identification, "identify", digest),
        TemporaryDirectory() as folder,
        TemporaryDirectory() as other,
    ):
        return lived(chosen, Path(folder)), lived(calm, Path(other))


def complaints(seed: int, history: tuple[Disturbance, ...] | None = None) -> list[str]:
    """What is wrong with a history; nothing where the books balance and kills change nothing."""
    killed, calm = outcome_of(seed, history)
    found = killed.violations
    if killed.fates != calm.fates:
        different = killed.fates.items() ^ calm.fates.items()
        found.append(f"kills changed {sorted(str(each) for each in different)}")
    if killed.frequencies != calm.frequencies:
        found.append("kills changed the samples of a window")
    if killed.posterior != calm.posterior:
        found.append(f"{killed.posterior} windows in the posterior, without kills {calm.posterior}")
    return found


def shrunk(seed: int) -> tuple[Disturbance, ...]:
    """The history of a seed that fails, without what does not matter."""
    history = disturbances(seed)
    for each in list(history):
        fewer = tuple(other for other in history if other is not each)
        if complaints(seed, fewer):
            history = fewer
    return history


def main() -> None:
    """Run histories of fresh seeds and print those that fail."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--from", dest="first", type=int, default=1000)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args()
    logging.disable(logging.WARNING)
    started, failed = time.process_time(), {}
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        found = complaints(seed)
        if found:
            failed[seed] = found
            sys.stdout.write(f"{seed}: {found}; what is needed for it: {shrunk(seed)}\n")
    spent = time.process_time() - started
    sys.stdout.write(f"{chosen.seeds} histories, {len(failed)} fail, {spent:.0f} s\n")
    if chosen.write:
        first, figures = chosen.first, {"histories": chosen.seeds, "violations": len(failed)}
        figures["cpu_s"] = round(spent, 1)
        before = kept("histories")
        if before and before["seeds"][1] == first - 1 and not is_old(before):  # piece by piece
            first = before["seeds"][0]
            figures = {name: round(figures[name] + before["figures"][name], 1) for name in figures}
        last = chosen.first + chosen.seeds - 1
        keep(
            "histories",
            figures,
            command=f"python -m tests.pipeline.histories --seeds {last - first + 1} "
            f"--from {first} --write",
            seeds=(first, last),
            depends=["pipeline/nodes", "pipeline/oma/windows", "pipeline/state"],
        )


if __name__ == "__main__":
    main()
