"""Results that a recording holds, of one of its turbines."""

from dataclasses import replace
from pathlib import Path

import pilewatch as pw

from pipeline.recording.writer import Recorder
from tests.pipeline.example_messages import LAYOUT


def test_a_session_is_the_first_turbines_where_none_is_named(tmp_path: Path) -> None:
    path = tmp_path / "farm.mcap"
    recorder = Recorder(path, metadata={}, clock=None)
    recorder.handle(LAYOUT)
    recorder.handle(replace(LAYOUT, turbine="t2", channels=LAYOUT.channels[:2]))
    recorder.close()
    for named, turbine, channels in (
        (None, "t1", LAYOUT.channel_names),
        ("t1", "t1", LAYOUT.channel_names),
        ("t2", "t2", LAYOUT.channel_names[:2]),
        ("t3", "t3", ()),
    ):
        session = pw.open(path, named)
        assert (session.turbine, session.modes.channels) == (turbine, channels)


def test_a_session_of_one_message_is_that_turbines(tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    recorder = Recorder(path, metadata={}, clock=None)
    recorder.handle(LAYOUT)
    recorder.close()
    assert pw.open(path).turbine == "t1"
