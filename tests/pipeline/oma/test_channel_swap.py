"""Channels that have changed place are found by the shapes of the window before."""

import numpy as np

from pipeline.oma.tracking import ChannelSwapMonitor
from tests.pipeline.example_estimates import estimate, mode


def test_two_channels_that_changed_place_are_named() -> None:
    rng = np.random.default_rng(2)
    modes = [mode(f, rng.normal(size=8)) for f in (0.16, 0.6, 1.1, 1.8, 2.6)]
    watch = ChannelSwapMonitor()
    assert watch.swap_in(estimate(*modes)) is None
    order = [0, 2, 1, 3, 4, 5, 6, 7]
    swapped = [mode(each.frequency * 1.002, each.shape[order]) for each in modes]
    words = watch.swap_in(estimate(*swapped, number=1))
    assert words is not None
    assert words.startswith("z80-fa and z106-fa have changed place")
    assert watch.swap_in(estimate(*modes, number=2)) is None


def test_shapes_that_change_without_a_swap_are_let_pass() -> None:
    rng = np.random.default_rng(3)
    watch = ChannelSwapMonitor()
    for number in range(3):
        modes = [mode(f, rng.normal(size=8)) for f in (0.16, 0.6, 1.1, 1.8, 2.6)]
        assert watch.swap_in(estimate(*modes, number=number)) is None
