"""`pilewatch show`: a recorded session as pictures."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import output, progress, stopped_by_signals
from pipeline.cli.viewing import VIEW_HELP, viewing
from sensors.errors import InputError


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
        typer.Option(help=f"{VIEW_HELP} No file is then written."),
    ] = None,
) -> None:
    """Draw a recorded session for the Rerun viewer, or open pictures that exist."""
    from pipeline.offline.draw_recording import PICTURES, open_pictures

    if file.suffix != PICTURES:
        _draw(file, out, view)
    elif view == "web":
        _serve(file)
    elif view in (None, "spawn"):
        open_pictures(file)
    else:
        raise InputError(
            f"--view {view}: {file} opens in a window or with --view web; a running viewer is "
            "drawn on from the recording, FILE.mcap"
        )


def _draw(recording: Path, out: Path | None, view: str | None) -> None:
    from pipeline.offline.draw_recording import draw_recording, pictures_of
    from pipeline.recording.info import recording_info
    from pipeline.viewer.outputs.outputs import RrdFile

    duration = recording_info(recording).duration
    with viewing(view) as shown:
        drawn = shown.output or pictures_of(recording, out)
        with progress(f"drawing {recording}", duration) as report:
            draw_recording(recording, (drawn,), report=report)
        if isinstance(drawn, RrdFile):
            output.print(f"Look at it: rerun {drawn.path}", soft_wrap=True)
        with stopped_by_signals() as stopping:
            shown.stay(stopping)


def _serve(pictures: Path) -> None:
    from pipeline.offline.draw_recording import require_pictures

    require_pictures(pictures)
    with viewing("web", pictures) as shown, stopped_by_signals() as stopping:
        shown.stay(stopping)
