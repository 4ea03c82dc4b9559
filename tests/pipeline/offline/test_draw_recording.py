"""A recorded session drawn afterwards."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.cli.report import show
from pipeline.offline.draw_recording import draw_recording, open_pictures, pictures_of
from pipeline.recording.writer import Recorder
from pipeline.scenario import load_scenario, scenario_metadata
from pipeline.viewer.outputs.outputs import RrdFile, ViewerError
from pipeline.viewer.viewer_node import Viewer
from sensors.errors import InputError
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import DESCRIPTION, Episode, session

pytestmark = pytest.mark.usefixtures("identified_once")

EPISODE = Episode(n_windows=2, rejected=(1,))


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("shown") / "session.mcap"
    metadata = {"scenario": scenario_metadata(load_scenario("parked"))}
    recorder = Recorder(path, metadata=metadata, clock=None)
    for message in session(EPISODE):
        recorder.handle(message)
    recorder.close()
    return path


def test_a_recording_drawn_later_equals_what_was_drawn_live(recording: Path, tmp_path: Path):
    viewer = Viewer([RrdFile(tmp_path / "live.rrd")], DESCRIPTION, session="s", strict=True)
    for message in session(EPISODE):
        viewer.handle(message)
    viewer.close()
    draw_recording(recording, (pictures_of(recording, None),))
    live, later = Recorded(tmp_path / "live.rrd"), Recorded(recording.with_suffix(".rrd"))
    assert later.entities == live.entities
    for path in sorted(live.entities):
        if path.endswith(("/posterior", "/identified", "/acceleration")):
            np.testing.assert_array_equal(later.scalars(path), live.scalars(path))


def test_pictures_that_exist_are_never_overwritten(recording: Path, tmp_path: Path):
    (tmp_path / "old.rrd").touch()
    with pytest.raises(InputError, match=r"old\.rrd exists already"):
        pictures_of(recording, tmp_path / "old.rrd")


def test_pictures_that_are_not_there_are_one_clear_line(tmp_path: Path):
    with pytest.raises(ViewerError, match=r"none\.rrd does not exist"):
        open_pictures(tmp_path / "none.rrd")


def test_existing_pictures_are_not_sent_to_a_running_viewer_and_the_error_gives_the_alternative(
    tmp_path: Path,
):
    asked = "connect=rerun+http://127.0.0.1:1/proxy"
    with pytest.raises(InputError, match=r"s\.rrd opens in a window or with --view web; .*mcap"):
        show(tmp_path / "s.rrd", view=asked)
