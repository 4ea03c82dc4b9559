"""What a task of an archive reads before its first sample."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.archive.identification import (
    IdentificationCall,
    _wanted,
    identified,
    task_messages,
)
from pipeline.archive.plan import IdentificationTask, Piece
from pipeline.messages import FoundationTruth, Message, ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from tests.pipeline.example_messages import LAYOUT, START_NS, block
from tests.pipeline.report.example_session import recorded
from tests.pipeline.updating.small_tower import LinearTower, drawn_estimate

MINUTE = 60 * NANOSECONDS  # [ns]

WINDOW: ModalEstimate = drawn_estimate(
    np.ones(3), np.random.default_rng(5), window=0, tower=LinearTower()
)


def reported(minute: int) -> ScadaSample:
    return ScadaSample("t1", START_NS + minute * MINUTE, "parked", 8.0, 0.0, 90.0, 0.0, 0.0, 0.5)


def task_of(path: Path, start_ns: int, *, seconds: int) -> IdentificationTask:
    """Of all blocks of a file."""
    return IdentificationTask(
        path=path,
        fingerprints=(),
        turbine="t1",
        layout_ids=(LAYOUT.layout_id,),
        pieces=(),
        start_ns=start_ns,
        end_ns=start_ns + seconds * NANOSECONDS,
        n_windows=0,
    )


def test_the_state_that_was_reported_in_the_ten_minutes_before_is_read_from_the_file_before(
    tmp_path: Path,
) -> None:
    """Controllers report a state that holds every few minutes only."""
    start_ns = START_NS + 60 * MINUTE
    before = recorded(tmp_path / "before.mcap", [reported(45), reported(55), reported(65)])
    first = replace(block(0), start_ns=start_ns)
    path = recorded(tmp_path / "own.mcap", [LAYOUT, first])
    task = replace(task_of(path, start_ns, seconds=1), before=before)
    read = [each for each in task_messages(task) if isinstance(each, ScadaSample)]
    assert [each.time_ns for each in read] == [START_NS + 55 * MINUTE]


def test_a_block_of_which_the_end_is_wanted_begins_when_that_was_measured() -> None:
    """Ten of forty samples of a second lie before the piece."""
    piece = Piece(
        path=Path("own.mcap"),
        unit="tower",
        session="session-1",
        first_sample=50,
        end_sample=1000,
        shift=-50,
        sequence_shift=-1,
    )
    (cut,) = _wanted(block(1), "t1", [piece])
    assert cut.start_ns == block(1).start_ns + NANOSECONDS // 4
    assert (cut.first_sample, cut.sequence, len(cut.samples)) == (0, 0, 30)


@pytest.mark.parametrize("in_order", [True, False])
def test_a_file_whose_blocks_were_recorded_out_of_order_is_read_in_their_order(
    tmp_path: Path, in_order: bool
) -> None:
    """Beside them stand another turbine's blocks and what a simulation knew."""
    truth = FoundationTruth("t1", START_NS, 1.0, 2.0, 3.0)
    foreign = block(1, turbine="t2")
    blocks = [block(number) for number in (0, 2, 1, 3)]
    path = recorded(tmp_path / "own.mcap", [LAYOUT, truth, reported(0), *blocks, foreign])
    task = replace(task_of(path, START_NS, seconds=4), in_order=in_order)
    read = list(task_messages(task))
    given = [each.sequence for each in read if isinstance(each, AccelerationBlock)]
    assert given == ([0, 2, 1, 3] if in_order else [0, 1, 2, 3])
    assert {each.turbine for each in read} == {"t1"}
    assert [type(each) for each in read].count(FoundationTruth) == 1
    assert [type(each) for each in read].count(ScadaSample) == 1
    assert [type(each) for each in read].count(SensorLayout) == 1


def test_windows_have_the_channels_of_the_turbines_layout_where_their_file_calls_them_otherwise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Identification(IdentificationNode):
        def handle(self, message: Message) -> Iterator[Message]:
            return iter([WINDOW] if isinstance(message, AccelerationBlock) else [])

    monkeypatch.setattr("pipeline.archive.identification.IdentificationNode", Identification)
    path = recorded(tmp_path / "own.mcap", [LAYOUT, block(0)])
    first = WINDOW.channels[0]
    alone = IdentificationCall(task_of(path, START_NS, seconds=1), OmaSettings())
    call = replace(alone, renamed=((first, f"upper/{first}"),))

    (estimate,) = identified(call)
    assert isinstance(estimate, ModalEstimate)
    assert estimate.channels == (f"upper/{first}", *WINDOW.channels[1:])
    assert call.key != alone.key
