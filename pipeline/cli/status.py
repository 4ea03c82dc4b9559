"""`pilewatch status`, `metrics` and `ack`: the state and alarms of running sessions."""

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
    escape_markup,
    output,
    stderr,
    stop_on_signals,
    zenoh_settings,
)
from pipeline.cli.tables.cells import table_of
from pipeline.state.phrases import count_noun
from sensors.errors import InputError


def status(
    connect: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of a session; default: the session in --out."),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the running session.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """Ask a running session for its nodes, streams, gaps and last posteriors."""
    from pipeline.cli.tables.running import status_tables
    from pipeline.monitoring.status import STATUS_KEY, endpoint_of
    from pipeline.transport.zenoh_bus import asked
    from sensors.errors import InputError

    endpoint: Any = zenoh_settings("peer", None, None, zenoh_config)
    place = str(zenoh_config)
    if zenoh_config is None:
        endpoint = place = endpoint_of(out) if connect is None else connect
    answers = [json.loads(each) for each in asked(endpoint, f"{STATUS_KEY}/*")]
    if not answers:
        raise InputError(f"no session answers at {place}")
    if as_json:
        output.print_json(json.dumps(answers))
        return
    for answer in answers:
        for table in status_tables(answer):
            output.print(table)


def metrics(
    connect: ConnectOption = None,
    port: Annotated[int, typer.Option(help="Port for Prometheus; 0: any free one.")] = 9464,
    address: Annotated[
        str,
        typer.Option(help="Address to listen on; 127.0.0.1 is reachable from this machine only."),
    ] = "127.0.0.1",
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the running session.")] = Path("out"),
) -> None:
    """Serve rates, gaps, lag, modes, stiffness and change probability to Prometheus."""
    from pipeline.monitoring.metrics import MetricsNode, served
    from pipeline.monitoring.status import endpoint_of
    from pipeline.runtime.node_thread import listened, open_session
    from pipeline.transport.zenoh_bus import ZenohBus

    where = connect or ([] if zenoh_config else [endpoint_of(out)])
    settings = zenoh_settings(mode, None, where, zenoh_config)
    metrics_node = MetricsNode()
    with (
        stop_on_signals() as stopping,
        served(metrics_node, port, address) as served_port,
        open_session(lambda: ZenohBus(settings, stopping)) as bus,
    ):
        where_read = escape_markup(f"http://{address}:{served_port}/metrics")
        stderr.print(f"Metrics at {where_read}; Ctrl-C ends it.")
        named = ", ".join(where) or f"the sessions of {zenoh_config}"
        listened(metrics_node, bus, stopping, where=named)


def ack(
    ids: Annotated[
        list[int] | None, typer.Argument(help="Numbers of alarms to acknowledge; none: list.")
    ] = None,
    list_: Annotated[
        bool, typer.Option("--list", help="List the alarms, also those that ended.")
    ] = False,
    by: Annotated[
        str | None, typer.Option(help="Name of the user; default: the login name.")
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of a session; default: the session in --out."),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """List alarms and acknowledge them: an acknowledged one is not repeated while it lasts."""
    name = by or getpass.getuser()
    wanted = [] if list_ else ids or []
    endpoint: Any = connect
    if zenoh_config is not None:
        endpoint = zenoh_settings("peer", None, None, zenoh_config)
    answer = _answered(endpoint, wanted, name, out)
    if as_json:
        output.print_json(json.dumps(answer))
    else:
        output.print(_table(answer["notices"], closed=list_))
    if answer["unknown"]:
        numbers = ", ".join(map(str, answer["unknown"]))
        raise InputError(f"{numbers} is no open alarm; `pilewatch ack --list` lists them")


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
        if as_json:
            output.print_json(json.dumps({"file": str(file), "channels": count}))
            return
        stderr.print(
            f"{escape_markup(str(file))} is right: {count_noun(count, 'channel')}; --test sends "
            "a message."
        )
        return
    results = list(checked_channels(settings, out.resolve()))
    if as_json:
        output.print_json(json.dumps([asdict(each) for each in results]))
    else:
        table = table_of("", "channel", "receiver", "time [s]", "result")
        for each in results:
            result = each.problem or "delivered"
            table.add_row(each.channel, each.place, f"{each.seconds:.2f}", result)
        output.print(table)
    failed = [each.channel for each in results if each.problem]
    if failed:
        raise InputError(f"no test message arrived by {', '.join(failed)}")


def _answered(endpoint: Any, ids: list[int], name: str, out: Path) -> dict[str, Any]:
    """Ask the running session; read its file where none runs."""
    from pipeline.monitoring.alarms.alarm_node import ALARMS_KEY, BOOK, FOLDER, acknowledged_in_file
    from pipeline.monitoring.status import ENDPOINT_FILE, endpoint_of
    from pipeline.transport.errors import TransportError
    from pipeline.transport.zenoh_bus import asked

    if endpoint is None and not (out / ENDPOINT_FILE).exists():
        return acknowledged_in_file(out / FOLDER / BOOK, ids, name)
    place = endpoint or endpoint_of(out)
    query = json.dumps({"acknowledge": ids, "by": name}).encode()
    try:
        answers = [json.loads(each) for each in asked(place, f"{ALARMS_KEY}/*", query)]
    except TransportError:
        if endpoint is not None:
            raise
        return acknowledged_in_file(out / FOLDER / BOOK, ids, name)  # a session that was killed
    if not answers:
        raise InputError(
            f"no session at {place} keeps alarms; start one with `pilewatch run --notices FILE`"
        )
    known = [notice for answer in answers for notice in answer["notices"]]
    unknown = set.intersection(*(set(answer["unknown"]) for answer in answers))
    return {"notices": known, "unknown": sorted(unknown)}


def _table(notices: list[dict[str, Any]], *, closed: bool) -> Table:
    table = Table("no.", "turbine", "kind", "since (UTC)", "seen", "state", "what")
    for notice in notices:
        if closed or not notice["closed"]:
            table.add_row(
                str(notice["id"]),
                escape_markup(notice["turbine"]),
                notice["kind"],
                f"{datetime.fromtimestamp(notice['first_ns'] / 1e9, UTC):%Y-%m-%d %H:%M}",
                str(notice["count"]),
                _state(notice),
                escape_markup(notice["text"]),
            )
    return table


def _state(notice: dict[str, Any]) -> str:
    over = "over" if notice["closed"] or notice["over_ns"] else "open"
    if not notice["acknowledged_ns"]:
        return over
    return f"{over}, acknowledged by {escape_markup(notice['acknowledged_by'])}"
