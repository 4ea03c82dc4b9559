"""An identification that is started again goes on as if nothing had been.

windows    |—— 0 ——|—— 1 ——|—— 2 ——|
snapshot                   of the numbers that windows go by
recorded   ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒
cache                     ▒▒▒▒▒▒▒▒▒▒  shorter than a window, or longer
"""

import errno
import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import (
    Message,
    ModalEstimate,
    StabilisationDiagram,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.identification import REPEATED_ANSWERS, IdentificationNode
from pipeline.oma.settings import OmaSettings
from pipeline.recording.latest_messages import files_of, latest_estimates, latest_messages
from pipeline.recording.writer import Recorder, RecorderSettings
from pipeline.runtime.snapshots import SnapshotFolder, recorded_past
from pipeline.updating.checkpoint import CheckpointError
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, cut
from tests.pipeline.nodes.test_wrong_clocks import YEAR, of_two_units
from tests.pipeline.oma.conftest import structure

pytestmark = pytest.mark.usefixtures("identified_once")

SETTINGS = OmaSettings(window_duration=60.0, hop=30.0)


@pytest.fixture(scope="module")
def measured() -> list[Message]:
    """The layout, then four minutes of two channels with two modes in blocks of one second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    return [LAYOUT, *cut(known.ambient_response(sampling_rate=RATE, duration=240.0, seed=2))]


@pytest.fixture(scope="module")
def undisturbed(measured: list[Message]) -> list[ModalEstimate]:
    answers = answers_of(IdentificationNode(SETTINGS), measured)
    assert all(isinstance(answer, ModalEstimate) for answer in answers)
    return answers


def answers_of(node: IdentificationNode, messages: Iterable[Message]) -> list[Message]:
    """What is said of windows and gaps; diagrams are for people."""
    said = [answer for message in messages for answer in node.handle(message)]
    return [answer for answer in said if not isinstance(answer, StabilisationDiagram)]


def blocks(messages: Iterable[Message], since: int, until: int) -> list[Message]:
    return [m for m in messages if isinstance(m, AccelerationBlock) and since <= m.sequence < until]


def assert_same_windows(ours: list[Message], theirs: list[ModalEstimate]) -> None:
    assert [(m.window, m.start_ns, m.end_ns, m.origins) for m in ours] == [
        (m.window, m.start_ns, m.end_ns, m.origins) for m in theirs
    ]
    for one, other in zip(ours, theirs, strict=True):
        assert [mode.name for mode in one.modes] == [mode.name for mode in other.modes]
        for mode, twin in zip(one.modes, other.modes, strict=True):
            assert mode.frequency == pytest.approx(twin.frequency, rel=1e-9)
            np.testing.assert_allclose(mode.shape, twin.shape, atol=1e-7)


def node_in(folder: Path, past: Iterable[Message] = ()) -> IdentificationNode:
    """As a process that has just been started makes it."""
    store = SnapshotFolder(folder, "identification")
    return IdentificationNode(SETTINGS, store=store, past=tuple(past))


def killed_at(
    moment: int,
    cached: int,
    measured: list[Message],
    folder: Path,
    *,
    recorded_until: int | None = None,
) -> tuple[list[Message], list[Message]]:
    """What was answered before the kill and after it; blocks come from the cache, then live."""
    before = answers_of(node_in(folder), [measured[0], *blocks(measured, 0, moment)])
    until = moment if recorded_until is None else recorded_until
    past = [measured[0], *blocks(measured, 0, until)]
    after = answers_of(
        node_in(folder, past), [measured[0], *blocks(measured, moment - cached, 10_000)]
    )
    return before, after


def without_repeated(before: list[Message], after: list[Message]) -> list[Message]:
    """The answers after a restart but for those that are given once more."""
    again = min(REPEATED_ANSWERS, sum(not isinstance(each, StreamGap) for each in before))
    assert [each.origins for each in after[:again]] == [e.origins for e in before[-again:]][:again]
    return after[again:]


@pytest.mark.parametrize("moment", [20, 75, 155, 185])
@pytest.mark.parametrize("cached", [0, 10, 155])
def test_windows_go_on_as_if_there_had_been_no_kill(
    measured, undisturbed, tmp_path: Path, cached: int, moment: int
) -> None:
    before, after = killed_at(moment, min(cached, moment), measured, tmp_path)
    assert_same_windows(before + without_repeated(before, after), undisturbed)


def test_without_a_recording_the_cache_alone_is_enough(
    measured, undisturbed, tmp_path: Path
) -> None:
    before, after = killed_at(155, 100, measured, tmp_path, recorded_until=0)
    assert_same_windows(before + without_repeated(before, after), undisturbed)


def test_answers_that_may_not_have_been_recorded_are_given_again_as_they_were(
    measured, tmp_path: Path
) -> None:
    before, after = killed_at(155, 0, measured, tmp_path)
    for last, again in zip(before[-REPEATED_ANSWERS:], after[:REPEATED_ANSWERS], strict=True):
        assert again.modes[0].frequency == last.modes[0].frequency
        assert np.array_equal(again.modes[0].covariance_factor, last.modes[0].covariance_factor)


def test_what_neither_recording_nor_cache_holds_is_a_gap_and_said_to_be_one(
    measured, tmp_path: Path
) -> None:
    before, after = killed_at(155, 5, measured, tmp_path, recorded_until=145)
    new = without_repeated(before, after)
    (gap,) = (m for m in new if isinstance(m, StreamGap))
    assert (gap.first_sequence, gap.n_blocks) == (145, 5)
    rejected = [m for m in new if isinstance(m, WindowRejected)]
    assert [m.window for m in rejected] == [4]  # 120 to 180 s; window 5 begins with sample 150 s
    assert {m.code for m in rejected} == {"gap"}


def test_a_clock_that_was_wrong_before_the_kill_is_no_matter_after_it(
    measured, undisturbed, tmp_path: Path
) -> None:
    """On today's main blocks of 2036 made every later one an old one, over restarts too."""
    wrong = [
        replace(m, start_ns=m.start_ns + round(12 * YEAR) * NANOSECONDS)
        if isinstance(m, AccelerationBlock) and m.sequence < 130
        else m
        for m in measured
    ]
    before, after = killed_at(155, 10, wrong, tmp_path)
    said = before + without_repeated(before, after)
    assert [m.window for m in said] == [m.window for m in undisturbed]
    spanned = [3, 4]  # 90 to 150 s, 120 to 180 s
    assert [m.window for m in said if isinstance(m, WindowRejected)] == spanned
    assert {m.code for m in said if isinstance(m, WindowRejected)} == {"clock-step"}


def test_a_unit_that_restarted_before_the_kill_is_taken_up_in_its_present_boot(
    measured, tmp_path: Path
) -> None:
    again = [
        replace(m, start_ns=m.start_ns + 300 * NANOSECONDS, samples=m.samples[::-1].copy())
        for m in blocks(measured, 0, 240)
    ]
    heard = [*measured, *again]
    undisturbed = answers_of(IdentificationNode(SETTINGS), heard)
    moment = len(measured) + 100
    before = answers_of(node_in(tmp_path), heard[:moment])
    after = answers_of(node_in(tmp_path, heard[:moment]), heard[moment:])
    assert_same_windows(before + without_repeated(before, after), undisturbed)
    assert after[-1].origins[0].boot == 1


@pytest.mark.parametrize("moment", [50, 155, 200])
def test_units_that_are_joined_go_on_with_the_same_windows(
    measured, tmp_path: Path, moment: int
) -> None:
    heard = of_two_units(blocks(measured, 0, 240))
    undisturbed = answers_of(IdentificationNode(SETTINGS), heard)
    stop = 2 + 2 * moment
    before = answers_of(node_in(tmp_path), heard[:stop])
    after = answers_of(node_in(tmp_path, heard[:stop]), heard[stop:])
    said = before + without_repeated(before, after)
    assert [(m.window, m.start_ns, m.origins) for m in said] == [
        (m.window, m.start_ns, m.origins) for m in undisturbed
    ]
    for one, other in zip(said, undisturbed, strict=True):
        for mode, twin in zip(one.modes, other.modes, strict=True):
            assert mode.frequency == pytest.approx(twin.frequency, rel=1e-6)


def test_a_recording_of_another_session_is_no_past(measured, undisturbed, tmp_path: Path) -> None:
    older = [
        replace(m, session="yesterday", start_ns=m.start_ns - 86_400 * 10**9)
        for m in blocks(measured, 0, 200)
    ]
    node = node_in(tmp_path, [measured[0], *older])
    assert_same_windows(answers_of(node, measured), undisturbed)


def test_a_file_that_is_none_is_refused_with_its_name(measured, tmp_path: Path) -> None:
    path = SnapshotFolder(tmp_path, "identification").file_of(LAYOUT.turbine)
    path.write_bytes(b"nonsense")
    with pytest.raises(CheckpointError, match="is no checkpoint"):
        answers_of(node_in(tmp_path), measured[:3])


def test_a_full_disk_costs_the_memory_and_not_the_answers(
    measured, undisturbed, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(SnapshotFolder, "write", full)
    node = node_in(tmp_path)
    assert_same_windows(answers_of(node, measured), undisturbed)
    assert [each.code for each in node.statistics.warnings] == ["checkpoint-not-written"]


def test_a_snapshot_is_small(measured, tmp_path: Path) -> None:
    answers_of(node_in(tmp_path), measured)
    assert SnapshotFolder(tmp_path, "identification").file_of("t1").stat().st_size < 50_000


def test_the_past_is_read_from_the_recording_that_is_being_written(
    measured, undisturbed, tmp_path: Path
) -> None:
    path = tmp_path / "session.mcap"
    node = node_in(tmp_path / "kept")
    before: list[Message] = []
    parts = (path, tmp_path / "session.part2.mcap")
    for part, messages in zip(
        parts,
        ([measured[0], *blocks(measured, 0, 100)], blocks(measured, 100, 155)),
        strict=True,
    ):
        recorder = Recorder(
            part, metadata={}, clock=None, settings=RecorderSettings(chunk_duration=1.0)
        )
        for message in messages:
            answers = list(node.handle(message))
            before += [each for each in answers if not isinstance(each, StabilisationDiagram)]
            for each in (message, *answers):
                recorder.handle(each)
        if part == path:
            recorder.close()
    recorder._writer.flush()  # as after a second
    recorder._file.flush()
    assert [file.name for file in files_of(path)] == ["session.mcap", "session.part2.mcap.active"]
    past = recorded_past(files_of(path), SETTINGS)
    resumed = node_in(tmp_path / "kept", past)
    after = answers_of(resumed, [measured[0], *blocks(measured, 155, 10_000)])
    assert_same_windows(before + without_repeated(before, after), undisturbed)
    latest = latest_messages(files_of(path), (AccelerationBlock,), horizon=20.0)
    assert [m.sequence for m in latest] == list(range(135, 155))
    assert [m.window for m in latest_estimates(files_of(path), 2)] == [2, 3]


def test_two_windows_with_all_that_may_wait_for_them_are_read(monkeypatch) -> None:
    asked = []
    monkeypatch.setattr(
        "pipeline.runtime.snapshots.latest_messages",
        lambda files, types, horizon: asked.append(horizon) or (),
    )
    settings = OmaSettings(window_duration=600.0, hop=300.0, lateness=30.0)
    recorded_past([Path("a.mcap")], settings)
    assert asked[0] >= 2 * (600.0 + 300.0) + 30.0
    assert asked[0] <= 3 * (600.0 + 300.0)
