"""Identified modes beside the model's where no posterior could be."""

import numpy as np
import pytest

from pipeline.offline.model_modes import model_modes, nearest_modes
from pipeline.state.run_modes import CombinedMode


def identified(name: str, frequency: float, shape: np.ndarray) -> CombinedMode:
    return CombinedMode(name, frequency, 0.001, 0.01, 0.001, tuple(shape.tolist()), 6, "", 1.0)


def test_a_mode_is_listed_with_the_model_mode_nearest_in_frequency() -> None:
    known = model_modes()
    structure, layout = known.model.description, known.model.layout
    fourth = known.model.labels.index("4")
    frequency, shape = known.modes.frequencies[0, fourth], known.modes.shapes[0, fourth]
    exact, wrong, short = nearest_modes(
        [
            identified("m1", frequency, shape),
            identified("m2", 1.004 * frequency, shape[::-1]),
            identified("m3", frequency, shape[:4]),
        ],
        structure,
        layout,
        [channel.name for channel in layout.channels],
    )
    assert (exact.label, wrong.label) == ("4", "4")
    assert exact.frequency == pytest.approx(frequency)
    assert exact.mac == pytest.approx(1.0)
    assert wrong.mac < 0.9
    assert np.isnan(short.mac)


def test_shapes_are_compared_channel_by_channel_whatever_their_order() -> None:
    known = model_modes()
    layout = known.model.layout
    order = [0, 4, 1, 5, 2, 6, 3, 7]
    names = [layout.channels[place].name for place in order]
    frequency, shape = known.modes.frequencies[0, 3], known.modes.shapes[0, 3]
    (found,) = nearest_modes(
        [identified("m1", frequency, shape[order])], known.model.description, layout, names
    )
    assert found.mac == pytest.approx(1.0)
