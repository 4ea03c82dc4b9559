"""`pilewatch ack`: what is wrong, and who has taken note of it."""

import getpass
import json
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from pipeline.cli.console import JsonOption, ZenohConfigOption, escaped, output, zenoh_settings
from sensors.errors import InputError


def ack(
    ids: Annotated[
        list[int] | None, typer.Argument(help="Numbers of notices to acknowledge; none: list.")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List the notices, those that are over too.")
    ] = False,
    by: Annotated[str | None, typer.Option(help="Who; otherwise the user's name.")] = None,
    connect: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of a session; otherwise that of the one in --out."),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """List notices and acknowledge them: an acknowledged one is not told again while it lasts."""
    name = by or getpass.getuser()
    wanted = [] if list_ else ids or []
    whom: Any = connect
    if zenoh_config is not None:
        whom = zenoh_settings("peer", None, None, zenoh_config)
    answer = _answered(whom, wanted, name, out)
    if as_json:
        output.print_json(json.dumps(answer))
    else:
        output.print(_table(answer["notices"], closed=list_))
    if answer["unknown"]:
        numbers = ", ".join(map(str, answer["unknown"]))
        raise InputError(f"{numbers} is no open notice; `pilewatch ack --list` shows them")


def _answered(whom: Any, ids: list[int], name: str, out: Path) -> dict[str, Any]:
    """By the session that runs; by its file where none does."""
    from pipeline.monitoring.alarms.alarm_node import BOOK, FOLDER, KEY, acknowledged_in_file
    from pipeline.monitoring.status import ENDPOINT_FILE, endpoint_of
    from pipeline.transport.errors import TransportError
    from pipeline.transport.zenoh_bus import asked

    if whom is None and not (out / ENDPOINT_FILE).exists():
        return acknowledged_in_file(out / FOLDER / BOOK, ids, name)
    place = whom or endpoint_of(out)
    query = json.dumps({"acknowledge": ids, "by": name}).encode()
    try:
        answers = [json.loads(each) for each in asked(place, f"{KEY}/*", query)]
    except TransportError:
        if whom is not None:
            raise
        return acknowledged_in_file(out / FOLDER / BOOK, ids, name)  # a session that was killed
    if not answers:
        raise InputError(f"nobody at {place} keeps notices; `pilewatch run --notices FILE` does")
    known = [notice for answer in answers for notice in answer["notices"]]
    unknown = set.intersection(*(set(answer["unknown"]) for answer in answers))
    return {"notices": known, "unknown": sorted(unknown)}


def _table(notices: list[dict[str, Any]], *, closed: bool) -> Table:
    table = Table("no.", "turbine", "kind", "since (UTC)", "seen", "state", "what")
    for notice in notices:
        if closed or not notice["closed"]:
            table.add_row(
                str(notice["id"]),
                escaped(notice["turbine"]),
                notice["kind"],
                f"{datetime.fromtimestamp(notice['first_ns'] / 1e9, UTC):%Y-%m-%d %H:%M}",
                str(notice["count"]),
                _state(notice),
                escaped(notice["text"]),
            )
    return table


def _state(notice: dict[str, Any]) -> str:
    over = "over" if notice["closed"] or notice["over_ns"] else "open"
    if not notice["acknowledged_ns"]:
        return over
    return f"{over}, acknowledged by {escaped(notice['acknowledged_by'])}"
