"""`pilewatch feed`: a live instrument, published as any other sensor is."""

import threading
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from pipeline.cli.console import (
    ConnectOption,
    ListenOption,
    ModeOption,
    ScenarioOption,
    ZenohConfigOption,
    escaped,
    output,
    people,
    progress,
    stopped_by_signals,
    zenoh_settings,
)
from sensors.errors import InputError


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
