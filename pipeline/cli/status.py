"""`pilewatch status`: how the sessions that run are doing."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.console import JsonOption, ZenohConfigOption, output, zenoh_settings


def status(
    connect: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of a session; otherwise that of the one in --out."),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session that runs.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """Ask a running session for its nodes, streams, gaps and last posteriors."""
    from pipeline.monitoring.status import KEY, endpoint_of
    from pipeline.tables.running import status_tables
    from pipeline.transport.zenoh_bus import asked
    from sensors.errors import InputError

    whom: Any = zenoh_settings("peer", None, None, zenoh_config)
    place = str(zenoh_config)
    if zenoh_config is None:
        whom = place = endpoint_of(out) if connect is None else connect
    answers = [json.loads(each) for each in asked(whom, f"{KEY}/*")]
    if not answers:
        raise InputError(f"nobody at {place} answers for a session")
    if as_json:
        output.print_json(json.dumps(answers))
        return
    for answer in answers:
        for table in status_tables(answer):
            output.print(table)
