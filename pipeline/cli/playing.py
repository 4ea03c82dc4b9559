"""`pilewatch publish` and `pilewatch control`: a source by itself, and its play and pause."""

import json
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
    output,
    progress,
    speed_of,
    stopped_by_signals,
    zenoh_settings,
)
from sensors.errors import InputError


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
    from pipeline.sources.sources import open_source

    settings = zenoh_settings(mode, listen, connect, zenoh_config)
    factor = speed_of(speed)
    opened = open_source(source, scenario)
    with stopped_by_signals() as stopping, progress(opened.text, opened.duration) as report:
        count = publish_source(opened, settings, speed=factor, stopping=stopping, report=report)
    n_turbines = len(opened.turbines)
    whose = f"{n_turbines} turbines" if n_turbines > 1 else opened.layout.turbine
    output.print(f"{count} blocks of {whose} published")


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
