"""`pilewatch report` and `show`: a recorded session as a page or in the viewer."""

import json
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import (
    VIEW_HELP,
    JsonOption,
    escape_markup,
    open_view,
    output,
    progress,
    require_place,
    stderr,
    stop_on_signals,
)
from sensors.errors import InputError

PAGE = b"<!doctype html"  # begins every report


def report(
    session: Annotated[
        Path, typer.Argument(help="A session's MCAP recording, or its folder with all its parts.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o", "--out", help="The HTML file; default: report.html in the current folder."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a session's report: one HTML page that can be mailed and printed."""
    from pipeline.report.figures_json import session_json
    from pipeline.report.page import write_page
    from pipeline.report.recorded_session import read_session

    page = out or (None if as_json else Path("report.html"))
    if page is not None:
        require_place(page, "-o")
        _require_no_other_file(page)
    with stderr.status(escape_markup(f"reading {session}")):
        read = read_session(session)
    if page is not None:
        with stderr.status(escape_markup(f"drawing {page}")):
            write_page(read, page)
        size = f"{page.stat().st_size / 1e6:.2f} MB"
        stderr.print(f"{escape_markup(str(page))}: {size}", soft_wrap=True)
    if as_json:
        output.print_json(json.dumps(session_json(read)))


def _require_no_other_file(page: Path) -> None:
    """Refuse to replace what is no page: a recording, a layout.

    Raises
    ------
    InputError
    """
    with suppress(FileNotFoundError), page.open("rb") as file:
        begin = file.read(len(PAGE)).lower()
        if begin and begin != PAGE:
            raise InputError(f"-o {page} exists and is no report; -o names another file")


def show(
    file: Annotated[
        Path, typer.Argument(help="A session's recording or folder, or an existing .rrd file.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The .rrd file; default: beside the recording."),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(help=f"{VIEW_HELP} No file is then written."),
    ] = None,
) -> None:
    """Draw a recorded session for the Rerun viewer, or open an existing .rrd file."""
    from pipeline.offline.draw_recording import open_pictures
    from pipeline.recording.rotation import PICTURE_SUFFIX

    if out is not None and out.suffix != PICTURE_SUFFIX:
        raise InputError(f"-o {out}: the pictures are a file for the viewer, NAME{PICTURE_SUFFIX}")
    if file.suffix != PICTURE_SUFFIX:
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
    from pipeline.sources.session_files import one_recording
    from pipeline.viewer.outputs.outputs import RrdFile

    recording = one_recording(recording)
    duration = recording_info(recording).duration
    with open_view(view) as shown:
        drawn = shown.output or pictures_of(recording, out)
        with progress(f"drawing {recording}", duration) as report:
            draw_recording(recording, (drawn,), report=report)
        if isinstance(drawn, RrdFile):
            output.print(escape_markup(f"Open it: rerun {drawn.path}"), soft_wrap=True)
        with stop_on_signals() as stopping:
            shown.wait(stopping)


def _serve(pictures: Path) -> None:
    from pipeline.offline.draw_recording import require_pictures

    require_pictures(pictures)
    with open_view("web", pictures) as shown, stop_on_signals() as stopping:
        shown.wait(stopping)


def audit(
    folder: Annotated[Path, typer.Argument(help="Folder of one or several runs: their --out.")],
    since: Annotated[
        str | None,
        typer.Option(help="Look at what ends after this time alone: ISO 8601, UTC without a zone."),
    ] = None,
    until: Annotated[
        str | None, typer.Option(help="Look at what ends up to this time alone.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check that nothing of a folder's runs was lost without a report: the books balance.

    Every block is recorded, reported missing or refused, every window identified or rejected, every
    estimate in the posterior or refused. Exit code 0: so it is; 1: it is not, each place in a line.
    """
    from pipeline.offline.audit import NO_END_NS, AuditPeriod
    from pipeline.offline.audit import audit as audit_folder

    period = AuditPeriod(_moment("--since", since, 0), _moment("--until", until, NO_END_NS))
    with stderr.status(escape_markup(f"reading {folder}")):
        found = audit_folder(folder, period)
    if as_json:
        output.print_json(json.dumps(found.as_json()))
    else:
        output.print(escape_markup(found.line), soft_wrap=True)
        for text in found.violations:
            output.print(escape_markup(f"  {text}"), soft_wrap=True)
    if found.violations:
        raise typer.Exit(1)


def _moment(option: str, written: str | None, absent: int) -> int:
    """Return the time of an option [ns since 1970-01-01 UTC]."""
    from sensors.feeds.payloads.timestamps import moment_ns

    if written is None:
        return absent
    try:
        return moment_ns(written)
    except ValueError as error:
        raise InputError(f"{option}: {error}") from error
