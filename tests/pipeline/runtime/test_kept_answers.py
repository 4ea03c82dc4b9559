"""An identification on a machine without the session's recording goes on from its own answers.

windows    |—— 0 ——|—— 1 ——|—— 2 ——|
kept       [answers of 0 and 1]
cache                  ▒▒▒▒▒▒▒▒▒▒▒▒  longer than a window
"""

import errno
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import Message, ModalEstimate
from pipeline.nodes.identification import IdentificationInContext
from pipeline.runtime import identification_restart as kept_answers
from pipeline.runtime.identification_restart import KeptIdentification, ResumedIdentification
from pipeline.runtime.snapshots import CheckpointFolder
from pipeline.updating.serialisation import CheckpointError
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, cut
from tests.pipeline.oma.conftest import structure
from tests.pipeline.runtime.test_identification_restart import (
    SETTINGS,
    answers_of,
    assert_same_windows,
    blocks,
)

KILLED = 155  # after window 3, in the middle of 4 and 5 [s]
CACHED = 100  # that the publisher still has [s]


@pytest.fixture(scope="module")
def measured() -> list[Message]:
    """The layout, then four minutes of two channels with two modes in blocks of one second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    return [LAYOUT, *cut(known.ambient_response(sampling_rate=RATE, duration=240.0, seed=2))]


@pytest.fixture(scope="module")
def undisturbed(measured: list[Message]) -> list[ModalEstimate]:
    return answers_of(IdentificationInContext(SETTINGS), measured)


def started(folder: Path) -> KeptIdentification:
    return KeptIdentification(ResumedIdentification(SETTINGS), folder)


def until_the_kill(measured: list[Message], folder: Path) -> list[Message]:
    return answers_of(started(folder), [LAYOUT, *blocks(measured, 0, KILLED)])


def after_it(measured: list[Message], folder: Path) -> list[Message]:
    since = KILLED - CACHED
    return answers_of(started(folder), [LAYOUT, *blocks(measured, since, 10_000)])


def test_windows_and_the_names_of_modes_go_on_as_if_there_had_been_no_kill(
    measured: list[Message], undisturbed: list[ModalEstimate], tmp_path: Path
) -> None:
    before = until_the_kill(measured, tmp_path)
    after = after_it(measured, tmp_path)
    assert after[0].window == before[-1].window == 3  # on its way when the node was killed, perhaps
    assert_same_windows([*before, *after[1:]], undisturbed)


def test_an_answer_on_its_way_when_the_node_was_killed_comes_once_more_as_it_was(
    measured: list[Message], tmp_path: Path
) -> None:
    (*_, last) = until_the_kill(measured, tmp_path)
    (again, *_) = after_it(measured, tmp_path)
    assert again.modes[0].frequency == last.modes[0].frequency
    assert np.array_equal(again.modes[0].covariance_factor, last.modes[0].covariance_factor)


def test_older_answers_are_kept_small(measured: list[Message], tmp_path: Path) -> None:
    until_the_kill(measured, tmp_path)
    kept = CheckpointFolder(tmp_path, "identification").read(LAYOUT.turbine)
    assert [answer.window for answer in kept.answers] == [0, 1, 2, 3]
    sizes = [answer.modes[0].covariance_factor.size for answer in kept.answers]
    assert sizes[:3] == [0, 0, 0]
    assert sizes[3] > 0


def test_a_file_that_is_none_is_refused_with_its_name(
    measured: list[Message], tmp_path: Path
) -> None:
    path = CheckpointFolder(tmp_path, "identification").file_of(LAYOUT.turbine)
    path.write_bytes(b"nonsense")
    with pytest.raises(CheckpointError, match="is no checkpoint"):
        until_the_kill(measured, tmp_path)


def test_a_full_disk_costs_the_memory_and_not_the_answers(
    measured: list[Message],
    undisturbed: list[ModalEstimate],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(CheckpointFolder, "write", full)
    node = started(tmp_path)
    answers = answers_of(node, measured)
    assert_same_windows(answers, undisturbed)
    assert [doubt.code for doubt in node.warnings] == ["checkpoint-not-written"]


def test_of_any_number_of_turbines_so_many_are_remembered(
    measured: list[Message], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_answers, "MOST_TURBINES", 3)
    node = started(tmp_path)
    for number in range(10):
        list(node.handle(replace(measured[1], turbine=f"t{number}")))
    assert len(node._kept) == 3
