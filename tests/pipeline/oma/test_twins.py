"""A mast that is alike in every direction: its modes come in pairs that no record can separate."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from pipeline.oma.identification import identify

RATE, FREQUENCIES, DAMPING = 20.0, (1.0, 4.1), 0.007  # [Hz], [Hz], [-]
SHAPES = np.array([[0.3, 1.0], [1.0, -0.8]])  # of two modes at two levels


def one_direction(rng: np.random.Generator, n: int) -> NDArray[np.float64]:
    """Accelerations of two levels under white noise, (n, 2)."""
    response = np.zeros((n, 2))
    for frequency, shape in zip(FREQUENCIES, SHAPES, strict=True):
        omega = 2 * np.pi * frequency / RATE
        pole = np.exp(-DAMPING * omega + 1j * omega * np.sqrt(1 - DAMPING**2))
        load = rng.normal(size=n)
        response += np.outer(
            lfilter([1.0, -1.0], [1.0, -2 * pole.real, abs(pole) ** 2], load), shape
        )
    return response + 0.02 * response.std() * rng.normal(size=response.shape)


def test_modes_alike_in_two_directions_are_told_where_none_can_be_found() -> None:
    rng = np.random.default_rng(11)
    mast = np.hstack([one_direction(rng, 12_000), one_direction(rng, 12_000)])
    both = identify(mast, RATE)
    assert not both.modes  # neither is passed off as one
    told = " ".join(each.text for each in both.warnings if each.code == "twin-modes")
    for frequency in FREQUENCIES:
        seen = next((f for f in _numbers(told) if abs(f / frequency - 1) < 0.005), None)
        assert seen is not None, told
    single = identify(mast[:, :2], RATE)
    assert [mode.frequency for mode in single.modes] == pytest.approx(FREQUENCIES, rel=0.005)
    assert "twin-modes" not in [each.code for each in single.warnings]


def _numbers(text: str) -> list[float]:
    return [float(word) for word in text.split() if word.replace(".", "").isdigit()]


def test_noise_has_no_twins() -> None:
    noise = np.random.default_rng(12).normal(size=(12_000, 4))
    assert "twin-modes" not in [each.code for each in identify(noise, RATE).warnings]
