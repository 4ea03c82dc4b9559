"""Identified modes beside the model's where no posterior could be."""

import numpy as np
import pytest

from pipeline.offline.model_modes import model_modes, nearest_modes
from pipeline.scenario import load_scenario
from pipeline.state.run_modes import CombinedMode


def identified(name: str, frequency: float, shape: np.ndarray) -> CombinedMode:
    return CombinedMode(name, frequency, 0.001, 0.01, 0.001, tuple(shape.tolist()), 6, "", 1.0)


def test_a_mode_is_listed_with_the_model_mode_nearest_in_frequency() -> None:
    known = model_modes()
    fourth = known.model.labels.index("4")
    frequency, shape = known.modes.frequencies[0, fourth], known.modes.shapes[0, fourth]
    exact, wrong, short = nearest_modes(
        [
            identified("m1", frequency, shape),
            identified("m2", 1.004 * frequency, shape[::-1]),
            identified("m3", frequency, shape[:4]),
        ],
        load_scenario("parked"),
    )
    assert (exact.label, wrong.label) == ("4", "4")
    assert exact.frequency == pytest.approx(frequency)
    assert exact.mac == pytest.approx(1.0)
    assert wrong.mac < 0.9
    assert np.isnan(short.mac)
