"""Windows end after they begin, whatever a unit's clock does.

samples   |0 ——— window 0 ——— |24 000 ——— window 1 ——— |48 000
clock      T                                           T + 26 s
"""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.oma.windows.windowing import BlockOrder, MissingSamples, WindowCutter
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.example_messages import SAMPLING_RATE, START_NS, block


def test_no_window_ends_before_it_began_where_the_clock_was_set_back() -> None:
    first = block(0)
    later_ns = START_NS + 26 * NANOSECONDS
    later = replace(block(1), first_sample=round(1200 * SAMPLING_RATE), start_ns=later_ns)
    between = later.first_sample - len(first.samples)
    gap = MissingSamples(len(first.samples), between, 1, 0, first.end_ns, later_ns)
    cutter = WindowCutter(window_duration=600.0, hop=600.0)
    windows = [window for piece in (first, gap, later) for window in cutter.push(piece)]
    windows += cutter.finish()
    assert [window.index for window in windows] == [0, 1, 2]
    assert all(window.start_ns <= window.end_ns for window in windows)
    assert [window.end_ns - window.start_ns for window in windows[:2]] == [600 * NANOSECONDS] * 2


def test_a_block_that_is_late_by_less_than_the_lateness_is_waited_for() -> None:
    order = BlockOrder(lateness=5.0)
    given = [each for number in (0, 2, 3, 1, 4) for each in order.push(block(number))]
    assert [each.first_sample for each in given] == [40 * number for number in range(5)]
    assert not any(isinstance(each, MissingSamples) for each in given)
    assert order.unused["late"] == 0


def test_a_gap_has_as_many_blocks_as_are_missing() -> None:
    order = BlockOrder(lateness=5.0)
    given = [each for number in (0, 4, *range(5, 12)) for each in order.push(block(number))]
    (gap,) = (each for each in given if isinstance(each, MissingSamples))
    assert (gap.first_sequence, gap.n_blocks, gap.n_samples) == (1, 3, 120)


def test_what_comes_again_is_no_late_block_however_far_back_it_lies() -> None:
    """As after a restart, when minutes of blocks are sent again."""
    order = BlockOrder(lateness=5.0)
    for number in (*range(4), *range(6, 20)):
        list(order.push(block(number)))
    for number in (0, 1, 2, 7, 8, 19):
        assert not list(order.push(block(number)))
    assert order.unused == {"duplicate": 6}
    for number in (4, 5):
        assert not list(order.push(block(number)))
    assert order.unused == {"duplicate": 6, "late": 2}


TONES = (0.31, 2.7, 11.0)  # [Hz]
SAMPLES = round(60 * SAMPLING_RATE)  # of a window


def converted(ppm: float, n_seconds: int) -> list[AccelerationBlock]:
    """Blocks of 40 samples of three tones by a converter that is slow by so much; stamps are
    right."""
    period = (1 + 1e-6 * ppm) / SAMPLING_RATE
    times = period * np.arange(40 * n_seconds)
    tones = np.column_stack([np.sin(2 * np.pi * f * times) for f in TONES])
    return [
        replace(
            block(0),
            sequence=number,
            first_sample=40 * number,
            start_ns=START_NS + round(40 * number * period * NANOSECONDS),
            samples=tones[40 * number : 40 * (number + 1)].astype(np.float32),
        )
        for number in range(n_seconds)
    ]


def true_samples(start: float, n: int = SAMPLES) -> np.ndarray:
    """What a converter at its rate takes from a time on [s]."""
    times = start + np.arange(n) / SAMPLING_RATE
    return np.column_stack([np.sin(2 * np.pi * f * times) for f in TONES])


@pytest.mark.parametrize("ppm", [-2500.0, -100.0, 100.0, 2500.0])
@pytest.mark.parametrize("hop", [60.0, 20.0])
def test_a_window_of_a_drifting_converter_holds_what_a_true_one_takes(
    ppm: float, hop: float
) -> None:
    """Of the seconds that it should hold: the third window begins as late as a true one's."""
    cutter = WindowCutter(window_duration=60.0, hop=hop)
    windows = [window for each in converted(ppm, 240) for window in cutter.push(each)][:3]
    assert len(windows) == 3
    for number, window in enumerate(windows):
        start = window.first_sample * (1 + 1e-6 * ppm) / SAMPLING_RATE
        assert start == pytest.approx(number * hop, abs=0.6 * (number + 1) / SAMPLING_RATE)
        assert window.samples.shape == (SAMPLES, len(TONES))
        assert window.duration == pytest.approx(60.0, abs=2 / SAMPLING_RATE)
        inside = slice(40, -40)  # at its ends the signal counts as constant
        error = (window.samples - true_samples(start))[inside]
        assert abs(error).max() < 3e-3


def test_a_second_that_a_drifting_converter_lost_is_missing_and_no_more() -> None:
    blocks = converted(-1000.0, 61)
    del blocks[30]
    gap = MissingSamples(1200, 40, 30, 1, blocks[29].end_ns, blocks[30].start_ns)
    cutter = WindowCutter(window_duration=60.0, hop=60.0)
    (window,) = (w for each in (*blocks[:30], gap, *blocks[30:]) for w in cutter.push(each))
    missing = np.isnan(window.samples).any(axis=1)
    assert 40 <= missing.sum() <= 42
    beside = np.flatnonzero(~missing)
    error = (window.samples - true_samples(0.0))[beside[40:-40]]
    assert np.sqrt((error**2).mean()) < 0.02


@pytest.mark.parametrize("ppm", [-1500.0, 1500.0])
def test_a_record_of_whole_windows_by_count_loses_none_to_its_converters_drift(ppm: float) -> None:
    """Three minutes by count are a quarter of a second more or less."""
    cutter = WindowCutter(window_duration=60.0, hop=60.0)
    windows = [window for each in converted(ppm, 180) for window in cutter.push(each)]
    windows += cutter.finish()
    assert [window.complete for window in windows[:3]] == [True] * 3
    assert len(windows[2].samples) >= 0.99 * SAMPLES


def test_a_window_that_a_restart_begins_with_is_the_same() -> None:
    blocks = converted(-2500.0, 200)
    whole = WindowCutter(window_duration=60.0, hop=60.0)
    windows = [window for each in blocks for window in whole.push(each)]
    again = WindowCutter(window_duration=60.0, hop=60.0)
    again.begin_at(1)
    origin = windows[1].first_sample - SAMPLES  # where windows begin at the nominal rate
    later = [replace(each, first_sample=each.first_sample - origin) for each in blocks[60:]]
    second = next(window for each in later for window in again.push(each))
    np.testing.assert_array_equal(second.samples, windows[1].samples)
