"""Outputs of the viewer, and the errors where one is not available."""

import importlib.util
import os
import re
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import rerun as rr

from pipeline.viewer.outputs import connection
from pipeline.viewer.outputs.outputs import (
    ConnectedViewer,
    RrdFile,
    SpawnedViewer,
    ViewerError,
    WebPage,
    parse_view,
    prepare_rerun,
)
from pipeline.viewer.viewer_node import Viewer
from tests.pipeline.viewer.session import DESCRIPTION


def test_spawn_web_and_connect_are_understood():
    assert parse_view("spawn") == SpawnedViewer()
    assert parse_view("web") == WebPage()
    address = "rerun+http://127.0.0.1:9876/proxy"
    assert parse_view(f"connect={address}") == ConnectedViewer(address)


@pytest.mark.parametrize(
    "text", ["", "window", "web=1", "connect", "connect=", "connect=127.0.0.1:9876"]
)
def test_any_other_word_is_one_line_with_the_right_ones(text: str):
    with pytest.raises(ViewerError) as error:
        parse_view(text)
    message = str(error.value)
    assert message.startswith(f"--view {text}")
    assert "connect=" in message
    assert "\n" not in message


def test_missing_rerun_is_one_line_that_names_the_option(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr("pipeline.viewer.outputs.outputs.find_spec", lambda name: None)
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
        "outputs/outputs",
        "outputs/drawing_thread",
        "outputs/viewer_process",
        "pictures/display_signals",
        "pictures/scene",
        "pictures/corner",
        "pictures/pile",
        "pictures/farm_overview",
        "pictures/spectrum",
        "pictures/stabilisation",
        "pictures/status_text",
        "viewer_node",
    ):
        assert "import rerun" not in (source / f"{name}.py").read_text("utf-8")


def test_a_file_that_cannot_be_closed_keeps_no_session_from_ending(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    never = threading.Event()
    abandoned = []

    class OnAFullDisk:
        """As the SDK's stream is when its writing thread has met a full disk."""

        def flush(self, *, timeout_sec: float) -> None:
            raise RuntimeError("Flush timed out")

        def disconnect(self) -> None:
            never.wait()

    monkeypatch.setattr(connection, "CLOSE_TIMEOUT", 0.01)
    monkeypatch.setattr(connection, "forget_unfinished", lambda: abandoned.append(True))
    connection.close_recording(OnAFullDisk(), timeout=0.01)
    assert abandoned == [True]
    assert caplog.messages == ["the viewer did not accept the last messages: Flush timed out"]
    never.set()


def test_what_is_drawn_is_in_the_file(tmp_path: Path) -> None:
    file = tmp_path / "session.rrd"
    recording = connection.open_recording(RrdFile(file), recording_id="r")
    recording.log("here", rr.Scalars(1.0))
    recording.flush()
    recording.disconnect()
    assert file.stat().st_size > 100


def test_freed_memory_goes_back_at_once_and_a_file_without_an_index_is_no_warning(tmp_path: Path):
    source = f"""
from pathlib import Path
from pipeline.viewer.outputs.outputs import RrdFile
from pipeline.viewer.viewer_node import Viewer
from tests.pipeline.viewer.session import DESCRIPTION
output = RrdFile(Path({str(tmp_path / "x.rrd")!r}), indexed=False)
Viewer([output], DESCRIPTION, session="x").close()
"""
    ran = subprocess.run(
        [sys.executable, "-c", source],
        capture_output=True, text=True, check=True, env=os.environ | {"MIMALLOC_VERBOSE": "1"},
    )  # fmt: skip
    delays = re.findall("'purge_delay': (.+)", ran.stderr)  # rerun's allocator, pyarrow's
    assert delays
    assert {each.strip() for each in delays} == {"0"}
    assert "WARN" not in ran.stdout + ran.stderr


@pytest.mark.parametrize(
    ("outputs", "quiet"),
    [
        ([RrdFile(Path("a.rrd"), indexed=False)], True),
        ([RrdFile(Path("a.rrd"), indexed=False), SpawnedViewer()], True),
        ([RrdFile(Path("a.rrd")), SpawnedViewer()], False),
        ([], False),
    ],
)
def test_rerun_is_told_of_a_file_without_an_index_beside_any_other_output(
    outputs: list[RrdFile | SpawnedViewer], quiet: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "environ", environment := {"MIMALLOC_PURGE_DELAY": "7"})
    prepare_rerun(outputs)
    assert environment["MIMALLOC_PURGE_DELAY"] == "7"  # what the environment sets stays
    assert ("RUST_LOG" in environment) is quiet


def test_a_viewer_is_sought_on_the_machine_that_is_named() -> None:
    with socket.create_server(("127.0.0.1", 0)) as here:
        url = f"rerun+http://127.0.0.2:{here.getsockname()[1]}/proxy"
        with pytest.raises(ViewerError, match=r"no viewer listens there \(Connection refused\)"):
            connection.open_recording(ConnectedViewer(url), recording_id="s")
