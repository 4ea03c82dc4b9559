"""Blocks in, one answer a window out: what happens to gaps, repeats and late blocks."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import (
    Message,
    ModalEstimate,
    StabilisationDiagram,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.settings import OmaSettings
from pipeline.state.books import Books
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import biaxial_layout
from tests.pipeline.oma.conftest import structure

pytestmark = pytest.mark.usefixtures("identified_once")

RATE = 20.0  # [Hz]
START = 1_700_000_000 * NANOSECONDS
LAYOUT = biaxial_layout("layout-1", turbine="t1", unit="tower", elevations=[80.0])
SETTINGS = OmaSettings(window_duration=60.0, hop=60.0)


@pytest.fixture(scope="module")
def blocks() -> list[AccelerationBlock]:
    """Three minutes of two channels in blocks of one second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    samples = known.ambient_response(sampling_rate=RATE, duration=180.0, seed=2)
    return cut(samples)


def cut(samples: np.ndarray, session: str = "s1") -> list[AccelerationBlock]:
    length = round(RATE)
    return [
        AccelerationBlock(
            turbine="t1",
            unit="tower",
            session=session,
            layout_id="layout-1",
            sequence=k,
            first_sample=k * length,
            start_ns=START + k * NANOSECONDS,
            sampling_rate=RATE,
            samples=samples[k * length : (k + 1) * length].astype(np.float32),
        )
        for k in range(len(samples) // length)
    ]


def answers(blocks: Iterable[AccelerationBlock]) -> list[Message]:
    """What is said of windows and gaps; diagrams are for people."""
    return [a for a in everything_said(blocks) if not isinstance(a, StabilisationDiagram)]


def everything_said(blocks: Iterable[AccelerationBlock]) -> list[Message]:
    node = IdentificationNode(SETTINGS)
    said = list(node.handle(LAYOUT))
    last = None
    for block in blocks:
        said += node.handle(block)
        last = block
    assert last is not None
    end = StreamEnd("t1", "tower", last.session, last.end_ns, last.sequence + 1)
    return said + list(node.handle(end))


def outline(messages: Iterable[Message]) -> list[str]:
    return [
        f"{type(m).__name__} {m.window}" if not isinstance(m, StreamGap) else "StreamGap"
        for m in messages
    ]


def same_modes(first: Message, second: Message) -> bool:
    assert isinstance(first, ModalEstimate)
    assert isinstance(second, ModalEstimate)
    pairs = zip(first.modes, second.modes, strict=True)
    return all(a.frequency == b.frequency and (a.shape == b.shape).all() for a, b in pairs)


def test_every_minute_gives_one_estimate_on_sensor_time(blocks: list[AccelerationBlock]) -> None:
    """
    |—— 0 ——|—— 1 ——|—— 2 ——|
    """
    said = answers(blocks)
    assert outline(said) == ["ModalEstimate 0", "ModalEstimate 1", "ModalEstimate 2"]
    for k, estimate in enumerate(said):
        assert isinstance(estimate, ModalEstimate)
        assert estimate.start_ns == START + 60 * k * NANOSECONDS
        assert estimate.end_ns == START + 60 * (k + 1) * NANOSECONDS
        assert estimate.channels == ("z80-fa", "z80-ss")
        assert estimate.modes[0].frequency == pytest.approx(1.0, rel=0.02)


def n_orders(diagram: StabilisationDiagram, chosen: np.ndarray) -> int:
    return len(np.unique(diagram.orders[chosen]))


def test_every_estimate_comes_with_the_poles_it_was_found_among(
    blocks: list[AccelerationBlock],
) -> None:
    said = everything_said(blocks)
    estimates = [each for each in said if isinstance(each, ModalEstimate)]
    diagrams = [each for each in said if isinstance(each, StabilisationDiagram)]
    assert [(d.window, d.start_ns, d.end_ns) for d in diagrams] == [
        (e.window, e.start_ns, e.end_ns) for e in estimates
    ]
    for estimate, diagram in zip(estimates, diagrams, strict=True):
        for mode in estimate.modes:
            near = np.abs(diagram.frequencies / mode.frequency - 1) < 0.02  # as alike as poles get
            bands = [diagram.bands == band for band in np.unique(diagram.bands)]
            shares = [n_orders(diagram, near & band) / n_orders(diagram, band) for band in bands]
            assert max(shares) >= mode.presence
            assert (diagram.frequency_stds[near] > 0).all()
            assert np.median(diagram.damping_ratios[near]) == pytest.approx(
                mode.damping_ratio, abs=3 * mode.damping_ratio_std
            )


def test_what_was_refused_comes_with_the_poles(blocks: list[AccelerationBlock]) -> None:
    said = everything_said(blocks)
    refused = [r for d in said if isinstance(d, StabilisationDiagram) for r in d.refused]
    assert refused
    assert all(each.code and each.text and each.frequency > 0 for each in refused)


def test_few_lost_seconds_cost_no_window(blocks: list[AccelerationBlock]) -> None:
    """
    |—— 0 ——|—▒ 1 ——|—— 2 ——|
    """
    said = answers(blocks[:70] + blocks[72:])
    assert [line for line in outline(said) if line != "StreamGap"] == [
        "ModalEstimate 0",
        "ModalEstimate 1",
        "ModalEstimate 2",
    ]
    gap = next(each for each in said if isinstance(each, StreamGap))
    assert (gap.first_sequence, gap.n_blocks) == (70, 2)
    assert (gap.start_ns, gap.end_ns) == (START + 70 * NANOSECONDS, START + 72 * NANOSECONDS)
    window = next(e for e in said if isinstance(e, ModalEstimate) and e.window == 1)
    assert [warning.code for warning in window.warnings] == ["missing"]


def test_one_sample_that_is_no_number_costs_no_window(blocks: list[AccelerationBlock]) -> None:
    """It rejected ten minutes."""
    spoilt = blocks[70].samples.copy()
    spoilt[3, 1] = np.nan
    said = answers([*blocks[:70], replace(blocks[70], samples=spoilt), *blocks[71:]])
    assert outline(said) == ["ModalEstimate 0", "ModalEstimate 1", "ModalEstimate 2"]
    for each, plain in zip(said, answers(blocks), strict=True):
        assert isinstance(each, ModalEstimate)
        assert isinstance(plain, ModalEstimate)
        assert each.modes[0].frequency == pytest.approx(plain.modes[0].frequency, rel=1e-3)
        codes = {warning.code for warning in each.warnings}
        assert ("missing" in codes) == (each.window == 1)


def test_many_lost_blocks_reject_their_window_and_no_other(
    blocks: list[AccelerationBlock],
) -> None:
    said = answers(blocks[:70] + blocks[77:])
    assert outline(said) == [
        "ModalEstimate 0",
        "StreamGap",
        "WindowRejected 1",
        "ModalEstimate 2",
    ]
    rejected = said[2]
    assert isinstance(rejected, WindowRejected)
    assert (rejected.code, rejected.reason) == ("gap", "gap of 7 s in unit tower at 70.000 s")


def test_a_late_block_opens_no_gap(blocks: list[AccelerationBlock]) -> None:
    shuffled = blocks.copy()
    shuffled[30], shuffled[32] = shuffled[32], shuffled[30]
    in_order, late = answers(blocks), answers(shuffled)
    assert outline(late) == outline(in_order)
    assert same_modes(late[0], in_order[0])


def test_a_repeated_block_is_used_once(blocks: list[AccelerationBlock]) -> None:
    repeated = [*blocks[:31], blocks[30], blocks[10], *blocks[31:]]
    assert same_modes(answers(repeated)[0], answers(blocks)[0])


def test_a_block_that_comes_after_its_gap_was_declared_changes_nothing(
    blocks: list[AccelerationBlock],
) -> None:
    very_late = blocks[:70] + blocks[71:90] + [blocks[70]] + blocks[90:]
    assert outline(answers(very_late)) == outline(answers(blocks[:70] + blocks[71:]))


def test_late_and_repeated_blocks_stay_counted_when_their_session_ends(
    blocks: list[AccelerationBlock],
) -> None:
    node = IdentificationNode(SETTINGS)
    end = StreamEnd("t1", "tower", "s1", blocks[39].end_ns, 40)
    sent = [*blocks[:20], *blocks[21:35], blocks[20], blocks[34], *blocks[35:40], end]
    for message in sent:
        list(node.handle(message))
    assert (node.statistics.late, node.statistics.duplicate) == (1, 1)


def test_a_gap_over_several_windows_rejects_each(blocks: list[AccelerationBlock]) -> None:
    said = answers(blocks[:50] + blocks[130:])
    assert outline(said) == [
        "StreamGap",
        "WindowRejected 0",
        "WindowRejected 1",
        "WindowRejected 2",
    ]


def test_a_session_that_ends_early_says_so(blocks: list[AccelerationBlock]) -> None:
    said = answers(blocks[:100])
    assert outline(said) == ["ModalEstimate 0", "WindowRejected 1"]
    assert isinstance(said[1], WindowRejected)
    assert said[1].code == "short"


def test_an_end_that_overtakes_the_last_blocks_waits_for_them(
    blocks: list[AccelerationBlock],
) -> None:
    node = IdentificationNode(SETTINGS)
    end = StreamEnd("t1", "tower", "s1", blocks[-1].end_ns, len(blocks))
    order = [LAYOUT, *blocks[:-8], end, *blocks[-8:]]
    said = [answer for message in order for answer in node.handle(message)]
    assert outline(said) == outline(everything_said(blocks))


def test_a_new_session_begins_with_window_zero(blocks: list[AccelerationBlock]) -> None:
    restarted = [replace(block, session="s2") for block in blocks[:60]]
    said = answers(blocks[:60] + restarted)
    assert outline(said) == ["ModalEstimate 0", "ModalEstimate 0"]


def test_a_dead_channel_rejects_the_window_with_its_reason() -> None:
    samples = np.random.default_rng(5).standard_normal((1200, 2))
    samples[:, 1] = 0.0
    said = answers(cut(samples))
    assert isinstance(said[0], WindowRejected)
    assert (said[0].code, said[0].reason) == ("constant", "z80-ss is constant over the window")


@pytest.mark.parametrize("hours", [1, 24, 7 * 24])
def test_every_window_of_a_long_gap_has_an_answer(blocks, hours: int) -> None:
    """On today's main the audit of a day's cut names windows without one."""
    away = hours * 3600 - 90
    later = [
        replace(
            each,
            sequence=each.sequence + away,
            first_sample=each.first_sample + away * round(RATE),
            start_ns=each.start_ns + away * NANOSECONDS,
        )
        for each in blocks[90:]
    ]
    said = answers([*blocks[:90], *later])
    books = Books(updates=False)
    for message in (*blocks[:90], *later, *said):
        books.handle(message)
    assert not books.violations()
    (turbine,) = books.as_json()["turbines"]
    # the gap ends 90 s into the blocks that are left: two windows of theirs, and the last is short
    assert turbine["identified"] + sum(turbine["rejected"].values()) == hours * 60 + 2
    assert len(said) < 150


@pytest.mark.parametrize(
    ("highest", "code", "words"),
    [
        (0.01, "no-band", "[oma] highest_frequency is 0.01 Hz: nothing can be identified below"),
        (11.0, "settings", "[oma] highest_frequency is 11 Hz; a sampling rate of 20 Hz reaches"),
    ],
)
def test_a_scenarios_frequencies_out_of_reach_reject_each_window(
    blocks: list[AccelerationBlock], highest: float, code: str, words: str
) -> None:
    node = IdentificationNode(replace(SETTINGS, highest_frequency=highest))
    node.handle(LAYOUT)
    said = [answer for block in blocks for answer in node.handle(block)]
    assert [answer.code for answer in said if isinstance(answer, WindowRejected)] == [code] * 3
    assert all(words in answer.reason for answer in said if isinstance(answer, WindowRejected))
