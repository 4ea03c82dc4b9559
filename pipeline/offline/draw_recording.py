"""Draw a recorded session: `pilewatch show`."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

from pipeline.messages import Message
from pipeline.recording.reader import read_messages
from pipeline.recording.rotation import PICTURE_SUFFIX
from pipeline.sources.sources import replayed
from pipeline.viewer.outputs.outputs import RrdFile, ViewerError, ViewerOutput
from pipeline.viewer.outputs.viewer_process import viewer_command
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from sensors.structure.description import bare_mast


def draw_recording(
    recording: Path,
    outputs: tuple[ViewerOutput, ...],
    *,
    report: Callable[[AccelerationBlock], None] | None = None,
) -> None:
    """Draw everything that a recording holds.

    Parameters
    ----------
    recording : Path
        An MCAP file.
    report : Callable[[AccelerationBlock], None] | None, optional
        Called with every block of accelerations.

    Raises
    ------
    RecordingError, SourceError, ViewerError
        One line each.
    """
    source = replayed(recording)
    known = source.scenario.has_structure
    structure = source.scenario.structure if known else bare_mast(source.layout)
    viewer = Viewer(
        outputs, structure, session=recording.name, has_structure=known, wait_for_viewer=True
    )
    try:
        for message in read_messages(recording):
            _draw(viewer, message, report)
    finally:
        viewer.close()


def _draw(
    viewer: Viewer, message: Message, report: Callable[[AccelerationBlock], None] | None
) -> None:
    if isinstance(message, viewer.inputs):
        viewer.handle(message)
    if report and isinstance(message, AccelerationBlock):
        report(message)


def pictures_of(recording: Path, out: Path | None) -> RrdFile:
    """Return the .rrd file of a recording: `out`, or beside it under its own name.

    Raises
    ------
    InputError
        If that file exists: it may be another session's.
    """
    path = out or recording.with_suffix(PICTURE_SUFFIX)
    if path.exists():
        raise InputError(
            f"{path} exists already: `pilewatch show {path}` opens it; -o FILE draws another"
        )
    return RrdFile(path)


def open_pictures(path: Path) -> None:
    """Open a .rrd in the Rerun viewer and wait until its window is closed.

    Raises
    ------
    ViewerError
        If the viewer cannot be started.
    """
    require_pictures(path)
    silent = os.environ | {"RERUN_ANALYTICS": "0"}
    command = viewer_command(str(path))
    ended = subprocess.run(command, check=False, stderr=subprocess.PIPE, text=True, env=silent)
    if ended.returncode:
        last = ended.stderr.strip().splitlines()[-1:] or ["no reason given"]
        raise ViewerError(
            f"the viewer ended with exit code {ended.returncode} ({last[0]}); is there a display?"
        )


def require_pictures(path: Path) -> None:
    """Raise ViewerError where there is no such file."""
    if not path.exists():
        raise ViewerError(f"{path} does not exist")
