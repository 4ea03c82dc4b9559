"""A block that cannot be of its session changes nothing; a unit that has begun anew is followed."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import (
    Message,
    ModalEstimate,
    StabilisationDiagram,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.block_admission import STUBBORN, BlockAdmission, fits
from pipeline.nodes.identification import IdentificationInContext, IdentificationNode
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, SETTINGS, START, cut
from tests.pipeline.oma.conftest import structure

DAY = 86_400  # [s]


@pytest.fixture(scope="module")
def blocks() -> list[AccelerationBlock]:
    """Two minutes of two channels in blocks of one second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    return cut(known.ambient_response(sampling_rate=RATE, duration=125.0, seed=2))


def strange(block: AccelerationBlock) -> list[AccelerationBlock]:
    """What nobody who sends this session can have sent."""
    return [
        replace(block, sampling_rate=2 * RATE),
        replace(block, samples=block.samples[:, :1]),
        replace(block, first_sample=2**61),
        replace(block, start_ns=block.start_ns + DAY * NANOSECONDS),
        replace(block, session="later", start_ns=2**61),
    ]


def answers(node: IdentificationInContext, blocks: list[AccelerationBlock]) -> list[Message]:
    said = [answer for message in (LAYOUT, *blocks) for answer in node.handle(message)]
    return [answer for answer in said if not isinstance(answer, StabilisationDiagram)]


def test_blocks_that_do_not_fit_their_session_change_nothing_and_are_counted(blocks) -> None:
    disturbed = [*blocks]
    for place, forged in zip((10, 30, 50, 70, 90), strange(blocks[40]), strict=True):
        disturbed.insert(place, forged)
    node = IdentificationInContext(SETTINGS)
    ours, theirs = answers(node, disturbed), answers(IdentificationInContext(SETTINGS), blocks)
    assert [type(each) for each in ours] == [ModalEstimate, ModalEstimate]
    for one, other in zip(ours, theirs, strict=True):
        for mode, twin in zip(one.modes, other.modes, strict=True):
            np.testing.assert_array_equal(mode.shape, twin.shape)
    (warning,) = node.warnings
    assert warning.code == "unfit-blocks"
    assert warning.text.startswith("5 blocks")


def test_a_unit_that_restarts_without_a_new_session_name_is_followed(blocks) -> None:
    again = [replace(block, start_ns=block.start_ns + 200 * NANOSECONDS) for block in blocks]
    again = [replace(b, start_ns=b.start_ns + 2 * DAY * NANOSECONDS) for b in again]
    node = IdentificationInContext(SETTINGS)
    said = answers(node, [*blocks, *again])
    estimates = [each for each in said if isinstance(each, ModalEstimate)]
    assert [each.window for each in estimates] == [0, 1, 0, 1]
    assert estimates[2].start_ns == again[0].start_ns
    assert not node.warnings


def test_more_samples_than_anybody_misses_between_two_blocks_do_not_fit(blocks) -> None:
    """A day may be missing of a tower's samples; not of ten million samples a second."""
    first, later_ns = blocks[0], blocks[0].start_ns + DAY // 2 * NANOSECONDS
    after = replace(first, session="later", start_ns=later_ns)
    fast = replace(first, sampling_rate=1e7)
    leap = round(1e7 * DAY / 2)
    assert fits(first, after)
    assert not fits(first, replace(after, sampling_rate=1e7))
    assert not fits(fast, replace(fast, first_sample=fast.first_sample + leap, start_ns=later_ns))


def test_the_gate_holds_no_more_than_it_needs_to_decide(blocks) -> None:
    gate = BlockAdmission()
    gate.admit(blocks[0])
    later = [replace(b, start_ns=b.start_ns + 2 * DAY * NANOSECONDS) for b in blocks]
    admitted = [gate.admit(block) for block in later[: STUBBORN + 1]]
    assert [len(each.blocks) for each in admitted] == [0] * (STUBBORN - 1) + [STUBBORN, 1]
    assert [each.anew for each in admitted] == [False] * (STUBBORN - 1) + [True, False]
    assert gate.unfit == 0


def test_a_year_missing_is_one_gap_and_not_a_flood_of_windows(blocks) -> None:
    year = 365 * DAY
    shifted = [
        replace(
            block,
            sequence=block.sequence + year,
            first_sample=block.first_sample + round(year * RATE),
        )
        for block in blocks
    ]
    node = IdentificationNode(SETTINGS)
    said = [answer for message in (LAYOUT, *shifted) for answer in node.handle(message)]
    assert sum(isinstance(each, StreamGap) for each in said) == 1
    rejected = [each for each in said if isinstance(each, WindowRejected)]
    assert len(rejected) <= 2
    estimates = [each for each in said if isinstance(each, ModalEstimate)]
    assert [each.window for each in estimates] == [year // 60, year // 60 + 1]
    assert estimates[0].start_ns == START


def test_a_rate_at_which_no_window_can_be_held_is_refused_however_often_it_comes(blocks) -> None:
    fast = [replace(block, sampling_rate=1e7, session="fast") for block in blocks[:20]]
    node = IdentificationInContext(SETTINGS)
    disturbed = [each for pair in zip(blocks, fast * 7, strict=False) for each in pair]
    ours, theirs = answers(node, disturbed), answers(IdentificationInContext(SETTINGS), blocks)
    assert [type(each) for each in ours] == [type(each) for each in theirs]
    (warning,) = node.warnings
    assert warning.text.startswith(f"{len(disturbed) - len(blocks)} blocks")
    assert "a window of 60 s would hold 1.2e+09 values at 1e+07 Hz" in warning.text
