"""After a gap the windows lie where they would have lain without it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.identification import identify
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.arrays import FloatArray
from tests.pipeline.nodes.test_identification import LAYOUT, RATE, cut
from tests.pipeline.oma.conftest import structure

WINDOW = 64.0  # [s]: 40 time blocks of whole samples in every band, shared by the windows
SETTINGS = OmaSettings(window_duration=WINDOW, hop=WINDOW)
LENGTH = round(WINDOW * RATE)  # [samples]


@pytest.fixture(scope="module")
def samples() -> FloatArray:
    """Three windows of two channels, as they are sent."""
    known = structure([1.0, 3.0], 0.01, np.array([[1.0, 0.4], [0.4, -1.0]]))
    made = known.ambient_response(sampling_rate=RATE, duration=3 * WINDOW, seed=2)
    return made.astype(np.float32).astype(float)


@pytest.mark.parametrize("lost", [range(0), range(5, 7), range(62, 64), range(76, 78)])
def test_a_window_after_a_gap_is_identified_from_its_own_samples_alone(
    samples: FloatArray, lost: range
) -> None:
    """
    |—— 0 ——|—▒ 1 ——|—— 2 ——|     window 2 as if it were all there is
    """
    node = IdentificationNode(SETTINGS)
    said = list(node.handle(LAYOUT))
    for block in cut(samples):
        if block.sequence not in lost:
            said += node.handle(block)
    estimate = [each for each in said if isinstance(each, ModalEstimate)][-1]
    assert estimate.window == 2
    alone = identify(
        samples[2 * LENGTH :], RATE, SETTINGS, channel_names=LAYOUT.channel_names
    ).modes
    assert [m.frequency for m in estimate.modes] == pytest.approx(
        [m.frequency for m in alone], rel=1e-6
    )
    for ours, expected in zip(estimate.modes, alone, strict=True):
        assert ours.shape == pytest.approx(expected.shape, abs=1e-5)
        assert ours.frequency_std == pytest.approx(expected.frequency_std, rel=1e-4)


def test_a_block_longer_than_its_windows_gives_the_estimates_of_short_ones(
    samples: FloatArray,
) -> None:
    """An hour in one block ended the identification: a window's blocks had gone when it came."""
    long = np.vstack([samples, samples[::-1], 0.9 * samples])
    short = cut(long)
    whole = replace(short[0], samples=long.astype(np.float32))

    def frequencies(blocks: Sequence[AccelerationBlock]) -> list[float]:
        node = IdentificationNode(SETTINGS)
        said = [*node.handle(LAYOUT)]
        said += [answer for block in blocks for answer in node.handle(block)]
        return [m.modes[0].frequency for m in said if isinstance(m, ModalEstimate)]

    assert frequencies([whole])[:8] == pytest.approx(frequencies(short)[:8], rel=1e-9)
    assert len(frequencies([whole])) >= 8
