"""`pilewatch feed`, `publish`, `control`, `certificates`: live sources and replays."""

import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

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
    progress,
    speed_of,
    stderr,
    stop_on_signals,
    zenoh_settings,
)
from pipeline.cli.tables.cells import count_noun
from sensors.errors import InputError


def feed(
    address: Annotated[
        str,
        typer.Argument(
            help="mqtt://HOST/TOPIC, seedlink://HOST/NET.STA, udp://:PORT, scada+mqtt://HOST/TOPIC "
            "or scada+csv:FILE; see README, Live instruments."
        ),
    ],
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML file of its channels; default: the scenario's sensors."),
    ] = None,
    scenario: ScenarioOption = None,
    turbine: Annotated[str | None, typer.Option(help="Its turbine; default: the layout's.")] = None,
    once: Annotated[
        bool, typer.Option("--once", help="Fail if the instrument does not answer at the start.")
    ] = False,
    seconds: Annotated[
        float | None, typer.Option("--for", help="Stop after so many seconds.")
    ] = None,
    connect: ConnectOption = None,
    listen: ListenOption = None,
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Publish a live instrument (MQTT, SeedLink, UDP, SCADA) until it is stopped."""
    from pipeline.sources.feed_publisher import channels_of, publish_feed
    from sensors.feeds.assembly.channel_map import sensor_layout
    from sensors.feeds.open_feed import open_feed

    if seconds is not None and not seconds > 0:
        raise InputError(f"--for {seconds:g}: a positive number of seconds is needed")
    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    if layout is not None and scenario is not None:
        raise InputError(
            f"--layout {layout} and --scenario {scenario}: both define the channels; give one"
        )
    channels = channels_of(layout, scenario)
    if turbine is not None:
        channels = replace(channels, turbine=turbine)
    live = open_feed(address, channels, once=once)
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
        )
    _print(published_feed, channels.turbine, blocks=live.gives_blocks)


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
    host: Annotated[
        str, typer.Option(help="Name or address at which the shore station listens.")
    ] = "localhost",
    port: Annotated[int, typer.Option(help="Its port.")] = 7447,
) -> None:
    """Make TLS certificates and Zenoh configurations with access control.

    Existing certificates are kept; the configurations are written again. Keep FOLDER out of
    version control.
    """
    from pipeline.deploy.access import SHORE, parse_unit, write_configurations
    from pipeline.deploy.certificates import AUTHORITY, make_certificates

    units = [parse_unit(text) for text in unit or ()]
    names = [SHORE, *(each.name for each in units), *(viewer or ())]
    taken = {name for name in names if names.count(name) > 1 or name == AUTHORITY}
    if taken:
        raise InputError(f"{', '.join(sorted(taken))} cannot name two machines or the authority")
    if not units and not viewer:
        raise InputError("no client is named: give --unit TURBINE/UNIT or --viewer NAME")
    made = make_certificates(folder, names, host=host)
    written = write_configurations(folder, units, viewer or (), host=host, port=port)
    output.print(f"new certificates: {', '.join(made) or 'none'}", soft_wrap=True)
    output.print("Written: " + ", ".join(str(path) for path in written), soft_wrap=True)
    output.print(f"On the shore: pilewatch run --source live --zenoh-config {folder}/{SHORE}.json5")


def publish(
    source: Annotated[str, typer.Option(help="replay:FILE (or a folder) or simulate:SCENARIO.")],
    scenario: ScenarioOption = None,
    speed: Annotated[str, typer.Option(help="1: real time; 10: ten times faster; max.")] = "1",
    connect: ConnectOption = None,
    listen: ListenOption = None,
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
) -> None:
    """Publish a source to listening sessions (`pilewatch run --source live`)."""
    from pipeline.sources.publisher import publish_source
    from pipeline.sources.sources import open_source

    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    factor = speed_of(speed)
    opened = open_source(source, scenario)
    with stop_on_signals() as stopping, progress(opened.text, opened.duration) as report:
        count = publish_source(opened, settings, speed=factor, stopping=stopping, report=report)
    n_turbines = len(opened.turbines)
    turbines = f"{n_turbines} turbines" if n_turbines > 1 else opened.layout.turbine
    output.print(f"{count} blocks of {turbines} published")


def control(
    action: Annotated[str, typer.Argument(help="play, pause, seek, speed or state.")],
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
    from pipeline.sources.replay_control import ACTIONS, KEY
    from pipeline.transport.zenoh_bus import asked

    if action not in ACTIONS:
        raise InputError(f"{action!r} is none of {', '.join(ACTIONS)}")
    endpoint: Any = zenoh_settings("peer", None, None, zenoh_config)
    if zenoh_config is None:
        endpoint = endpoint_of(out) if connect is None else connect
    request = json.dumps({"do": action, "value": value}).encode()
    answers = [json.loads(each) for each in asked(endpoint, f"{KEY}/*", request)]
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
        output.print(f"{answer['source']}: {state} at {answer['position_s']:.1f} s, {pace}")
