"""Two acquisition units on one tower are identified as one.

lower    |0   |1   |2   | …      channels 1 to 3
upper    |0   |1   |▒▒▒▒| …      channels 4 and 5, with a clock of its own
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Message, ModalEstimate, StreamGap, WindowRejected
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.settings import OmaSettings
from pipeline.runtime.source_feed import with_end
from pipeline.state.books import Books
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.simulation.acquisition_units import (
    UnitError,
    UnitSettings,
    read_by_units,
    unit_layouts,
)
from tests.pipeline.histories import identify_by_digests
from tests.pipeline.oma.conftest import KnownStructure, structure

pytestmark = pytest.mark.usefixtures("identified_once")

RATE = 20.0
WINDOW = 300  # [s]
ONE = WINDOW + 4  # blocks that hold one window on every clock
ELEVATIONS = (20.0, 40.0, 60.0, 80.0, 100.0)
LAYOUT = SensorLayout(
    "five",
    "t",
    "tower",
    tuple(Accelerometer(f"z{z:g}", z, FORE_AFT) for z in ELEVATIONS),
)
SETTINGS = OmaSettings(window_duration=WINDOW, hop=WINDOW)


def two_units(**upper: float) -> tuple[UnitSettings, ...]:
    return (
        UnitSettings("lower", ELEVATIONS[:3]),
        UnitSettings("upper", ELEVATIONS[3:], **upper),
    )


@pytest.fixture(scope="module")
def tower() -> KnownStructure:
    """A clamped tower of eight modes, 0.4 to 8 Hz."""
    frequencies = [0.4, 1.1, 1.9, 2.8, 3.9, 5.1, 6.4, 7.8]
    shapes = np.random.default_rng(4).uniform(-1, 1, (8, 5))
    return structure(frequencies, 0.008, shapes)


@pytest.fixture(scope="module")
def blocks(tower: KnownStructure) -> list[AccelerationBlock]:
    """610 s of the whole tower, a second each."""
    samples = tower.ambient_response(sampling_rate=RATE, duration=610.0, seed=6)
    size = round(RATE)
    return [
        AccelerationBlock("t", "tower", "s", "five", i, i * size, i * NANOSECONDS, RATE, part)
        for i, part in enumerate(np.split(samples.astype(np.float32), 610))
    ]


@pytest.fixture
def digests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows that cost nothing: what is asked is which samples they have."""
    identify_by_digests(monkeypatch.setattr)


def answers(
    blocks: list[AccelerationBlock],
    units: tuple[UnitSettings, ...],
    *,
    lost: tuple[str, range] | None = None,
) -> list[Message]:
    """Everything that the identification says of the units' blocks."""
    node = IdentificationNode(SETTINGS)

    def messages() -> Iterator[Message]:
        yield from unit_layouts(LAYOUT, units)
        for block in read_by_units(blocks, LAYOUT, units):
            if lost is None or block.unit != lost[0] or block.sequence not in lost[1]:
                yield block

    return [a for message in with_end(messages()) for a in node.handle(message)]


def estimates(said: list[Message]) -> list[ModalEstimate]:
    return [message for message in said if isinstance(message, ModalEstimate)]


def codes(estimate: ModalEstimate) -> set[str]:
    return {warning.code for warning in estimate.warnings}


def assert_known_modes(estimate: ModalEstimate, tower: KnownStructure) -> None:
    columns = [LAYOUT.channel_names.index(name) for name in estimate.channels]
    for frequency, shape in zip(tower.frequencies[1:], tower.shapes[1:], strict=True):
        mode = min(estimate.modes, key=lambda m: abs(m.frequency - frequency))
        assert abs(mode.frequency - frequency) < max(4 * mode.frequency_std, 0.002 * frequency)
        mac = modal_assurance_criterion(mode.shape[None], shape[None, columns])[0, 0]
        assert mac > 0.98


def test_two_units_give_one_estimate_with_all_channels(blocks, tower) -> None:
    for estimate in estimates(answers(blocks[:ONE], two_units(start=0.4))):
        assert estimate.channels == LAYOUT.channel_names
        assert not codes(estimate) & {"unit-offset", "clock-drift", "missing-unit"}
        assert_known_modes(estimate, tower)


def test_drift_is_taken_out_by_the_stamps_and_said(blocks, tower) -> None:
    for estimate in estimates(answers(blocks[:ONE], two_units(clock_drift=200.0))):
        assert "clock-drift" in codes(estimate)
        assert "unit-offset" not in codes(estimate)
        assert_known_modes(estimate, tower)


def test_stamps_that_are_late_are_found_by_the_phase_of_the_modes(blocks) -> None:
    (first,) = estimates(answers(blocks[:ONE], two_units(clock_offset=3e-3)))
    (doubt,) = [warning for warning in first.warnings if warning.code == "unit-offset"]
    assert float(doubt.text.split(" are ")[1].split(" ± ")[0]) == pytest.approx(3.0, abs=0.6)


def test_stamps_late_by_more_than_five_milliseconds_reject_the_window(blocks) -> None:
    said = answers(blocks[:ONE], two_units(clock_offset=12e-3))
    rejected = [message for message in said if isinstance(message, WindowRejected)]
    assert rejected[0].code == "unsynchronised-units"
    assert not estimates(said)


LOST = ("upper", range(100, 140))


@pytest.fixture(scope="module")
def partly_lost(blocks: list[AccelerationBlock]) -> list[Message]:
    """What is said where forty blocks of one of two units are lost."""
    return answers(blocks, two_units(), lost=LOST)


def test_a_missing_unit_leaves_a_window_with_fewer_channels(partly_lost, tower) -> None:
    said = partly_lost
    without, with_it = estimates(said)
    assert without.channels == LAYOUT.channel_names[:3]
    (doubt,) = [warning for warning in without.warnings if warning.code == "missing-unit"]
    assert doubt.text.startswith("unit upper is missing for 4")
    assert_known_modes(without, tower)
    assert with_it.channels == LAYOUT.channel_names
    assert_known_modes(with_it, tower)
    names = {round(mode.frequency, 1): mode.name for mode in without.modes}
    for mode in with_it.modes:  # modes keep their names whatever the channels
        assert names.get(round(mode.frequency, 1), mode.name) == mode.name
    (gap,) = [message for message in said if isinstance(message, StreamGap)]
    assert (gap.unit, gap.n_blocks) == ("upper", 40)


def test_a_long_gap_of_a_unit_is_not_laid_out_and_changes_nothing(
    blocks, partly_lost, monkeypatch
) -> None:
    whole = estimates(partly_lost)
    monkeypatch.setattr("pipeline.oma.windows.unit_alignment.LONGEST_HELD", 100)  # 800 are missing
    apart = estimates(answers(blocks, two_units(), lost=LOST))
    for ours, theirs in zip(apart, whole, strict=True):
        assert ours.channels == theirs.channels
        np.testing.assert_allclose(
            [mode.frequency for mode in ours.modes],
            [mode.frequency for mode in theirs.modes],
            rtol=1e-9,
        )


@pytest.mark.usefixtures("digests")
def test_samples_that_all_units_miss_at_once_reject_the_window(blocks) -> None:
    node = IdentificationNode(SETTINGS)
    for layout in unit_layouts(LAYOUT, two_units()):
        list(node.handle(layout))
    heard = [
        b for b in read_by_units(blocks, LAYOUT, two_units()) if b.sequence not in range(100, 140)
    ]
    said = [answer for message in with_end(heard) for answer in node.handle(message)]
    rejected = [message.code for message in said if isinstance(message, WindowRejected)]
    assert "gap" in rejected
    (after,) = estimates(said)
    assert after.channels == LAYOUT.channel_names


def test_a_still_channel_of_one_of_two_alike_units_is_called_after_its_unit(blocks) -> None:
    node = IdentificationNode(SETTINGS)
    said: list[Message] = []
    for layout in unit_layouts(LAYOUT, two_units()):
        alike = tuple(replace(c, name=f"x{n}") for n, c in enumerate(layout.channels))
        list(node.handle(replace(layout, channels=alike)))
    for block in read_by_units(blocks[:ONE], LAYOUT, two_units()):
        samples = block.samples.copy()
        if block.unit == "upper" and block.sequence >= 200:
            samples[:, 1] = samples[0, 1]
        said += node.handle(replace(block, samples=samples))
    (rejected,) = [message for message in said if isinstance(message, WindowRejected)]
    assert rejected.code == "constant"
    assert rejected.reason.startswith("upper/x1 stands still from 2")


@pytest.mark.usefixtures("digests")
def test_the_order_in_which_units_arrive_does_not_matter(blocks) -> None:
    units = two_units(start=0.4, clock_drift=50.0)
    node = IdentificationNode(SETTINGS)
    for layout in unit_layouts(LAYOUT, units):
        list(node.handle(layout))
    delivered = list(with_end(read_by_units(blocks[:ONE], LAYOUT, units)))
    shuffled = [m for second in range(0, len(delivered), 4) for m in delivered[second:][:4][::-1]]
    said = estimates([a for message in shuffled for a in node.handle(message)])
    for ours, theirs in zip(said, estimates(answers(blocks[:ONE], units)), strict=True):
        assert [m.frequency for m in ours.modes] == [m.frequency for m in theirs.modes]


@pytest.mark.usefixtures("digests")
def test_layouts_that_come_after_the_first_blocks_change_no_window(blocks) -> None:
    """Layouts travel on keys of their own: over a network either may come first."""
    units = two_units(start=0.4)
    lower, upper = unit_layouts(LAYOUT, units)
    delivered = list(with_end(read_by_units(blocks[:ONE], LAYOUT, units)))
    node = IdentificationNode(SETTINGS)
    heard = [lower, *delivered[:9], upper, *delivered[9:]]
    said = [a for message in heard for a in node.handle(message)]
    whole = answers(blocks[:ONE], units)
    for ours, theirs in zip(estimates(said), estimates(whole), strict=True):
        assert ours.start_ns == theirs.start_ns
        assert [m.frequency for m in ours.modes] == [m.frequency for m in theirs.modes]
    assert fates(said) == fates(whole)
    assert (node.statistics.late, node.statistics.duplicate) == (0, 0)


def fates(said: list[Message]) -> list[tuple[object, str]]:
    windows = [each for each in said if isinstance(each, ModalEstimate | WindowRejected)]
    return [(each.origins, getattr(each, "code", "")) for each in windows]


@pytest.mark.usefixtures("digests")
@pytest.mark.parametrize("layouts_at", [(0, 9), (5, 2), (3, 40), (30, 30)])
def test_every_window_has_one_fate_whenever_the_layouts_come(blocks, layouts_at) -> None:
    """Books count a window once: blocks that go on in a joined session end none."""
    units = two_units(start=0.4)
    heard: list[Message] = list(with_end(read_by_units(blocks[:130], LAYOUT, units)))
    for place, layout in sorted(zip(layouts_at, unit_layouts(LAYOUT, units), strict=True), key=str):
        heard.insert(place, layout)
    node, books = IdentificationNode(replace(SETTINGS, window_duration=60, hop=60)), Books()
    said = [a for message in heard for a in node.handle(message)]
    for message in (*heard, *said):
        books.handle(message)
    assert [code for _, code in fates(said)] == ["", "", "short"]
    firsts = {origin.first_sample for origin in fates(said)[0][0]}
    assert firsts == {0, 8}  # upper starts 0.4 s after lower
    assert not books.violations()
    assert not node.statistics.rejected


@pytest.mark.usefixtures("digests")
def test_blocks_of_joined_units_stay_counted_when_their_session_ends(blocks) -> None:
    units = two_units()
    heard = list(with_end(read_by_units(blocks[:130], LAYOUT, units)))
    late, again = heard[40], heard[100]
    sent = [*heard[:40], *heard[41:90], late, *heard[90:102], again, *heard[102:]]
    node = IdentificationNode(replace(SETTINGS, window_duration=60, hop=60))
    for message in (*unit_layouts(LAYOUT, units), *sent):
        list(node.handle(message))
    assert (node.statistics.late, node.statistics.duplicate) == (1, 1)


@pytest.mark.usefixtures("digests")
@pytest.mark.parametrize("n_strays", [1, 10])
def test_blocks_of_a_unit_without_a_layout_end_no_window(blocks, n_strays: int) -> None:
    """One name that is spelt wrong must not end the window of the unit that is there."""
    node = IdentificationNode(replace(SETTINGS, window_duration=60, hop=60))
    plain = IdentificationNode(replace(SETTINGS, window_duration=60, hop=60))
    list(node.handle(LAYOUT)), list(plain.handle(LAYOUT))
    said, whole = [], []
    for block in blocks[:125]:
        whole += plain.handle(block)
        said += node.handle(block)
        if block.sequence in range(20, 20 + n_strays):
            said += node.handle(replace(block, unit="towre"))
    assert fates(said) == fates(whole)
    assert (n_strays == 10) == bool(node.statistics.rejected)  # the rest of them wait


@pytest.mark.usefixtures("digests")
def test_a_unit_without_a_layout_is_followed_when_the_other_falls_silent(blocks) -> None:
    node = IdentificationNode(replace(SETTINGS, window_duration=60, hop=60))
    said = []
    for block in blocks[:90]:
        said += node.handle(replace(block, unit="first"))
    for block in blocks[90:220]:
        number = block.sequence - 90
        second = replace(block, unit="second", sequence=number, first_sample=20 * number)
        said += node.handle(second)
    windows = [(origins[0].unit, origins[0].first_sample, code) for origins, code in fates(said)]
    assert windows == [
        ("first", 0, ""),
        ("first", 1200, "short"),
        ("second", 0, ""),
        ("second", 1200, ""),
    ]
    assert not node.statistics.rejected


def test_heights_without_a_unit_are_one_clear_line() -> None:
    with pytest.raises(UnitError, match=r"sensors at 100 m are read by no unit"):
        unit_layouts(LAYOUT, (UnitSettings("a", ELEVATIONS[:4]),))


@pytest.mark.usefixtures("digests")
def test_a_unit_whose_rate_cannot_be_joined_is_refused_counted_and_told(blocks) -> None:
    """One at a time; five on end are a unit that has begun anew, which is followed."""
    whole = estimates(answers(blocks[:ONE], two_units()))
    node = IdentificationNode(SETTINGS)
    heard: list[Message] = [*unit_layouts(LAYOUT, two_units())]
    for block in read_by_units(blocks[:ONE], LAYOUT, two_units()):
        heard.append(block)
        if block.unit == "upper" and block.sequence % 50 == 20:
            heard.append(replace(block, session="slow", sampling_rate=1e-3))
    said = estimates([a for message in with_end(heard) for a in node.handle(message)])
    for ours, theirs in zip(said, whole, strict=True):
        assert [m.frequency for m in ours.modes] == [m.frequency for m in theirs.modes]
    (doubt,) = node.statistics.warnings
    assert doubt.code == "unfit-blocks"
    assert "the last of unit upper of t: 0.001 Hz, which cannot be joined" in doubt.text


def test_a_unit_that_goes_on_at_a_far_lower_rate_is_followed_after_five_blocks(blocks) -> None:
    """The grid has the lowest rate; one that is far below it needs a grid of its own."""
    node = IdentificationNode(SETTINGS)
    said: list[Message] = []
    for layout in unit_layouts(LAYOUT, two_units()):
        list(node.handle(layout))
    for block in read_by_units(blocks, LAYOUT, two_units()):
        if block.unit == "upper" and block.sequence >= 100:
            block = replace(block, session="slow", sampling_rate=4.0, samples=block.samples[::5])
            block = replace(block, first_sample=4 * (block.sequence - 100))
        said += node.handle(block)
    (estimate,) = estimates(said)
    assert estimate.channels == LAYOUT.channel_names
    assert all(mode.frequency < 2.0 for mode in estimate.modes)  # of what 4 Hz can show
    assert estimate.start_ns == pytest.approx(100 * NANOSECONDS, abs=6 * NANOSECONDS)


def test_blocks_of_other_channels_than_their_units_layout_are_counted(blocks) -> None:
    node = IdentificationNode(SETTINGS)
    for layout in unit_layouts(LAYOUT, two_units()):
        list(node.handle(layout))
    for block in read_by_units(blocks[:10], LAYOUT, two_units()):
        if block.unit == "upper":
            block = replace(block, samples=block.samples[:, :1])
        list(node.handle(block))
    (doubt,) = node.statistics.warnings
    assert doubt.text.startswith("10 blocks")
    assert doubt.text.endswith("1 channels where its unit's layout names 2")
