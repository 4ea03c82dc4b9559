"""`pilewatch show`: a recorded session as pictures."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import output, progress


def show(
    file: Annotated[
        Path, typer.Argument(help="A session's MCAP recording, or pictures that exist (.rrd).")
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="Where the pictures go; beside the recording if not."),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(help="spawn: a viewer's window; connect=URL: a viewer that runs; no file."),
    ] = None,
) -> None:
    """Draw a recorded session for the Rerun viewer, or open pictures that exist."""
    from pipeline.recording.info import recording_info
    from pipeline.showing import PICTURES, draw_recording, open_pictures, pictures_of
    from pipeline.viewer.outputs import RrdFile, parse_view

    if file.suffix == PICTURES:
        open_pictures(file)
        return
    drawn = pictures_of(file, out) if view is None else parse_view(view)
    with progress(f"drawing {file}", recording_info(file).duration) as report:
        draw_recording(file, (drawn,), report=report)
    if isinstance(drawn, RrdFile):
        output.print(f"Look at it: rerun {drawn.path}", soft_wrap=True)
