"""After a gap the windows lie where they would have lain without it."""

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.oma.identification import identify
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.nodes.test_identification import (
    LAYOUT,
    RATE,
    SETTINGS,
    answers,
    blocks,
)

__all__ = ["blocks"]  # a fixture
LENGTH = round(60 * RATE)  # of a window [samples]


@pytest.mark.parametrize("lost", [range(5, 7), range(58, 60), range(70, 72), range(61, 62)])
def test_a_window_after_a_gap_is_identified_from_its_own_samples_alone(
    blocks: list[AccelerationBlock],
    lost: range,
) -> None:
    """
    |—— 0 ——|—▒ 1 ——|—— 2 ——|     window 2 as if it were all there is
    """
    said = answers([block for block in blocks if block.sequence not in lost])
    estimate = said[-1]
    assert isinstance(estimate, ModalEstimate)
    assert estimate.window == 2
    samples = np.concatenate([block.samples for block in blocks]).astype(float)
    alone = identify(
        samples[2 * LENGTH :], RATE, SETTINGS, channel_names=LAYOUT.channel_names
    ).modes
    assert len(estimate.modes) == len(alone)
    for ours, expected in zip(estimate.modes, alone, strict=True):
        assert ours.frequency == pytest.approx(expected.frequency, rel=1e-3)
        assert ours.shape == pytest.approx(expected.shape, abs=0.02)
