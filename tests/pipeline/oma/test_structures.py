"""Modes of random structures in noise: the short form of the benchmark `structures`."""

import numpy as np
import pytest

from pipeline.oma.identification import identify
from tests.benchmarks.structures import draw, figures, judge


def test_most_modes_of_random_structures_are_found_and_hardly_one_is_invented() -> None:
    structures = [draw(seed) for seed in range(76_001, 76_009)]
    judged = [judge(each, identify(each.samples, each.sampling_rate).modes) for each in structures]
    found = figures(structures, judged)
    assert found["missed"] <= 0.15
    assert found["invented_a_record"] <= 0.25
    assert found["median_over_bound"] <= 1.35


def test_a_mode_in_noise_is_no_mixture_though_its_shape_is_vague() -> None:
    """Its f and ζ are known to a tenth of the half bandwidth, a channel of the six to .28."""
    structure = draw(74_025)
    modes = identify(structure.samples, structure.sampling_rate).modes
    vague = [mode for mode in modes if mode.shape_std.max() > 0.25]
    assert vague
    for mode in vague:
        nearest = np.abs(structure.frequencies - mode.frequency).min()
        assert nearest == pytest.approx(0.0, abs=3 * mode.frequency_std)
