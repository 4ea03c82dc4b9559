"""A clock that was wrong costs the windows that it spans, each with a reason, and no other.

samples   |—— 0 ——|—— 1 ——|—— 2 ——|—— 3 ——|     of one boot
stamps    2036 2036 2024 2024 2024 …            window 0 is rejected, 1 is answered
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Message, ModalEstimate, StabilisationDiagram, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.runtime.source_feed import with_end
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.acquisition.resampling import interpolated
from sensors.simulation.acquisition_units import UnitSettings, read_by_units, unit_layouts
from tests.benchmarks import drift
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, SETTINGS, cut
from tests.pipeline.oma.conftest import structure

pytestmark = pytest.mark.usefixtures("identified_once")

YEAR = 365.25 * 86_400.0  # [s]
WINDOW = 60  # [s]
Stamps = Callable[[int], float]  # block → how far its stamp is off [s]


@pytest.fixture(scope="module")
def blocks() -> list[AccelerationBlock]:
    """Five minutes of two channels in blocks of one second."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    return cut(known.ambient_response(sampling_rate=RATE, duration=300.0, seed=2))


def stamped(blocks: list[AccelerationBlock], off: Stamps) -> list[AccelerationBlock]:
    return [replace(b, start_ns=b.start_ns + round(off(b.sequence)) * NANOSECONDS) for b in blocks]


def answers(messages: list[Message]) -> list[Message]:
    """What is said of windows and gaps."""
    node = IdentificationNode(SETTINGS)
    said = [a for message in with_end(messages) for a in node.handle(message)]
    assert not node.statistics.rejected
    assert node.statistics.late == 0
    return [each for each in said if not isinstance(each, StabilisationDiagram)]


def fates(said: list[Message]) -> list[str]:
    return [e.code if isinstance(e, WindowRejected) else "" for e in said]


@pytest.mark.parametrize("size", [1.0, -1.0, 1800.0, -1800.0, -7200.0, YEAR, -20 * YEAR, 12 * YEAR])
@pytest.mark.parametrize("at", [10, 60, 70, 120])
def test_a_step_costs_the_window_that_it_lies_in(blocks, size: float, at: int) -> None:
    said = answers([LAYOUT, *stamped(blocks[: 3 * WINDOW], lambda k: size * (k >= at))])
    spanned = [] if at % WINDOW == 0 else [at // WINDOW]
    assert fates(said) == ["clock-step" if k in spanned else "" for k in range(3)]
    assert [each.origins[0].first_sample for each in said] == [1200 * k for k in range(3)]
    for each in said:
        assert isinstance(each, ModalEstimate | WindowRejected)
        assert each.end_ns - each.start_ns == WINDOW * NANOSECONDS


@pytest.mark.parametrize("blocks_before", [10, 60, 75])
def test_stamps_of_2036_at_boot_cost_the_windows_that_hold_the_step(blocks, blocks_before) -> None:
    said = answers([LAYOUT, *stamped(blocks, lambda k: 12 * YEAR * (k < blocks_before))])
    assert fates(said).count("clock-step") == (blocks_before % WINDOW > 0)
    assert fates(said).count("") == 5 - (blocks_before % WINDOW > 0)


@pytest.mark.parametrize("size", [-7200.0, -1800.0, 12 * YEAR])
def test_a_replay_answers_windows_as_the_live_run_did_whatever_the_clock_did(blocks, size) -> None:
    """A replay that sorted by stamps called the blocks before a step back late."""
    live = [LAYOUT, *stamped(blocks, lambda k: size * (k >= 70))]
    again = answers(drift.replayed(live))
    assert [encode(each) for each in again] == [encode(each) for each in answers(live)]


def test_seconds_that_are_missing_by_the_stamps_are_not_trusted(blocks) -> None:
    """Every tenth second is missing; nothing but the stamps shows it."""
    said = answers([LAYOUT, *stamped(blocks, lambda k: k // 9)])
    assert set(fates(said)) == {"clock-step"}
    assert isinstance(said[0], WindowRejected)
    assert "samples are missing" in said[0].reason


def by_a_converter_that_is_slow(blocks: list[AccelerationBlock], by: float) -> list[Message]:
    """The same motion, each sample later than it should be taken [-]; right stamps."""
    motion = np.concatenate([each.samples for each in blocks]).astype(np.float64)
    size = len(blocks[0].samples)
    numbers = np.arange(int(len(motion) / (1 + by)) // size * size)
    taken = interpolated(motion, numbers * (1 + by)).astype(np.float32)
    start_ns = blocks[0].start_ns
    return [
        replace(b, samples=own, start_ns=start_ns + round((b.start_ns - start_ns) * (1 + by)))
        for b, own in zip(blocks, np.split(taken, len(taken) // size), strict=False)
    ]


@pytest.mark.parametrize("ppm", [-2500.0, 100.0, 2500.0])
def test_a_drift_that_the_stamps_show_is_resampled_out(blocks, ppm: float) -> None:
    """The windows hold the same seconds of the same motion, whatever took them."""
    drifting = by_a_converter_that_is_slow(blocks, ppm * 1e-6)
    said, plain = answers([LAYOUT, *drifting]), answers([LAYOUT, *blocks])
    assert fates(said[:4]) == [""] * 4
    for ours, theirs in zip(said[:4], plain, strict=False):
        assert isinstance(ours, ModalEstimate)
        assert isinstance(theirs, ModalEstimate)
        assert "clock-drift" in {warning.code for warning in ours.warnings}
        for mode, other in zip(ours.modes, theirs.modes, strict=True):
            apart = mode.frequency - other.frequency, mode.damping_ratio - other.damping_ratio
            assert abs(apart[0]) < 0.1 * other.frequency_std
            assert abs(apart[1]) < 0.1 * other.damping_ratio_std
            assert mode.frequency_std == pytest.approx(other.frequency_std, rel=0.05)


@pytest.mark.parametrize("size", [0.05, -0.4])
def test_a_clock_that_is_set_by_less_than_half_a_second_changes_no_frequency(blocks, size) -> None:
    """Its window is kept, the step is named, and it is not taken for a drift."""
    set_once = [
        replace(b, start_ns=b.start_ns + round(size * NANOSECONDS) * (b.sequence >= 90))
        for b in blocks
    ]
    said, plain = answers([LAYOUT, *set_once]), answers([LAYOUT, *blocks])
    for window, (ours, theirs) in enumerate(zip(said, plain, strict=True)):
        assert isinstance(ours, ModalEstimate)
        assert isinstance(theirs, ModalEstimate)
        assert ("clock-step" in {each.code for each in ours.warnings}) == (window == 1)
        assert "clock-drift" not in {each.code for each in ours.warnings}
        for mode, other in zip(ours.modes, theirs.modes, strict=True):
            assert mode.frequency == pytest.approx(other.frequency, rel=1e-6)


ELEVATIONS = (20.0, 60.0)
FIVE = SensorLayout(
    "two", "t", "tower", tuple(Accelerometer(f"z{z:g}", z, FORE_AFT) for z in ELEVATIONS)
)
UNITS = (UnitSettings("lower", ELEVATIONS[:1]), UnitSettings("upper", ELEVATIONS[1:]))


def of_two_units(blocks: list[AccelerationBlock], **off: Stamps) -> list[Message]:
    """The same tower read by two units, whose stamps are off."""
    whole = [replace(b, turbine="t", start_ns=b.start_ns) for b in blocks]
    return [
        *unit_layouts(FIVE, UNITS),
        *(
            replace(
                b, start_ns=b.start_ns + round(off.get(b.unit, lambda _: 0)(b.sequence)) * 10**9
            )
            for b in read_by_units(whole, FIVE, UNITS)
        ),
    ]


@pytest.mark.parametrize("size", [12 * YEAR, -12 * YEAR, 1800.0, -7200.0])
def test_a_step_of_both_units_at_once_begins_another_session(blocks, size: float) -> None:
    """On today's main blocks of 2036 silence the turbine for good."""

    def off(k: int) -> float:
        return size * (k >= 70)

    said = answers(of_two_units(blocks, lower=off, upper=off))
    good = [each for each in said if isinstance(each, ModalEstimate)]
    after = [each for each in good if each.origins[0].first_sample >= 70 * RATE]
    assert len(good) - len(after) == 1
    assert len(after) >= 2  # of 230 s that are left, begun with the first blocks after the step
    assert all(set(each.channels) == {"z20", "z60"} for each in good)
    assert all(each.end_ns > each.start_ns for each in said)


@pytest.mark.parametrize("size", [12 * YEAR, -12 * YEAR, 600.0, -20.0])
def test_a_step_of_one_unit_leaves_it_out_until_it_agrees_again(blocks, size: float) -> None:
    said = answers(of_two_units(blocks, upper=lambda k: size * (70 <= k < 130)))
    good = [each for each in said if isinstance(each, ModalEstimate)]
    channels = [each.channels for each in good]
    assert channels[0] == channels[-1] == ("z20", "z60")
    assert channels.count(("z20",)) == 2
    codes = {warning.code for each in good for warning in each.warnings}
    assert {"missing-unit", "clock-step"} <= codes


def test_a_unit_that_starts_in_2036_does_not_take_the_others_along(blocks) -> None:
    said = answers(of_two_units(blocks, upper=lambda k: 12 * YEAR * (k < 100)))
    good = [each for each in said if isinstance(each, ModalEstimate)]
    assert len(good) >= 4
    assert good[-1].channels == ("z20", "z60")


@pytest.mark.nightly
def test_a_converter_that_is_off_by_what_stamps_show_costs_the_tower_little_and_replays() -> None:
    """A pair of `tests.benchmarks drift`: one response, two converters; live and recorded."""
    (plain,) = drift.estimates_of(drift.measured(8104, 0.0))
    blocks = drift.measured(8104, 2500.0)
    (live,) = drift.estimates_of(blocks)
    assert [encode(each) for each in drift.estimates_of(drift.replayed(blocks))] == [encode(live)]
    frequencies = np.array([mode.frequency for mode in live.modes])
    shifts = [
        np.abs(frequencies - mode.frequency).min() / mode.frequency_std for mode in plain.modes
    ]
    assert np.median(shifts) < 0.2
    assert 0.9 < len(live.modes) / len(plain.modes) < 1.1
