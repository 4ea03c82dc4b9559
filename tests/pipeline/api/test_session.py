"""Results that a recording holds, of one of its turbines."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pilewatch as pw
import pytest

from pipeline.recording.rotation import SESSION_FILE, part_of
from tests.pipeline.example_messages import LAYOUT, block, recorded

BLOCKS = [block(n) for n in range(4)]
SAMPLES = np.concatenate([each.samples for each in BLOCKS])
OTHER = replace(LAYOUT, turbine="t2", channels=LAYOUT.channels[:2])


def test_a_session_is_the_first_turbines_where_none_is_named(tmp_path: Path) -> None:
    path = recorded(tmp_path / "farm.mcap", [LAYOUT, OTHER])
    for named, turbine, channels in (
        (None, "t1", LAYOUT.channel_names),
        ("t1", "t1", LAYOUT.channel_names),
        ("t2", "t2", LAYOUT.channel_names[:2]),
    ):
        session = pw.open(path, named)
        assert (session.turbine, session.modes.channels) == (turbine, channels)


def test_a_turbine_that_is_not_recorded_is_refused_with_those_that_are(tmp_path: Path) -> None:
    path = recorded(tmp_path / "farm.mcap", [LAYOUT, OTHER])
    with pytest.raises(pw.InputError, match=r"has no turbine 't3'; it has t1, t2$"):
        pw.open(path, turbine="t3")


def test_a_session_of_one_message_is_that_turbines(tmp_path: Path) -> None:
    assert pw.open(recorded(tmp_path / "one.mcap", [LAYOUT])).turbine == "t1"
    assert pw.open(recorded(tmp_path / "bare.mcap", BLOCKS), turbine="t1").turbine == "t1"
    assert pw.open(recorded(tmp_path / "none.mcap", [])).turbine == ""


def test_the_measurement_of_a_session_is_of_its_turbine(tmp_path: Path) -> None:
    theirs = [replace(each, turbine="t2", samples=each.samples[:, :2] + 7) for each in BLOCKS]
    path = recorded(tmp_path / "farm.mcap", [LAYOUT, OTHER, *BLOCKS, *theirs])
    found = pw.open(path, turbine="t2").measurement()
    np.testing.assert_array_equal(found.samples, SAMPLES[:, :2] + np.float32(7))
    assert found.layout == OTHER


def test_the_measurement_of_a_session_in_a_folder_is_of_all_its_files(tmp_path: Path) -> None:
    first = tmp_path / SESSION_FILE
    recorded(part_of(first, 1), [LAYOUT, *BLOCKS[:2]])
    recorded(part_of(first, 2), [LAYOUT, *BLOCKS[2:]])
    found = pw.open(tmp_path).measurement()
    np.testing.assert_array_equal(found.samples, SAMPLES)


def test_the_places_of_several_units_are_their_layouts_joined(tmp_path: Path) -> None:
    units = [
        replace(LAYOUT, unit=unit, layout_id=unit, channels=LAYOUT.channels[own])
        for unit, own in (("b", slice(4, None)), ("a", slice(None, 4)))
    ]
    modes = pw.open(recorded(tmp_path / "a.mcap", units)).modes
    assert modes.channels == LAYOUT.channel_names
    assert modes.layout is not None
    assert modes.layout.channels == LAYOUT.channels
