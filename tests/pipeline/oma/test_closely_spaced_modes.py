"""Two modes that a window cannot tell apart become a pair that says so."""

from dataclasses import replace

import numpy as np
import pytest
from pipeline.oma.closely_spaced_modes import with_close_pairs

from pipeline.messages import Mode
from tests.pipeline.oma.conftest import structure

RATE, DURATION, DAMPING = 10.0, 600.0, 0.01
SHAPES = np.array([[1.0, 0.5, 0.1, -0.1], [0.1, -0.1, 1.0, 0.5]])


def identified(frequency: float, shape: np.ndarray) -> Mode:
    std = frequency * np.sqrt(DAMPING / (2 * np.pi * frequency * DURATION))
    factor = np.zeros((6, 2))
    factor[0, 0], factor[1, 1], factor[3:, 1] = std, 1e-3, 0.01
    return Mode("", frequency, std, DAMPING, 1e-3, shape, factor, 2)


def found_beside(frequency: float) -> tuple[Mode, ...]:
    """What becomes of the one pole that was found for two modes at (almost) one frequency."""
    known = structure([frequency, frequency * 1.0005], DAMPING, SHAPES)
    samples = known.ambient_response(
        sampling_rate=RATE, duration=DURATION, seed=6, noise=0.01, excitation=[1.0, 0.4]
    )
    samples -= samples.mean(axis=0)
    return with_close_pairs([identified(frequency, SHAPES[0])], samples, RATE)


@pytest.mark.parametrize("resonance_lines", [1.0, 2.5])
def test_two_modes_within_a_resonance_of_three_lines_become_a_pair(resonance_lines: float) -> None:
    """ζ f T lines 1/T is half the half-power width of a resonance."""
    frequency = resonance_lines / (DAMPING * DURATION)
    pair = found_beside(frequency)
    assert len(pair) == 2
    assert len({mode.pair_id for mode in pair}) == 1
    assert pair[0].pair_id
    leader = identified(frequency, SHAPES[0])
    for mode in pair:
        assert mode.frequency == pytest.approx(frequency, rel=1e-6)
        assert mode.frequency_std > np.hypot(leader.frequency_std, 0.45 / DURATION)
    second = max(pair, key=lambda mode: mode.frequency_std)
    assert second.shape @ SHAPES[1] / np.linalg.norm(second.shape) / np.linalg.norm(
        SHAPES[1]
    ) == pytest.approx(1, abs=0.1)


def test_a_resonance_that_the_window_resolves_is_left_to_the_identification() -> None:
    (single,) = found_beside(5.0 / (DAMPING * DURATION))
    assert single.pair_id == ""


def test_a_mode_alone_in_its_band_stays_alone() -> None:
    known = structure([0.3, 1.7], DAMPING, SHAPES)
    samples = known.ambient_response(sampling_rate=RATE, duration=DURATION, seed=7, noise=0.01)
    mode = replace(identified(0.3, SHAPES[0]))
    assert with_close_pairs([mode], samples, RATE) == (mode,)
