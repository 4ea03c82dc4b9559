"""Where pictures go, and what is said when they cannot."""

import importlib.util
from pathlib import Path

import pytest

from pipeline.viewer.outputs import (
    ConnectedViewer,
    RrdFile,
    SpawnedViewer,
    ViewerError,
    WebPage,
    parse_view,
)
from pipeline.viewer.sink import Viewer
from tests.pipeline.viewer.session import DESCRIPTION


def test_spawn_web_and_connect_are_understood():
    assert parse_view("spawn") == SpawnedViewer()
    assert parse_view("web") == WebPage()
    address = "rerun+http://127.0.0.1:9876/proxy"
    assert parse_view(f"connect={address}") == ConnectedViewer(address)


@pytest.mark.parametrize(
    "text", ["", "window", "web=1", "connect", "connect=", "connect=127.0.0.1:9876"]
)
def test_any_other_word_is_one_line_that_says_what_would_be_right(text: str):
    with pytest.raises(ViewerError) as error:
        parse_view(text)
    message = str(error.value)
    assert message.startswith(f"--view {text}")
    assert "connect=" in message
    assert "\n" not in message


def test_missing_rerun_is_one_line_that_names_the_option(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr("pipeline.viewer.outputs.find_spec", lambda name: None)
    outputs = [RrdFile(Path("out/session.rrd"))]
    with pytest.raises(ViewerError) as error:
        Viewer(outputs, DESCRIPTION, session="s")
    assert str(error.value) == (
        "rerun-sdk is not installed (needed for --rrd out/session.rrd): "
        "pip install rerun-sdk, or run with --no-rrd"
    )


def test_opening_nothing_needs_no_rerun_at_import():
    source = Path(importlib.util.find_spec("pipeline.viewer").origin).parent  # type: ignore[union-attr, arg-type]
    for name in (
        "__init__",
        "outputs",
        "display_signals",
        "scene",
        "corner",
        "pile",
        "farm",
        "spectrum",
        "stabilisation",
        "status",
        "stages",
        "sink",
        "viewer_process",
    ):
        assert "import rerun" not in (source / f"{name}.py").read_text("utf-8")
