"""A block that cannot be of its session changes nothing; a unit that has begun anew is followed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import (
    Message,
    MessageCount,
    ModalEstimate,
    NodeStatus,
    StabilisationDiagram,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.windows.block_admission import (
    CONFLICT,
    OTHER_SESSION,
    REPEATED,
    STUBBORN,
    TOO_MANY_CHANNELS,
    BlockAdmission,
    LimitError,
    LimitSettings,
    refusal_of,
)
from pipeline.runtime.snapshots import SnapshotFolder
from pipeline.scenario import scenario_from_text
from pipeline.state.books import Books
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockMark
from tests.pipeline.example_messages import block as message
from tests.pipeline.histories import identify_by_digests
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, SETTINGS, START, cut
from tests.pipeline.oma.conftest import structure

pytestmark = pytest.mark.usefixtures("identified_once")

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


def answers(node: IdentificationNode, blocks: list[AccelerationBlock]) -> list[Message]:
    said = [answer for message in (LAYOUT, *blocks) for answer in node.handle(message)]
    return [answer for answer in said if not isinstance(answer, StabilisationDiagram)]


def test_blocks_that_do_not_fit_their_session_change_nothing_and_are_counted(blocks) -> None:
    disturbed = [*blocks]
    for place, forged in zip((10, 30, 50, 70, 90), strange(blocks[40]), strict=True):
        disturbed.insert(place, forged)
    node = IdentificationNode(SETTINGS)
    ours, theirs = answers(node, disturbed), answers(IdentificationNode(SETTINGS), blocks)
    assert [type(each) for each in ours] == [ModalEstimate, ModalEstimate]
    for one, other in zip(ours, theirs, strict=True):
        for mode, twin in zip(one.modes, other.modes, strict=True):
            np.testing.assert_array_equal(mode.shape, twin.shape)
    (warning,) = node.statistics.warnings
    assert warning.code == "unfit-blocks"
    assert warning.text.startswith("5 blocks")


def test_a_unit_that_restarts_without_a_new_session_name_is_followed(blocks) -> None:
    again = [replace(block, start_ns=block.start_ns + 200 * NANOSECONDS) for block in blocks]
    again = [replace(b, start_ns=b.start_ns + 2 * DAY * NANOSECONDS) for b in again]
    node = IdentificationNode(SETTINGS)
    said = answers(node, [*blocks, *again])
    estimates = [each for each in said if isinstance(each, ModalEstimate)]
    assert [each.window for each in estimates] == [0, 1, 0, 1]
    assert estimates[2].start_ns == again[0].start_ns
    assert not node.statistics.warnings


def test_more_samples_than_anybody_misses_between_two_blocks_do_not_fit(blocks) -> None:
    """A day may be missing of a tower's samples; not of ten million samples a second."""
    first, later_ns = blocks[0], blocks[0].start_ns + DAY // 2 * NANOSECONDS
    leap = round(RATE * DAY / 2)
    fast, fast_leap = replace(first, sampling_rate=1e7), round(1e7 * DAY / 2)
    after = replace(first, first_sample=leap, start_ns=later_ns)
    assert refusal_of(BlockMark.of(first), after) is None
    after = replace(fast, first_sample=fast_leap, start_ns=later_ns)
    assert refusal_of(BlockMark.of(fast), after) is not None


def test_the_gate_holds_no_more_than_it_needs_to_decide(blocks) -> None:
    gate = BlockAdmission()
    gate.admit(blocks[0])
    later = [replace(b, start_ns=b.start_ns + 2 * DAY * NANOSECONDS) for b in blocks]
    admitted = [gate.admit(block) for block in later[: STUBBORN + 1]]
    assert [len(each.blocks) for each in admitted] == [0] * (STUBBORN - 1) + [STUBBORN, 1]
    assert [each.begins is not None for each in admitted] == [False] * (STUBBORN - 1) + [
        True,
        False,
    ]
    assert gate.refused.total() == 0


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
    node = IdentificationNode(SETTINGS)
    disturbed = [each for pair in zip(blocks, fast * 7, strict=False) for each in pair]
    ours, theirs = answers(node, disturbed), answers(IdentificationNode(SETTINGS), blocks)
    assert [type(each) for each in ours] == [type(each) for each in theirs]
    (warning,) = node.statistics.warnings
    assert warning.text.startswith(f"{len(disturbed) - len(blocks)} blocks")
    assert "a window of 60 s would hold 1.2e+09 values at 1e+07 Hz" in warning.text


def test_a_session_of_another_name_now_and_then_ends_no_window(blocks) -> None:
    """Another run under the unit's key, one block every twenty seconds."""
    disturbed: list[AccelerationBlock] = []
    for block in blocks:
        disturbed.append(block)
        if block.sequence % 20 == 10:
            disturbed.append(replace(block, session="another run", sequence=0, first_sample=0))
    node = IdentificationNode(SETTINGS)
    said = answers(node, disturbed)
    assert [type(each) for each in said] == [ModalEstimate, ModalEstimate]
    assert node.statistics.rejected == {OTHER_SESSION: 6}
    assert node.statistics.warnings[0].code == "unfit-blocks"


def test_of_two_boxes_with_one_name_the_first_is_used_and_the_other_counted(blocks) -> None:
    other = [replace(b, session="s2", samples=b.samples[::-1].copy()) for b in blocks]
    node = IdentificationNode(SETTINGS)
    both = [each for pair in zip(blocks, other, strict=True) for each in pair]
    said = answers(node, both)
    assert [type(each) for each in said] == [ModalEstimate, ModalEstimate]
    assert node.statistics.rejected[OTHER_SESSION] >= len(other) - 1


def test_two_boxes_that_cannot_be_told_apart_by_name_reject_the_windows(blocks) -> None:
    other = [replace(b, samples=b.samples[::-1].copy()) for b in blocks]
    node = IdentificationNode(SETTINGS)
    said = answers(node, [each for pair in zip(blocks, other, strict=True) for each in pair])
    assert [each.code for each in said] == ["conflicting-blocks"] * 2
    assert node.statistics.rejected[CONFLICT] == len(other)


def test_a_unit_that_restarts_within_the_hour_under_its_name_is_another_boot(blocks) -> None:
    """On today's main all blocks of the second boot were dropped as late."""
    pause = 150 * NANOSECONDS
    again = [
        replace(b, start_ns=b.start_ns + pause, samples=b.samples[::-1].copy()) for b in blocks
    ]
    node = IdentificationNode(SETTINGS)
    said = answers(node, [*blocks, *again])
    estimates = [each for each in said if isinstance(each, ModalEstimate)]
    assert [each.window for each in estimates] == [0, 1, 0, 1]
    assert [each.origins[0].boot for each in estimates] == [0, 0, 1, 1]
    assert not any(isinstance(each, StreamGap) for each in said)
    assert (node.statistics.late, node.statistics.rejected) == (0, {})


def test_samples_that_come_again_under_new_numbers_are_no_evidence(blocks) -> None:
    """A logger that hangs and sends its last buffer again and again."""
    hung = [replace(b, samples=blocks[39].samples) if b.sequence >= 40 else b for b in blocks]
    node = IdentificationNode(SETTINGS)
    said = answers(node, hung)
    assert not any(isinstance(each, ModalEstimate) for each in said)
    assert node.statistics.rejected[REPEATED] == len(blocks) - 40


def test_block_numbers_that_jump_where_no_sample_is_missing_are_warned_of(blocks) -> None:
    jumped = [replace(b, sequence=b.sequence + 1000 * (b.sequence >= 30)) for b in blocks]
    node = IdentificationNode(SETTINGS)
    said = answers(node, jumped)
    assert [type(each) for each in said] == [ModalEstimate, ModalEstimate]
    (warning,) = node.statistics.warnings
    assert warning.code == "sequence-jump"


def test_a_unit_of_very_many_channels_is_refused_in_one_line_and_counted(blocks) -> None:
    wide = [
        replace(b, unit="wide", samples=np.tile(b.samples, (1, LimitSettings().channels)))
        for b in blocks[:3]
    ]
    node = IdentificationNode(SETTINGS)
    answers(node, [*blocks, *wide])
    assert node.statistics.rejected == {TOO_MANY_CHANNELS: 3}
    assert "200 channels; a unit has at most 100" in node.statistics.warnings[0].text


def test_a_new_session_of_few_blocks_is_let_in_when_its_end_is_announced(blocks) -> None:
    short = [replace(b, session="s2") for b in blocks[:3]]
    node = IdentificationNode(SETTINGS)
    heard = [*blocks[:70], *short]
    said = answers(node, heard)
    for end in (
        StreamEnd("t1", "tower", "s1", blocks[69].end_ns, 70),
        StreamEnd("t1", "tower", "s2", short[-1].end_ns, 3),
    ):
        said += node.handle(end)
    rejected = [each for each in said if isinstance(each, WindowRejected)]
    assert [(each.code, each.origins[0].session) for each in rejected] == [
        ("short", "s1"),
        ("short", "s2"),
    ]
    assert not node.statistics.rejected


# ---- blocks beside each other whose order was mixed ---------------------------------------------


def admitted(admission: BlockAdmission, *blocks: AccelerationBlock) -> list[int]:
    return [each.sequence for block in blocks for each in admission.admit(block).blocks]


def test_the_first_block_of_a_session_that_one_of_the_last_overtakes_is_not_lost() -> None:
    admission = BlockAdmission()
    new = [replace(message(n), session="session-2") for n in range(8)]
    new = [replace(each, start_ns=each.start_ns + 60 * NANOSECONDS) for each in new]
    taken = admitted(admission, message(0), message(1), new[0], message(2), *new[1:])
    assert taken == [0, 1, 2, 0, 1, 2, 3, 4, 5, 6, 7]
    assert admission.refused.total() == 0


def test_two_blocks_after_a_clock_step_may_come_in_any_order() -> None:
    admission = BlockAdmission()
    step = 3600 * NANOSECONDS
    later = [replace(message(n), start_ns=message(n).start_ns + step) for n in range(40, 50)]
    taken = admitted(admission, message(0), later[1], later[0], *later[2:])
    assert taken == [0, *range(40, 50)]


@pytest.mark.parametrize(
    ("limits", "code"),
    [
        (LimitSettings(channels=7), "too-many-channels"),
        (LimitSettings(sampling_rate=39.0), "sampled-too-fast"),
        (LimitSettings(block_megabytes=0.001), "block-too-large"),
        (LimitSettings(window_values=1000.0), "window-too-large"),
    ],
)
def test_a_block_beyond_a_limit_is_counted_and_not_identified(
    limits: LimitSettings, code: str
) -> None:
    node = IdentificationNode(SETTINGS, limits=limits)
    assert list(node.handle(message(0))) == []
    assert node.statistics.rejected == {code: 1}


def test_a_limit_that_allows_nothing_is_one_line() -> None:
    with pytest.raises(LimitError, match=r"\[limits\] units is 0; it must be > 0"):
        LimitSettings(units=0)


def test_limits_are_keys_of_a_scenario() -> None:
    text = """
    [limits]
    channels = 7
    block_megabytes = 0.5
    cpu_seconds = 3.0
    units = 2
    turbines = 3
    window_values = 1e6
    """
    limits = scenario_from_text(text, "own.toml").limits
    assert limits == LimitSettings(
        channels=7,
        block_megabytes=0.5,
        cpu_seconds=3.0,
        window_values=1e6,
        units=2,
        turbines=3,
    )


# ---- a boot that changes, and two devices under one name ----------------------------------------


@pytest.fixture
def digests(identified_once: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows that cost nothing: what is asked is which samples they have.

    In place of what `identified_once` puts there, whichever test of the module comes first.
    """
    identify_by_digests(monkeypatch.setattr)


def kept_books(heard: list[Message]) -> tuple[Books, list[ModalEstimate | WindowRejected]]:
    """The books of a run, and its windows."""
    node, books = IdentificationNode(SETTINGS), Books()
    windows = []
    for each in heard:
        books.handle(each)
        for answer in node.handle(each):
            books.handle(answer)
            if isinstance(answer, ModalEstimate | WindowRejected):
                windows.append(answer)
    refused = tuple(MessageCount(*each) for each in node.statistics.rejected.items())
    books.handle(NodeStatus("t1", "identification", 0, "stopped", -1, refused=refused))
    return books, windows


@pytest.mark.usefixtures("digests")
@pytest.mark.parametrize("at", [60, 100])
@pytest.mark.parametrize("rate", [RATE / 2, 2 * RATE])
def test_a_rate_that_changes_inside_a_boot_costs_the_window_that_it_lies_in(at, rate) -> None:
    """From there on windows begin with the first sample of the new rate."""
    plain = cut(np.random.default_rng(1).normal(size=(5000, 2)))[:230]
    heard: list[Message] = [LAYOUT]
    first = 0
    for block in plain:
        if block.sequence >= at:
            twice = np.repeat(block.samples, 2, axis=0)[:: 1 if rate > RATE else 4]
            block = replace(block, sampling_rate=rate, samples=twice, first_sample=first)
        first += len(block.samples)
        heard.append(block)
    books, windows = kept_books(heard)
    spans = [(each.start_ns - START, each.end_ns - START) for each in windows]
    assert [s // NANOSECONDS for s, _ in spans] == [0, *[60] * (at == 100), at, at + 60]
    assert [isinstance(each, WindowRejected) for each in windows].count(True) == (at == 100)
    assert not books.violations()


@pytest.mark.usefixtures("digests")
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("name", ["s1", "s2"])
def test_of_two_devices_under_one_unit_each_block_has_one_fate(seed: int, name: str) -> None:
    """They send in bursts, as after a cut; the first that is heard is used from then on."""
    rng = np.random.default_rng(seed)
    later, bursts = int(rng.choice([3, 7, 37, 90])), rng.choice([1, 2, 8, 30], size=2)
    one, other = (cut(rng.normal(size=(4900, 2)))[:245] for _ in range(2))
    pause = later * NANOSECONDS
    other = [replace(b, session=name, start_ns=b.start_ns + pause) for b in other[:-later]]
    sent = [
        ((block.sequence // burst + 1) * burst + delay, number, block)
        for number, (blocks, delay, burst) in enumerate(
            [(one, 0, int(bursts[0])), (other, later, int(bursts[1]))]
        )
        for block in blocks
    ]
    heard = [block for *_, block in sorted(sent, key=lambda each: (*each[:2], each[2].sequence))]
    ends = [StreamEnd("t1", "tower", b[0].session, b[-1].end_ns, len(b)) for b in (one, other)]
    books, windows = kept_books([LAYOUT, *heard, *ends])
    assert not books.violations()
    units = books.as_json()["units"]
    assert sorted(each["recorded"] for each in units) == sorted([len(one), len(other)])
    assert not any(each["repeated"] or each["lost"] for each in units)
    codes = set(books.as_json()["refused"]["identification"])
    assert {"second-device", "does-not-follow", "other-session"} & codes
    assert "not used (" in books.line
    identified = [each for each in windows if isinstance(each, ModalEstimate)]
    assert len(identified) >= (len(one) - later) // 60 - 2
    assert len({each.origins for each in windows}) == len(windows)


@pytest.mark.usefixtures("digests")
@pytest.mark.parametrize("killed_at", [103, 107, 150, 163, 200])
def test_a_rate_that_changed_is_gone_on_with_after_a_restart(
    tmp_path: Path, killed_at: int
) -> None:
    heard: list[Message] = [LAYOUT]
    for block in cut(np.random.default_rng(1).normal(size=(5000, 2)))[:240]:
        if block.sequence >= 100:
            first = 2000 + (block.sequence - 100) * 10
            block = replace(
                block, sampling_rate=RATE / 2, samples=block.samples[::2], first_sample=first
            )
        heard.append(block)

    def fates(restarts: bool) -> dict[object, str]:
        def node() -> IdentificationNode:
            store = SnapshotFolder(tmp_path / str(restarts), "identification")
            return IdentificationNode(SETTINGS, store=store, past=list(recorded))

        recorded: list[Message] = []
        running = node()
        for number, each in enumerate(heard):
            if restarts and number == killed_at:
                running = node()
            recorded.append(each)
            recorded.extend(running.handle(each))
        windows = [e for e in recorded if isinstance(e, ModalEstimate | WindowRejected)]
        return {
            each.origins: f"{each.modes[0].frequency}"
            if isinstance(each, ModalEstimate)
            else each.code
            for each in windows
        }

    calm = fates(restarts=False)
    assert [origins[0].first_sample for origins in calm] == [0, 1200, 2000, 2600]
    assert fates(restarts=True) == calm
