"""A made-up session, written once to a .rrd."""

from pathlib import Path

import pytest
import rerun as rr

from pipeline.viewer.outputs.outputs import RrdFile
from pipeline.viewer.viewer_node import Viewer
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import DESCRIPTION, Episode, session


@pytest.fixture(autouse=True, scope="package")
def _strict_rerun() -> None:
    """A wrong argument to Rerun is an exception, not a warning."""
    rr.set_strict_mode(True)


def record(path: Path, episode: Episode, *, indexed: bool = True) -> Recorded:
    """The session as the viewer writes it, read back."""
    output = RrdFile(path, indexed=indexed)
    viewer = Viewer([output], DESCRIPTION, session="made-up", strict=True)
    for message in session(episode):
        viewer.handle(message)
    viewer.close()
    return Recorded(path)


@pytest.fixture(scope="package")
def recorded(tmp_path_factory: pytest.TempPathFactory, _strict_rerun: None) -> Recorded:
    """Three windows of ten minutes, the second with a gap of a minute."""
    return record(tmp_path_factory.mktemp("viewer") / "session.rrd", Episode(rejected=(1,)))
