"""Seeded histories of a tower with two units, each with a clock of its own, and of restarts.

    seed → steps of one clock or both, each 1 s to 20 years → blocks → windows → books
         → the same with units that start again and with cuts of one unit   → books

Where both units send all their samples, every window without a step has an estimate, of both units
or of one. Restarts of the identification change none.

    python -m tests.pipeline.unit_histories --seeds 100 --from 5000
"""

import argparse
import logging
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from pipeline.messages import Message, ModalEstimate, StabilisationDiagram
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma import window_identification
from pipeline.oma.settings import OmaSettings
from pipeline.runtime.snapshots import SnapshotFolder
from pipeline.runtime.source_feed import with_end
from pipeline.state.books import Books
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.simulation.acquisition_units import read_by_units, unit_layouts
from tests.pipeline.histories import YEAR, digest
from tests.pipeline.nodes.test_identification import RATE, START
from tests.pipeline.nodes.test_wrong_clocks import FIVE, UNITS

WINDOW = 60.0  # [s]
LOST_AT_A_STEP = 2 * WINDOW + 30.0  # the window it lies in, the next one, and some blocks [s]


@dataclass(frozen=True, slots=True)
class UnitHistory:
    """What happens to the clocks, and when the identification ends and starts again."""

    block_length: int
    """[samples]"""
    hop: float
    """[s]"""
    n_blocks: int
    """Of each unit."""
    steps: tuple[tuple[int, float, str], ...]
    """Block, size [s], unit or "both"."""
    restarts: frozenset[int]
    """Messages before which it starts again."""
    boots: tuple[tuple[int, str], ...] = ()
    """Block at which a unit starts again under its name, and unit."""
    cuts: tuple[tuple[int, int, str], ...] = ()
    """First block and one past the last that do not come, and unit."""

    @classmethod
    def of(cls, seed: int) -> "UnitHistory":
        """Draw what happens in the history of a seed."""
        rng = np.random.default_rng(seed)
        length, hop = int(rng.choice([10, 20, 40])), float(rng.choice([60.0, 30.0]))
        n_blocks = int(rng.integers(200, 300) * RATE // length)
        steps: list[tuple[int, float, str]] = []
        for _ in range(rng.integers(1, 3)):
            size = float(np.exp(rng.uniform(0.0, np.log(20 * YEAR))) * rng.choice([-1, 1]))
            at, unit = int(rng.integers(0, n_blocks)), str(rng.choice(["lower", "upper", "both"]))
            steps.append((at, size, unit))
            if unit != "both" and rng.random() < 0.5:  # and it is put right again
                later = min(n_blocks - 1, at + int(rng.integers(5, n_blocks // 2)))
                steps.append((later, -size, unit))
        restarts = rng.integers(4, 2 * n_blocks, size=rng.integers(0, 3))
        return cls(length, hop, n_blocks, tuple(sorted(steps)), frozenset(map(int, restarts)))

    def disturbed(self, seed: int) -> "UnitHistory":
        """Draw units' starts and cuts beside the steps; or instead of them."""
        rng = np.random.default_rng([seed, 1])

        def drawn() -> list[tuple[int, str]]:
            units = rng.choice(["lower", "upper"], size=rng.integers(0, 3))
            return [(int(rng.integers(10, self.n_blocks - 95)), str(unit)) for unit in units]

        cuts = [(at, at + int(rng.integers(1, 90)), unit) for at, unit in drawn()]
        steps = self.steps if rng.random() < 0.5 else ()
        return replace(self, steps=steps, boots=tuple(sorted(drawn())), cuts=tuple(cuts))

    def messages(self) -> Iterator[Message]:
        """Layouts and blocks as they arrive."""
        samples = np.random.default_rng(0).standard_normal((self.n_blocks, self.block_length, 2))
        whole = [
            AccelerationBlock(
                "t", "tower", "s", FIVE.layout_id, number, number * self.block_length,
                START + round(number * self.block_length / RATE * NANOSECONDS), RATE,
                samples[number].astype(np.float32),
            )
            for number in range(self.n_blocks)
        ]  # fmt: skip
        yield from unit_layouts(FIVE, UNITS)
        for block in read_by_units(whole, FIVE, UNITS):
            off = sum(
                size
                for at, size, of in self.steps
                if block.sequence >= at and of in (block.unit, "both")
            )
            if any(
                begin <= block.sequence < end for begin, end, of in self.cuts if of == block.unit
            ):
                continue
            begun = max(
                (at for at, of in self.boots if at <= block.sequence and of == block.unit),
                default=0,
            )
            yield replace(
                block,
                start_ns=max(0, block.start_ns + round(off * NANOSECONDS)),
                sequence=block.sequence - begun,
                first_sample=block.first_sample - begun * self.block_length,
            )

    @property
    def stretches(self) -> Iterator[tuple[float, float]]:
        """Times between steps [s]."""
        seconds = self.block_length / RATE
        edges = sorted({0, self.n_blocks, *(at for at, _, _ in self.steps)})
        for begin, end in pairwise(edges):
            yield begin * seconds, end * seconds


def lived(history: UnitHistory, folder: Path) -> list[Message]:
    """Everything that is recorded of a history."""
    settings = OmaSettings(window_duration=WINDOW, hop=history.hop)
    recorded: list[Message] = []

    def started() -> IdentificationNode:
        store = SnapshotFolder(folder, "identification")
        return IdentificationNode(settings, store=store, past=list(recorded))

    node = started()
    for number, message in enumerate(with_end(history.messages())):
        if number in history.restarts:
            node = started()
        recorded.append(message)
        recorded += (e for e in node.handle(message) if not isinstance(e, StabilisationDiagram))
    return recorded


def estimated(recorded: list[Message]) -> dict[object, str]:
    """Windows that are identified, by what they are known by, and their modes."""
    return {
        each.origins: repr([mode.frequency for mode in each.modes])
        for each in recorded
        if isinstance(each, ModalEstimate)
    }


def violations(seed: int, *, disturbed: bool = False) -> list[str]:
    """What is wrong with a history; nothing where no window is lost and a restart changes none."""
    history = UnitHistory.of(seed)
    history = history.disturbed(seed) if disturbed else history
    with (
        patch.object(window_identification, "identify", digest),
        TemporaryDirectory() as folder,
        TemporaryDirectory() as other,
    ):
        recorded = lived(history, Path(folder))
        calm = lived(replace(history, restarts=frozenset()), Path(other))
    books = Books()
    for message in recorded:
        books.handle(message)
    found = [*books.violations(), *([] if disturbed else _lost(history, recorded))]
    # a restart within a window does not read what a unit sent before it started again itself
    if not history.boots and estimated(recorded) != estimated(calm):
        found.append(f"restarts change {estimated(recorded).items() ^ estimated(calm).items()}")
    return found


def _lost(history: UnitHistory, recorded: list[Message]) -> Iterator[str]:
    """Where more is lost than the windows that a step lies in, by the units' own counts."""
    estimates = [each for each in recorded if isinstance(each, ModalEstimate)]
    spans = sorted(o.first_sample / RATE for each in estimates for o in each.origins)
    for begin, end in history.stretches:
        covered, reached = 0.0, begin
        for start in spans:
            until = min(end, start + WINDOW)
            covered += max(0.0, until - max(start, reached))
            reached = max(reached, until)
        if end - begin - covered > LOST_AT_A_STEP:
            yield f"{end - begin - covered:.0f} of {end - begin:.0f} s after {begin:.0f} s are lost"


def main() -> None:
    """Run histories of fresh seeds and print those that fail."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--from", dest="first", type=int, default=1000)
    chosen = parser.parse_args()
    logging.disable(logging.WARNING)
    failed = 0
    for seed in range(chosen.first, chosen.first + chosen.seeds):
        for disturbed in (False, True):
            found = violations(seed, disturbed=disturbed)
            failed += bool(found)
            if found:
                history = UnitHistory.of(seed)
                history = history.disturbed(seed) if disturbed else history
                sys.stdout.write(f"{seed}: {history} {found}\n")
    sys.stdout.write(f"{2 * chosen.seeds} histories of two units, {failed} fail\n")


if __name__ == "__main__":
    main()
