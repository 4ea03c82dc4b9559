"""`pilewatch feed`, `publish`, `control`, `certificates`: live sources and replays."""

import json
import os
import threading
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from pipeline.cli.console import (
    ConnectOption,
    JsonOption,
    ListenOption,
    ModeOption,
    ScenarioOption,
    ZenohConfigOption,
    escape_markup,
    output,
    print_json,
    print_written,
    progress,
    speed_of,
    stderr,
    stop_on_signals,
    zenoh_settings,
)
from pipeline.state.phrases import count_noun
from sensors.constants import HIGHEST_PORT
from sensors.errors import InputError
from sensors.json_values import fields_of

SpoolOption = Annotated[
    Path | None,
    typer.Option(
        help="Folder that keeps blocks until a shore station has recorded them; default: one of "
        "the source's own in $STATE_DIRECTORY or ~/.local/state/pilewatch."
    ),
]
KeepOption = Annotated[
    bool, typer.Option("--keep/--no-keep", help="Keep unacknowledged blocks on disk.")
]
SpoolMegabytesOption = Annotated[
    float, typer.Option(help="Of the spool; the oldest blocks go when it is larger [10⁶ bytes].")
]

SNIFFED_FOR = 10.0  # without --for [s]

if TYPE_CHECKING:
    from pipeline.sources.recorded_source import RecordedSource
    from pipeline.sources.sources import Source
    from pipeline.sources.spool import Spool


def feed(
    address: Annotated[
        str,
        typer.Argument(
            help="Its address, e.g. mqtt://HOST/TOPIC, opcua://HOST, udp://:PORT or "
            "scada+csv:FILE; see Live instruments."
        ),
    ],
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML file of its channels; or --scenario, whose sensors they are."),
    ] = None,
    scenario: ScenarioOption = None,
    turbine: Annotated[
        str | None, typer.Option(help="Its turbine; default: the layout's or the scenario's.")
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="Fail if the instrument does not answer at the start.")
    ] = False,
    seconds: Annotated[
        float | None, typer.Option("--for", help="Stop after so many seconds.")
    ] = None,
    state: Annotated[
        Path | None,
        typer.Option(
            envvar="STATE_DIRECTORY",
            help="Folder where it is remembered how far the source was published: a feed that was "
            "killed goes on there.",
        ),
    ] = None,
    spool: SpoolOption = None,
    keep: KeepOption = True,
    spool_megabytes: SpoolMegabytesOption = 500.0,
    sniff: Annotated[
        bool,
        typer.Option(
            "--sniff",
            help="Print what comes and a mapping that reads it (MQTT), or the variables (OPC UA).",
        ),
    ] = False,
    connect: ConnectOption = None,
    listen: ListenOption = None,
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Publish a live instrument (MQTT, SeedLink, OPC UA, UDP, SCADA) until it is stopped."""
    from pipeline.sources.feed_publisher import channels_of, publish_feed
    from sensors.feeds.assembly.channel_map import sensor_layout
    from sensors.feeds.open_feed import open_feed

    if seconds is not None and not seconds > 0:
        raise InputError(f"--for {seconds:g}: a positive number of seconds is needed")
    if sniff:
        _sniff(address, SNIFFED_FOR if seconds is None else seconds)
        return
    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    if layout is not None and scenario is not None:
        raise InputError(
            f"--layout {layout} and --scenario {scenario}: both define the channels; give one"
        )
    channels = channels_of(address, layout, scenario, turbine)
    live = open_feed(address, channels, once=once, state=state)
    with stop_on_signals() as stopping, progress(address, None) as report:
        if seconds is not None:
            timer = threading.Timer(seconds, stopping.set)
            timer.daemon = True
            timer.start()
        published_feed = publish_feed(
            live,
            sensor_layout(channels),
            settings,
            stopping=stopping,
            report=report,
            connected=lambda: stderr.print(f"connected: {escape_markup(address)}", soft_wrap=True),
            spool=_spool(spool, address, spool_megabytes) if keep and live.gives_blocks else None,
        )
    if as_json:
        print_json(_feed_json(published_feed, channels.turbine))
    else:
        _print(published_feed, channels.turbine, blocks=live.gives_blocks)


def _spool(folder: Path | None, source: str, megabytes: float) -> "Spool | None":
    """The spool of a source; without a folder of its own where nothing can be written, none."""
    from pipeline.sources.spool import Spool, SpoolError, default_folder

    if not megabytes > 0:
        raise InputError(f"--spool-megabytes is {megabytes:g}; a number above 0 is needed")
    if folder is not None:
        return Spool(folder, most_megabytes=megabytes)
    try:
        return Spool(default_folder(source, os.environ), most_megabytes=megabytes)
    except SpoolError as error:
        stderr.print(
            f"{escape_markup(str(error))}; blocks are kept in memory alone", soft_wrap=True
        )
        return None


def _sniff(address: str, seconds: float) -> None:
    """Print topics, channels and a mapping of what comes in some seconds."""
    from sensors.feeds.address import parsed
    from sensors.feeds.open_feed import captured_messages
    from sensors.feeds.payloads.sniff import sniffed
    from sensors.feeds.protocol import printable

    if parsed(address).scheme.endswith("opcua"):
        _list_variables(address)
        return
    with stop_on_signals() as stopping:
        messages = captured_messages(address, seconds, stopping)
    if not messages:
        raise InputError(f"{address}: no message came in {seconds:g} s")
    for topic, count in Counter(topic for topic, _ in messages).most_common(20):
        output.print(f"{count:6d}  {printable(topic, 100)}", markup=False)
    example = messages[-1][1]
    output.print(printable(example[:400].decode("utf-8", "replace"), 400), markup=False)
    found = sniffed(messages)
    if not found.mapping and found.reason:
        raise InputError(
            f"{address}: no mapping is proposed: {found.reason} (docs/pages/live.md, Messages of "
            "other shapes)"
        )
    if not found.mapping:
        raise InputError(
            f"{address}: no preset reads these messages, and no mapping was found; a file with "
            "[mapping], time = KEY, values = KEY and rate = KEY reads them, named in the address "
            "by ?mapping=FILE (docs/pages/live.md, Messages of other shapes)"
        )
    for name, samples in found.channels.items():
        output.print(f"{samples:6d}  samples of {printable(name, 100)}", markup=False)
    output.print(
        f"{found.sampling_rate:g} Hz, units {', '.join(found.units) or 'not given'}, "
        f"{found.refused} of {len(messages)} messages not read",
        markup=False,
    )
    if found.is_text:
        output.print("The numbers are text: those of the layout's channels are read.", markup=False)
    output.print(_advice(found.mapping, found.toml), markup=False)


def _list_variables(address: str) -> None:
    """Print an OPC UA server's variables: path, node id, present value and its age."""
    from sensors.acquisition.blocks import NANOSECONDS
    from sensors.feeds.open_feed import listed_variables
    from sensors.feeds.protocol import printable

    found = listed_variables(address)
    if not found:
        raise InputError(f"{address}: the server has no variable that this user can see")
    for each in found:
        age = (
            "no time"
            if each.time_ns is None
            else (f"{max(0.0, time.time() - each.time_ns / NANOSECONDS):.1f} s ago")
        )
        content = printable(str(each.content), 40)
        output.print(
            f"{printable(each.path, 60)}  {printable(each.node_id, 60)}  {content}  {age}",
            markup=False, highlight=False, soft_wrap=True,
        )  # fmt: skip


def _advice(mapping: str, toml: str) -> str:
    if toml:
        return f"write this into mapping.toml, and use ?mapping=mapping.toml:\n{toml}"
    return "no mapping is needed" if mapping == "json" else f"use ?mapping={mapping}"


def _feed_json(published_feed: Any, turbine: str) -> dict[str, Any]:
    status = published_feed.status
    return {
        "turbine": turbine,
        "blocks": published_feed.blocks,
        "scada_samples": published_feed.scada_samples,
        "received": status.received[0].count,
        **fields_of(status, "lost", "late", "duplicate"),
        "refused": status.malformed,
        "warnings": [{"code": each.code, "text": each.text} for each in status.warnings],
    }


def _print(published_feed: Any, turbine: str, *, blocks: bool) -> None:
    status = published_feed.status
    given = (
        count_noun(published_feed.blocks, "block")
        if blocks
        else count_noun(published_feed.scada_samples, "SCADA sample")
    )
    output.print(
        f"{given} of {turbine} published; "
        f"{count_noun(status.received[0].count, 'message')} received, "
        f"{status.lost} lost, {status.late} late, {status.duplicate} duplicate, "
        f"{status.malformed} refused",
        soft_wrap=True,
        markup=False,
    )
    for warning in status.warnings:  # untrusted text: no markup
        output.print(warning.text, soft_wrap=True, markup=False)


def certificates(
    folder: Annotated[Path, typer.Argument(help="Folder of certificates and configurations.")],
    unit: Annotated[
        list[str] | None,
        typer.Option("--unit", help="TURBINE/UNIT that may publish; repeatable. Name all of them."),
    ] = None,
    viewer: Annotated[
        list[str] | None, typer.Option("--viewer", help="A name that may only read; repeatable.")
    ] = None,
    node: Annotated[
        list[str] | None,
        typer.Option(
            "--node",
            help="A name of a machine that may read and publish results, for `pilewatch node "
            "identification` and `updating`; repeatable.",
        ),
    ] = None,
    host: Annotated[
        str, typer.Option(help="Name or address at which the shore station listens.")
    ] = "localhost",
    port: Annotated[int, typer.Option(help="Its port.")] = 7447,
    as_json: JsonOption = False,
) -> None:
    """Make TLS certificates and Zenoh configurations with access control.

    Existing certificates are kept; the configurations are written again. Keep FOLDER out of
    version control.
    """
    from pipeline.deploy.access import SHORE, parse_unit, write_configurations
    from pipeline.deploy.certificates import certificate_warnings, make_certificates

    if not 0 < port <= HIGHEST_PORT:
        raise InputError(f"--port is {port}; a port is 1 to {HIGHEST_PORT}")
    units = [parse_unit(text) for text in unit or ()]
    viewers, nodes = viewer or [], node or []
    names = [SHORE, *(each.name for each in units), *viewers, *nodes]
    if not names[1:]:
        raise InputError(
            "no client is named: give --unit TURBINE/UNIT, --viewer NAME or --node NAME"
        )
    made = make_certificates(folder, names, host=host)
    warnings = certificate_warnings(folder, names, host=host)
    written = write_configurations(folder, units, viewers, nodes, host=host, port=port)
    if as_json:
        paths = [str(path) for path in written]
        print_json({"new": made, "written": paths, "warnings": warnings})
        return
    output.print(f"new certificates: {', '.join(made) or 'none'}", soft_wrap=True, markup=False)
    for warning in warnings:
        output.print(warning, soft_wrap=True, markup=False)
    print_written(written)
    output.print(
        "On the shore: pilewatch run --source live --scenario my.toml "
        f"--zenoh-config {escape_markup(str(folder))}/{SHORE}.json5"
    )


def publish(
    source: Annotated[str, typer.Option(help="replay:FILE (or a folder) or simulate:SCENARIO.")],
    scenario: ScenarioOption = None,
    speed: Annotated[str, typer.Option(help="1: real time; 10: ten times faster; max.")] = "1",
    spool: SpoolOption = None,
    keep: KeepOption = True,
    spool_megabytes: SpoolMegabytesOption = 500.0,
    connect: ConnectOption = None,
    listen: ListenOption = None,
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Publish a source to listening sessions (`pilewatch run --source live`)."""
    from pipeline.sources.publisher import publish_source

    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    factor = speed_of(speed)
    opened = _published(source, scenario)
    with stop_on_signals() as stopping, progress(opened.text, opened.duration) as report:
        count = publish_source(
            opened,
            settings,
            speed=factor,
            stopping=stopping,
            report=report,
            spool=_spool(spool, opened.text, spool_megabytes) if keep else None,
        )
    if as_json:
        print_json({"blocks": count, "turbines": list(opened.turbines)})
        return
    n_turbines = len(opened.turbines)
    turbines = f"{n_turbines} turbines" if n_turbines > 1 else opened.layout.turbine
    output.print(f"{count} blocks of {escape_markup(turbines)} published")


def _published(source: str, scenario: str | None) -> "Source | RecordedSource":
    """Return a replay as a tower unit has it, without structure and scipy; else any source."""
    from pipeline.sources.recorded_source import recorded_source

    kind, _, name = source.partition(":")
    if kind == "replay" and name and scenario is None:
        return recorded_source(Path(name))
    from pipeline.sources.sources import open_source

    return open_source(source, scenario)


def control(
    action: Annotated[
        Literal["play", "pause", "seek", "speed", "state"],
        typer.Argument(help="What to do; state: report position and speed."),
    ],
    value: Annotated[
        float | None, typer.Argument(help="seek: seconds from the first sample; speed: a factor.")
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of the replay; default: the session in --out."),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the running session.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """Pause, play, seek or change the speed of a running replay."""
    from pipeline.monitoring.status import endpoint_of
    from pipeline.sources.replay_control import REPLAY_KEY
    from pipeline.transport.zenoh_bus import asked

    if action in ("seek", "speed") and value is None:
        raise InputError(f"control {action} needs a value, e.g. `pilewatch control {action} 10`")
    endpoint: Any = zenoh_settings("peer", None, None, zenoh_config)
    if zenoh_config is None:
        endpoint = endpoint_of(out) if connect is None else connect
    request = json.dumps({"do": action, "value": value}).encode()
    answers = [json.loads(each) for each in asked(endpoint, f"{REPLAY_KEY}/*", request)]
    if not answers:
        raise InputError("no replay runs there")
    for answer in answers:
        if "error" in answer:
            raise InputError(answer["error"])
    if as_json:
        output.print_json(json.dumps(answers))
        return
    for answer in answers:
        pace = "as fast as possible" if answer["speed"] is None else f"{answer['speed']:g} ×"
        state = "playing" if answer["playing"] else "paused"
        source = escape_markup(answer["source"])
        output.print(f"{source}: {state} at {answer['position_s']:.1f} s, {pace}")
