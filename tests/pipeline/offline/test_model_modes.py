"""Identified modes beside the model's where no posterior could be."""

import re
from pathlib import Path

import numpy as np
import pytest

from pipeline.offline.model_modes import model_modes, nearest_modes
from pipeline.state.run_modes import CombinedMode
from sensors.structure.description import shipped_text


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


def test_a_lower_tower_without_sensors_of_its_own_is_read_at_the_same_shares_of_its_height(
    tmp_path: Path,
) -> None:
    text = shipped_text("iea15mw_monopile")
    cut = re.sub(r"(?s)  \{ bottom = 93\.0.*?\n\]", "]", text, count=1)  # the tower ends at 93 m
    cut = re.sub(r"(?s)reference_modes = \[.*?\n\]", "", cut)
    lumped = cut[: cut.index("[blades]")].replace("iea15mw_monopile", "mine")
    (tmp_path / "mine.toml").write_text(lumped)
    found = model_modes(turbine=str(tmp_path / "mine.toml"))
    assert found.model.description.blades is None
    assert max(found.model.layout.elevations) == pytest.approx(93.0)
    assert 0.1 < found.modes.frequencies.min() < 0.5


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
