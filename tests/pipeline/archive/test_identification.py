"""What a task of an archive reads before its first sample."""

from dataclasses import replace
from pathlib import Path

from pipeline.archive.identification import _wanted, task_messages
from pipeline.archive.plan import IdentificationTask, Piece
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from tests.pipeline.example_messages import LAYOUT, START_NS, block
from tests.pipeline.report.example_session import recorded

MINUTE = 60 * NANOSECONDS  # [ns]


def reported(minute: int) -> ScadaSample:
    return ScadaSample("t1", START_NS + minute * MINUTE, "parked", 8.0, 0.0, 90.0, 0.0, 0.0, 0.5)


def test_the_state_that_was_reported_in_the_ten_minutes_before_is_read_from_the_file_before(
    tmp_path: Path,
) -> None:
    """Controllers report a state that holds every few minutes only."""
    start_ns = START_NS + 60 * MINUTE
    before = recorded(tmp_path / "before.mcap", [reported(45), reported(55), reported(65)])
    first = replace(block(0), start_ns=start_ns)
    path = recorded(tmp_path / "own.mcap", [LAYOUT, first])
    task = IdentificationTask(
        path=path,
        fingerprints=(),
        turbine="t1",
        layout_ids=(LAYOUT.layout_id,),
        pieces=(),
        start_ns=start_ns,
        end_ns=start_ns + NANOSECONDS,
        n_windows=0,
        before=before,
    )
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
