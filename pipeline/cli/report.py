"""`pilewatch report`: a recorded session as one page to send."""

import json
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import JsonOption, output, people


def report(
    session: Annotated[
        Path, typer.Argument(help="A session's MCAP recording, or its folder with all its parts.")
    ],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The HTML file; report.html in this folder if not."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Write a session's report: one HTML page that can be mailed and printed."""
    from pipeline.report.figures_json import session_json
    from pipeline.report.page import write_page
    from pipeline.report.recorded_session import read_session

    with people.status(f"reading {session}"):
        read = read_session(session)
    if out is not None or not as_json:
        page = out or Path("report.html")
        with people.status(f"drawing {page}"):
            write_page(read, page)
        people.print(f"{page}: {page.stat().st_size / 1e6:.2f} MB", soft_wrap=True)
    if as_json:
        output.print_json(json.dumps(session_json(read)))
