"""`pilewatch status`: how the sessions that run are doing."""

import getpass
import json
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from pipeline.cli.console import (
    ConnectOption,
    JsonOption,
    ModeOption,
    ZenohConfigOption,
    escaped,
    output,
    people,
    stopped_by_signals,
    zenoh_settings,
)
from sensors.errors import InputError


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
    from pipeline.cli.tables.running import status_tables
    from pipeline.monitoring.status import KEY, endpoint_of
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


def metrics(
    connect: ConnectOption = None,
    port: Annotated[int, typer.Option(help="Where Prometheus asks; 0: any that is free.")] = 9464,
    address: Annotated[
        str,
        typer.Option(help="Of this machine, to listen on; only this machine reaches 127.0.0.1."),
    ] = "127.0.0.1",
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session that runs here.")] = Path("out"),
) -> None:
    """Serve rates, gaps, lag, modes, stiffness and change probability to Prometheus."""
    from pipeline.monitoring.metrics import MetricsNode, listened, served
    from pipeline.monitoring.status import endpoint_of
    from pipeline.runtime.runner import open_session
    from pipeline.transport.zenoh_bus import ZenohBus

    where = connect or ([] if zenoh_config else [endpoint_of(out)])
    settings = zenoh_settings(mode, None, where, zenoh_config)
    desk = MetricsNode()
    with (
        stopped_by_signals() as stopping,
        served(desk, port, address) as served_port,
        open_session(lambda: ZenohBus(settings)) as bus,
    ):
        people.print(f"Figures at http://{address}:{served_port}/metrics; Ctrl-C ends it.")
        listened(desk, bus, stopping)


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


def notices(
    file: Annotated[Path, typer.Argument(help="TOML file of `run --notices`.")],
    test: Annotated[
        bool, typer.Option("--test", help="Send a test message through every channel.")
    ] = False,
    out: Annotated[Path, typer.Option(help="Folder that the message names.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """Check a notices file; with --test, whether each channel delivers."""
    from pipeline.monitoring.alarms.channel_check import checked_channels
    from pipeline.monitoring.alarms.channels import channels_of
    from pipeline.monitoring.alarms.settings import load_notices

    settings = load_notices(file)
    if not test:
        count = len(channels_of(settings)) + len(settings.heartbeat)
        people.print(f"{escaped(str(file))} is right: {count} channels; --test sends a message.")
        return
    results = list(checked_channels(settings, out.resolve()))
    if as_json:
        output.print_json(json.dumps([asdict(each) for each in results]))
    else:
        table = Table("channel", "receiver", "time [s]", "result")
        for each in results:
            result = escaped(each.problem) if each.problem else "delivered"
            table.add_row(each.channel, escaped(each.place), f"{each.seconds:.2f}", result)
        output.print(table)
    failed = [each.channel for each in results if each.problem]
    if failed:
        raise InputError(f"no test message arrived by {', '.join(failed)}")


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
