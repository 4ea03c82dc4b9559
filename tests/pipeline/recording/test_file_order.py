"""The order of recordings goes by boots and samples; stamps only say when a boot was."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.recording.file_order import Stretch, logical_starts, recording_and_part, utc_span
from pipeline.recording.writer import Recorder
from pipeline.sources.recorded_stream import recorded_stream, recordings_in
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.example_messages import LAYOUT, block

START_NS = 1_700_000_000 * NANOSECONDS
YEAR = 365 * 86400 * NANOSECONDS
HOUR = 3600 * NANOSECONDS


def stretch(name: str, hour: int, *, session: str = "s", off: int = 0) -> Stretch:
    """An hour at 1 Hz, its stamps off by so much [ns]."""
    first = 3600 * hour
    start_ns = START_NS + hour * HOUR + off
    return Stretch(Path(name), ("t", "u"), session, 1.0, first, first + 3600, start_ns)


def test_right_clocks_give_their_stamps() -> None:
    hours = [stretch(f"{n}.mcap", n) for n in range(5)]
    assert logical_starts(hours) == [each.start_ns for each in hours]


@given(
    wrong=st.integers(1, 9),
    off=st.integers(-30 * YEAR, 30 * YEAR),
    order=st.permutations(range(10)),
)
def test_a_boots_files_follow_its_count_whatever_its_clock_was_before_it_was_set(
    wrong: int, off: int, order: list[int]
) -> None:
    hours = [stretch(f"{n}.mcap", n, off=off if n < wrong else 0) for n in order]
    starts = logical_starts(hours)
    assert [n for _, n in sorted(zip(starts, order, strict=True))] == list(range(10))
    if abs(off) > HOUR:
        assert starts == [START_NS + n * HOUR for n in order]


def test_drift_that_stamps_show_stays_in_them() -> None:
    fast = [stretch(f"{n}.mcap", n, off=n * HOUR // 400) for n in range(5)]
    assert logical_starts(fast) == [each.start_ns for each in fast]


def test_a_boot_follows_the_one_before_it_in_one_recorders_parts() -> None:
    late = stretch("session.part2.mcap", 0, off=10 * YEAR)
    right = replace(stretch("session.part10.mcap", 0, session="r"))
    starts = logical_starts([right, late])
    assert starts[0] > starts[1]


def test_parts_are_numbered_as_a_recorder_names_them() -> None:
    assert recording_and_part(Path("a/session.part12.mcap")) == (Path("a/session.mcap"), 12)
    assert recording_and_part(Path("a/b.mcap")) == (Path("a/b.mcap"), 1)


def recorded(path: Path, numbers: range, off: int) -> None:
    recorder = Recorder(path, metadata={}, clock=None)
    recorder.handle(LAYOUT)
    for number in numbers:
        sent = block(number)
        recorder.handle(replace(sent, start_ns=sent.start_ns + off))
    recorder.close()


@pytest.mark.parametrize("off", [YEAR, -YEAR, 7200 * NANOSECONDS])
def test_a_folder_is_replayed_in_the_order_of_samples(tmp_path: Path, off: int) -> None:
    recorded(tmp_path / "x.mcap", range(20), off)
    recorded(tmp_path / "b.mcap", range(20, 40), 0)
    recorded(tmp_path / "a.mcap", range(40, 60), 0)
    assert [each.name for each in recordings_in(tmp_path)] == ["x.mcap", "b.mcap", "a.mcap"]
    blocks = [each for each in recorded_stream(tmp_path) if isinstance(each, AccelerationBlock)]
    assert [each.sequence for each in blocks] == list(range(60))


def test_a_stretch_of_time_over_midnight_has_both_dates() -> None:
    start = 1_700_000_000 * NANOSECONDS  # 22:13:20
    assert utc_span(start, start + 7200 * NANOSECONDS) == (
        "2023-11-14 22:13:20 to 2023-11-15 00:13:20 UTC (7200 s)"
    )
