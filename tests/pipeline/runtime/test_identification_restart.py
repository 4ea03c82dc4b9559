"""An identification that is started again goes on from the recording as if nothing had been.

windows    |—— 0 ——|—— 1 ——|—— 2 ——|
recorded   ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒
cache                     ▒▒▒▒▒▒▒▒▒▒  shorter than a window
"""

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
from pipeline.nodes.identification import IdentificationInContext
from pipeline.oma.settings import OmaSettings
from pipeline.recording.latest_messages import files_of, latest_messages
from pipeline.recording.writer import Recorder, RecorderSettings
from pipeline.runtime.identification_restart import ResumedIdentification, recorded_past
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, cut
from tests.pipeline.oma.conftest import structure

SETTINGS = OmaSettings(window_duration=60.0, hop=30.0)


@pytest.fixture(scope="module")
def measured() -> list[Message]:
    """The layout, then four minutes of two channels with two modes in blocks of one second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    return [LAYOUT, *cut(known.ambient_response(sampling_rate=RATE, duration=240.0, seed=2))]


@pytest.fixture(scope="module")
def undisturbed(measured: list[Message]) -> list[ModalEstimate]:
    answers = answers_of(IdentificationInContext(SETTINGS), measured)
    assert all(isinstance(answer, ModalEstimate) for answer in answers)
    return answers


def answers_of(node: object, messages: Iterable[Message]) -> list[Message]:
    """What is said of windows and gaps; diagrams are for people."""
    said = [answer for message in messages for answer in node.handle(message)]
    return [answer for answer in said if not isinstance(answer, StabilisationDiagram)]


def blocks(messages: Iterable[Message], since: int, until: int) -> list[Message]:
    return [m for m in messages if isinstance(m, AccelerationBlock) and since <= m.sequence < until]


def assert_same_windows(ours: list[Message], theirs: list[ModalEstimate]) -> None:
    assert [(m.window, m.start_ns, m.end_ns) for m in ours] == [
        (m.window, m.start_ns, m.end_ns) for m in theirs
    ]
    for one, other in zip(ours, theirs, strict=True):
        assert [mode.name for mode in one.modes] == [mode.name for mode in other.modes]
        for mode, twin in zip(one.modes, other.modes, strict=True):
            assert mode.frequency == pytest.approx(twin.frequency, rel=1e-9)
            np.testing.assert_allclose(mode.shape, twin.shape, atol=1e-7)


def killed_at(
    moment: int, cached: int, measured: list[Message], *, recorded_until: int | None = None
) -> tuple[list[Message], list[Message]]:
    """What was answered before the kill and after it; blocks come from the cache, then live."""
    before = answers_of(
        IdentificationInContext(SETTINGS), [measured[0], *blocks(measured, 0, moment)]
    )
    until = moment if recorded_until is None else recorded_until
    past = [measured[0], *blocks(measured, 0, until), *before]
    node = ResumedIdentification(SETTINGS, past)
    return before, answers_of(node, [measured[0], *blocks(measured, moment - cached, 10_000)])


@pytest.mark.parametrize("cached", [0, 10, 155])
def test_windows_go_on_as_if_there_had_been_no_kill(measured, undisturbed, cached: int) -> None:
    before, after = killed_at(155, cached, measured)
    assert len(before) == 4
    assert [a.window for a in after[:4]] == [0, 1, 2, 3]  # no posterior is recorded: once more
    assert_same_windows(before + after[4:], undisturbed)


def test_what_neither_recording_nor_cache_holds_is_a_gap_and_said_to_be_one(measured) -> None:
    before, after = killed_at(155, 5, measured, recorded_until=145)
    new = after[len(before) :]
    (gap,) = (m for m in new if isinstance(m, StreamGap))
    assert (gap.first_sequence, gap.n_blocks) == (145, 5)
    rejected = [m for m in new if isinstance(m, WindowRejected)]
    assert [m.window for m in rejected] == [4]  # 120 to 180 s; window 5 begins with sample 150 s
    assert {m.code for m in rejected} == {"gap"}


def test_a_recording_of_another_session_is_no_past(measured, undisturbed) -> None:
    older = [
        replace(m, session="yesterday", start_ns=m.start_ns - 86_400 * 10**9)
        for m in blocks(measured, 0, 200)
    ]
    node = ResumedIdentification(SETTINGS, [measured[0], *older])
    assert_same_windows(answers_of(node, measured), undisturbed)


def test_the_past_is_read_from_the_recording_that_is_being_written(
    measured, undisturbed, tmp_path: Path
) -> None:
    path = tmp_path / "session.mcap"
    node = IdentificationInContext(SETTINGS)
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
            for each in (message, *node.handle(message)):
                recorder.handle(each)
        if part == path:
            recorder.close()
    recorder._writer.flush()  # as after a second
    recorder._file.flush()
    assert [file.name for file in files_of(path)] == ["session.mcap", "session.part2.mcap.active"]
    past = recorded_past(files_of(path), SETTINGS)
    resumed = ResumedIdentification(SETTINGS, past)
    new = answers_of(resumed, [measured[0], *blocks(measured, 155, 10_000)])
    known = sum(
        m.end_ns <= max(p.end_ns for p in past if isinstance(p, ModalEstimate)) for m in new
    )
    assert_same_windows(new[known:], undisturbed[-len(new[known:]) :])
    latest = latest_messages(files_of(path), (AccelerationBlock,), horizon=20.0)
    assert [m.sequence for m in latest] == list(range(135, 155))
