"""Accelerations for a screen: slow motion unchanged and in time, the rest taken out."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.viewer.pictures.display_signals import (
    SAME_CLOCK,
    STEPS_IN_SPREAD,
    DisplayDecimator,
    DisplaySignal,
    join_runs,
    low_pass,
)
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

STEP = 2 / STEPS_IN_SPREAD  # largest of signals of 1 m/s² [m/s²]
START_NS = 1_767_225_600 * NANOSECONDS


def blocks(
    frequency: float, *, sampling_rate: float, seconds: int, length: float = 1.0
) -> list[AccelerationBlock]:
    """One channel that swings with 1 m/s², cut into blocks of `length` [s]."""
    n_samples = round(length * sampling_rate)
    made = []
    for sequence in range(round(seconds / length)):
        first = sequence * n_samples
        times = (first + np.arange(n_samples)) / sampling_rate
        samples = np.sin(2 * np.pi * frequency * times)[:, None].astype(np.float32)
        start = START_NS + round(first * NANOSECONDS / sampling_rate)
        made.append(
            AccelerationBlock("t", "u", "s", "l", sequence, first, start, sampling_rate, samples)
        )
    return made


def shown(made: list[AccelerationBlock]) -> DisplaySignal:
    decimator = DisplayDecimator(made[0].sampling_rate)
    signals = [decimator.push(block) for block in made]
    return DisplaySignal(
        np.concatenate([signal.times_ns for signal in signals]),
        np.concatenate([signal.samples for signal in signals]),
    )


@pytest.mark.parametrize("sampling_rate", [20.0, 40.0, 62.5, 100.0, 200.0])
def test_slow_motion_keeps_its_size_and_its_time(sampling_rate: float):
    signal = shown(blocks(0.5, sampling_rate=sampling_rate, seconds=20))
    seconds = (signal.times_ns - START_NS) / NANOSECONDS
    assert signal.samples[:, 0] == pytest.approx(np.sin(np.pi * seconds), abs=0.01)


def test_motion_above_the_new_nyquist_frequency_does_not_appear_as_slow_motion():
    signal = shown(blocks(18.0, sampling_rate=40.0, seconds=20))  # would alias to 2 Hz
    assert np.abs(signal.samples).max() < 0.01


def test_where_the_blocks_are_cut_does_not_matter():
    short, long = (
        shown(blocks(3.0, sampling_rate=100.0, seconds=12, length=length)) for length in (0.05, 4.0)
    )
    assert (short.times_ns == long.times_ns).all()
    assert short.samples == pytest.approx(long.samples, abs=STEP)


@pytest.mark.parametrize("sampling_rate", [40.0, 62.5])
def test_blocks_joined_to_minutes_give_the_samples_of_single_blocks(sampling_rate: float):
    made = blocks(3.0, sampling_rate=sampling_rate, seconds=12)
    apart, together = shown(made), shown(list(join_runs(made)))
    assert (apart.times_ns == together.times_ns).all()
    assert apart.samples == pytest.approx(together.samples, abs=STEP)


def test_blocks_with_a_gap_a_restart_or_another_clock_between_them_are_not_joined():
    first, second, third, fourth = blocks(0.5, sampling_rate=40.0, seconds=4)
    restarted = replace(second, session="restarted")
    late = replace(second, start_ns=second.start_ns + 2 * SAME_CLOCK)
    for pair in ([first, third], [first, restarted], [first, late]):
        assert [len(run.samples) for run in join_runs(pair)] == [40, 40]
    assert [len(run.samples) for run in join_runs([first, second, fourth])] == [80, 40]


def test_a_clock_that_runs_fast_is_followed_to_a_millisecond():
    drift = 100e-6  # 6 ms in a minute
    made = [
        replace(block, start_ns=block.start_ns + round(drift * (block.start_ns - START_NS)))
        for block in blocks(0.5, sampling_rate=40.0, seconds=60)
    ]
    runs = list(join_runs(made))
    assert len(runs) == 6
    apart, together = shown(made), shown(runs)
    assert np.abs(apart.times_ns - together.times_ns).max() <= SAME_CLOCK


def test_after_a_missing_block_the_line_is_broken_and_starts_again():
    made = blocks(0.5, sampling_rate=40.0, seconds=10)
    signal = shown(made[:4] + made[6:])
    (broken,) = np.flatnonzero(np.isnan(signal.samples[:, 0]))
    assert signal.times_ns[broken] == made[3].end_ns
    assert signal.times_ns[broken + 1] > made[6].start_ns
    seconds = (np.delete(signal.times_ns, broken) - START_NS) / NANOSECONDS
    min_interval = np.delete(signal.samples[:, 0], broken)
    assert min_interval == pytest.approx(np.sin(np.pi * seconds), abs=0.01)


def test_a_new_session_of_the_unit_is_a_break_too():
    first, second = blocks(0.5, sampling_rate=40.0, seconds=2)
    signal = shown([first, replace(second, session="restarted")])
    assert np.isnan(signal.samples).sum() == 1


def test_low_pass_leaves_a_constant_as_it_is():
    for factor in (1, 2, 5, 10):
        assert low_pass(factor).sum() == pytest.approx(1.0)


@pytest.mark.parametrize("rates", [(40.0, 200.0), (200.0, 40.0), (20.0, 100.0)])
def test_blocks_of_another_rate_are_filtered_for_theirs(rates: tuple[float, float]):
    before, after = (blocks(0.5, sampling_rate=rate, seconds=10) for rate in rates)
    later = 10 * NANOSECONDS
    after = [replace(each, session="b", start_ns=each.start_ns + later) for each in after]
    signal = shown(before + after)
    (broken,) = np.flatnonzero(np.isnan(signal.samples[:, 0]))
    assert signal.times_ns[broken] == before[-1].end_ns
    behind = signal.times_ns[broken + 1 :]
    alone = shown(after)
    np.testing.assert_array_equal(behind, alone.times_ns)
    assert signal.samples[broken + 1 :] == pytest.approx(alone.samples, abs=STEP)


@pytest.mark.parametrize("size", [1e-9, 3e-5, 1.0, 1e6])
def test_signals_of_any_size_are_drawn_as_finely_and_as_briefly(size: float):
    """A geophone's 3e-5 m/s as an inclinometer's degrees: with some hundred values each."""
    samples = np.random.default_rng(8).standard_normal((2400, 2)).astype(np.float32)
    block = AccelerationBlock("t", "u", "s", "l", 0, 0, START_NS, 20.0, size * samples)
    drawn = DisplayDecimator(20.0).push(block).samples / size
    assert drawn == pytest.approx(samples, abs=STEP)
    assert 300 < len(np.unique(drawn)) < 1500


def test_a_spike_or_a_fault_makes_the_rest_no_coarser():
    samples = np.random.default_rng(8).standard_normal((2400, 3)).astype(np.float32)
    with_faults = samples.copy()
    with_faults[100, 0], with_faults[100, 1], with_faults[:, 2] = 1e6, np.nan, 0.25
    block = AccelerationBlock("t", "u", "s", "l", 0, 0, START_NS, 20.0, with_faults)
    drawn = DisplayDecimator(20.0).push(block).samples
    assert drawn[101:, :2] == pytest.approx(samples[101:, :2], abs=STEP)
    assert np.isnan(drawn[100, 1])
    assert (drawn[:, 2] == 0.25).all()
