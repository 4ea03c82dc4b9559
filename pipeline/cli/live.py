"""`pilewatch feed`: a live instrument, published as any other sensor is."""

import json
import threading
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.console import (
    ConnectOption,
    JsonOption,
    ListenOption,
    ModeOption,
    ScenarioOption,
    ZenohConfigOption,
    escaped,
    output,
    people,
    progress,
    speed_of,
    stopped_by_signals,
    zenoh_settings,
)
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.sources.recorded_source import RecordedSource
    from pipeline.sources.sources import Source


def feed(
    address: Annotated[
        str,
        typer.Argument(
            help="mqtt://HOST/TOPIC, seedlink://HOST/NET.STA, udp://:PORT, scada+mqtt://HOST/TOPIC "
            "or scada+csv:FILE; s. README, Live instruments."
        ),
    ],
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML that says where its channels are; else the scenario's sensors."),
    ] = None,
    scenario: ScenarioOption = None,
    turbine: Annotated[
        str | None, typer.Option(help="That it belongs to; else the layout's.")
    ] = None,
    once: Annotated[
        bool, typer.Option("--once", help="Give up where nobody answers at the start.")
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
        raise InputError(f"--for {seconds:g} is no time; a positive number of seconds is needed")
    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    if layout is not None and scenario is not None:
        raise InputError(
            f"--layout {layout} and --scenario {scenario}: both say where the channels are"
        )
    channels = channels_of(layout, scenario)
    if turbine is not None:
        channels = replace(channels, turbine=turbine)
    live = open_feed(address, channels, once=once)
    with stopped_by_signals() as stopping, progress(address, None) as report:
        if seconds is not None:
            timer = threading.Timer(seconds, stopping.set)
            timer.daemon = True
            timer.start()
        fed = publish_feed(
            live,
            sensor_layout(channels),
            settings,
            stopping=stopping,
            report=report,
            connected=lambda: people.print(f"connected: {escaped(address)}", soft_wrap=True),
        )
    _print(fed, channels.turbine, blocks=live.gives_blocks)


def _print(fed: Any, turbine: str, *, blocks: bool) -> None:
    status = fed.status
    given = counted(fed.blocks, "block") if blocks else counted(fed.scada_samples, "SCADA sample")
    output.print(
        f"{given} of {turbine} published; {counted(status.received[0].count, 'message')} received, "
        f"{status.lost} lost, {status.late} late, {status.duplicate} twice, "
        f"{status.malformed} refused",
        soft_wrap=True,
        markup=False,
    )
    for doubt in status.warnings:  # in a stranger's words, perhaps
        output.print(doubt.text, soft_wrap=True, markup=False)


def counted(number: int, what: str) -> str:
    """`1 block`, `2 blocks`."""
    return f"{number} {what}{'s' * (number != 1)}"


def certificates(
    folder: Annotated[Path, typer.Argument(help="Where certificates and configurations go.")],
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

    What exists is kept; the configurations are written anew. Keep FOLDER out of version control.
    """
    from pipeline.deploy.access import SHORE, parse_unit, write_configurations
    from pipeline.deploy.certificates import AUTHORITY, make_certificates

    units = [parse_unit(text) for text in unit or ()]
    names = [SHORE, *(each.name for each in units), *(viewer or ())]
    taken = {name for name in names if names.count(name) > 1 or name == AUTHORITY}
    if taken:
        raise InputError(f"{', '.join(sorted(taken))} cannot name two machines or the authority")
    if not units and not viewer:
        raise InputError("nobody may connect: name --unit TURBINE/UNIT or --viewer NAME")
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
    """Publish a source to sessions that listen (`pilewatch run --source live`), nothing else."""
    from pipeline.sources.publisher import publish_source

    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    factor = speed_of(speed)
    opened = _published(source, scenario)
    with stopped_by_signals() as stopping, progress(opened.text, opened.duration) as report:
        count = publish_source(opened, settings, speed=factor, stopping=stopping, report=report)
    n_turbines = len(opened.turbines)
    whose = f"{n_turbines} turbines" if n_turbines > 1 else opened.layout.turbine
    output.print(f"{count} blocks of {whose} published")


def _published(source: str, scenario: str | None) -> "Source | RecordedSource":
    """A replay as a tower unit has it, without structure and scipy; else any source."""
    from pipeline.sources.recorded_source import recorded_source

    kind, _, name = source.partition(":")
    if kind == "replay" and name and scenario is None:
        return recorded_source(Path(name))
    from pipeline.sources.sources import open_source

    return open_source(source, scenario)


def control(
    action: Annotated[str, typer.Argument(help="play, pause, seek, speed or state.")],
    value: Annotated[
        float | None, typer.Argument(help="seek: seconds from the first sample; speed: a factor.")
    ] = None,
    connect: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint of what plays; otherwise the session in --out."),
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session that runs.")] = Path("out"),
    as_json: JsonOption = False,
) -> None:
    """Pause, go on, seek or change the speed of a replay that runs."""
    from pipeline.monitoring.status import endpoint_of
    from pipeline.sources.replay_control import ACTIONS, KEY
    from pipeline.transport.zenoh_bus import asked

    if action not in ACTIONS:
        raise InputError(f"{action!r} is none of {', '.join(ACTIONS)}")
    whom: Any = zenoh_settings("peer", None, None, zenoh_config)
    if zenoh_config is None:
        whom = endpoint_of(out) if connect is None else connect
    request = json.dumps({"do": action, "value": value}).encode()
    answers = [json.loads(each) for each in asked(whom, f"{KEY}/*", request)]
    if not answers:
        raise InputError("nothing is being played there")
    for answer in answers:
        if "error" in answer:
            raise InputError(answer["error"])
    if as_json:
        output.print_json(json.dumps(answers))
        return
    for answer in answers:
        pace = "as fast as it can be" if answer["speed"] is None else f"{answer['speed']:g} ×"
        state = "playing" if answer["playing"] else "paused"
        output.print(f"{answer['source']}: {state} at {answer['position_s']:.1f} s, {pace}")
