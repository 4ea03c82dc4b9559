"""Modes of random structures in noise: the short form of the benchmark `structures`."""

import numpy as np
import pytest

from pipeline.oma.identification import identify
from tests.benchmarks.structures import draw, figures, judge
from tests.tiers import and_at_night


@pytest.mark.parametrize("seeds", and_at_night(range(76_001, 76_005), range(76_005, 76_009)))
def test_most_modes_of_random_structures_are_found_and_hardly_one_is_invented(seeds: range) -> None:
    structures = [draw(seed) for seed in seeds]
    judged = [judge(each, identify(each.samples, each.sampling_rate).modes) for each in structures]
    found = figures(structures, judged)
    assert found["missed"] <= 0.15
    assert found["invented_a_record"] <= 0.25
    assert found["median_over_bound"] <= 1.35


@pytest.mark.nightly
def test_a_mode_in_noise_is_no_mixture_though_its_shape_is_vague() -> None:
    """Its poles know f and ζ to a tenth of the half bandwidth, a channel of the six to .28."""
    structure = draw(74_025)
    modes = identify(structure.samples, structure.sampling_rate).modes
    true = structure.frequencies[2]
    (found,) = [mode for mode in modes if abs(mode.frequency / true - 1) < 0.03]
    assert found.frequency == pytest.approx(true, abs=3 * found.frequency_std)


def test_a_mode_that_stands_out_of_the_lines_is_found_though_no_pole_shows_it() -> None:
    """ζ 7 % at a third of the sampling rate: its poles scatter over one column and another."""
    structure = draw(160_018)
    modes = identify(structure.samples, structure.sampling_rate).modes
    (found,) = [mode for mode in modes if mode.n_block_columns == 0 and mode.frequency > 1.0]
    true = structure.frequencies[np.argmin(np.abs(structure.frequencies - found.frequency))]
    assert abs(found.frequency - true) < 2 * found.frequency_std


@pytest.mark.nightly
def test_a_wide_mode_that_no_channel_shows_above_the_flanks_of_others_is_found() -> None:
    structure = draw(160_022)
    modes = identify(structure.samples, structure.sampling_rate).modes
    (found,) = [mode for mode in modes if mode.frequency > 50.0]
    assert found.damping_ratio > 0.05
    assert abs(found.frequency - structure.frequencies[-1]) < 2 * found.frequency_std


def test_no_std_of_a_pole_is_smaller_than_any_estimate_could_have() -> None:
    structure = draw(160_034)
    modes = identify(structure.samples, structure.sampling_rate).modes
    of_poles = [mode for mode in modes if mode.n_block_columns]
    assert of_poles
    for mode in of_poles:
        cycles = 2 * np.pi * mode.frequency * structure.duration
        bound = np.sqrt(mode.damping_ratio / cycles)
        assert mode.frequency_std >= bound * mode.frequency
        assert mode.damping_ratio_std >= bound
