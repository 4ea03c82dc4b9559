"""`pilewatch run` and `pilewatch node`: a run, and one of its nodes."""

import json
import os
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from pipeline.cli.console import (
    VIEW_HELP,
    ConnectOption,
    JsonOption,
    ListenOption,
    ModeOption,
    SamplerOption,
    ScenarioOption,
    ZenohConfigOption,
    escape_markup,
    open_view,
    output,
    print_written,
    progress,
    speed_of,
    stop_on_signals,
    zenoh_settings,
)
from pipeline.cli.results import print_results
from pipeline.state.phrases import count_noun
from sensors.errors import InputError


def run(
    source: Annotated[
        str | None,
        typer.Option(
            help="replay:FILE (or a folder of files), simulate:SCENARIO, live, an instrument "
            "(such as mqtt://HOST/TOPIC), or a file of measurements (CSV, Parquet, …), which "
            "is imported. Without it, recordings/parked.mcap is replayed, or the recording and "
            "scenario.toml of a folder that `new` made."
        ),
    ] = None,
    scenario: ScenarioOption = None,
    layout: Annotated[
        list[Path] | None,
        typer.Option(
            help="TOML file of the channels of a file or an instrument; with --source live one of "
            "each acquisition unit, repeatable."
        ),
    ] = None,
    speed: Annotated[
        str,
        typer.Option(help="max: as fast as the nodes process; 1: real time; 10: ten times faster."),
    ] = "max",
    start: Annotated[
        float, typer.Option("--from", help="Replay from here on [s from the first sample].")
    ] = 0.0,
    end: Annotated[
        float | None, typer.Option("--to", help="Replay up to here [s from the first sample].")
    ] = None,
    loop: Annotated[int, typer.Option(help="Number of replays, one after the other.")] = 1,
    out: Annotated[Path, typer.Option(help="Folder for session.mcap, .rrd, summary.json.")] = Path(
        "out"
    ),
    view: Annotated[
        str | None,
        typer.Option(help=VIEW_HELP),
    ] = None,
    rrd: Annotated[bool, typer.Option(help="Write out/session.rrd for the Rerun viewer.")] = True,
    sampler: SamplerOption = None,
    processes: Annotated[
        bool, typer.Option("--processes", help="Each node in a process of its own.")
    ] = False,
    shards: Annotated[
        int,
        typer.Option(help="With --processes: number of processes that share a farm's turbines."),
    ] = 1,
    elsewhere: Annotated[
        list[str] | None,
        typer.Option(
            help="A node that runs on other machines (`node NAME --shard …`); live sources only."
        ),
    ] = None,
    lock_step: Annotated[
        bool, typer.Option("--lock-step", help="One thread, no transport; for checks.")
    ] = False,
    listen: ListenOption = None,
    connect: ConnectOption = None,
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Ignore existing checkpoints."),
    ] = False,
    metrics: Annotated[
        int | None, typer.Option(help="Port on this machine for Prometheus: /metrics.")
    ] = None,
    notices: Annotated[
        Path | None,
        typer.Option(help="TOML file: recipients of alarms on changes, gaps and faults."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Estimate the foundation's stiffness from accelerations."""
    from pipeline.monitoring.alarms.settings import load_notices
    from pipeline.run.processes import require_processes
    from pipeline.run.run import run_session
    from pipeline.runtime.node_thread import busy_nodes
    from pipeline.sources.feed_publisher import feed_source
    from pipeline.sources.recorded_stream import Playback
    from pipeline.sources.sources import default_scenario, open_source
    from sensors.feeds.address import is_feed

    if source is None and scenario is None:
        scenario = default_scenario()
    if processes and lock_step:
        raise InputError("--processes and --lock-step exclude each other; choose one")
    if lock_step and (zenoh_config or listen or connect or mode != "peer"):
        raise InputError(
            "--lock-step has no transport: --zenoh-config, --listen, --connect and --mode are for "
            "threads and --processes"
        )
    options = _session_options(
        out=out,
        speed=speed,
        way="processes" if processes else "lock-step" if lock_step else "threads",
        rrd=rrd,
        zenoh=zenoh_settings(mode, listen, connect, zenoh_config),
        fresh=fresh,
        shards=shards,
        elsewhere=tuple(elsewhere or ()),
    )
    alarm_settings = None if notices is None else load_notices(notices)
    options = replace(options, metrics=metrics, notices=alarm_settings)
    require_processes(options)
    playback = Playback(start, float("inf") if end is None else end, loop)
    if source is not None and is_feed(source):
        if processes:
            raise InputError(
                f"--processes and --source {source}: run `pilewatch feed {source}` beside "
                "`pilewatch run --source live --processes`"
            )
        one = _one_layout(layout, source)
        opened = feed_source(source, one, scenario, state=None if fresh else out)
    elif source is not None and Path(source).is_file():
        imported = _imported(source, out, _one_layout(layout, source), scenario)
        opened = open_source(imported, scenario)
    else:
        opened = open_source(source, scenario, layout or ())
    opened = opened.with_sampler(sampler).with_playback(playback)
    with stop_on_signals() as stopping, open_view(view) as shown:
        with progress(opened.text, opened.duration) as report:
            session = run_session(
                opened,
                replace(options, view=shown.output),
                report=report,
                scenario_option=scenario,
                stopping=stopping,
            )
        if as_json:
            output.print_json(json.dumps(session.figures))
        else:
            _print_session(session, opened)
            turbines = [each["turbine"] for each in session.figures.get("turbines", ())]
            if len(turbines) > 1:
                pooled = any(each["posterior"] for each in session.figures["turbines"])
                shown_of = session.figures["turbine"]
                note = farm_note(turbines, shown_of, out, pooled=pooled)
                output.print(escape_markup(note), soft_wrap=True)
        shown.wait(stopping)
    if not session.complete:
        raise typer.Exit(2)
    if busy_nodes():  # an interpreter that ends beneath a thread at work aborts
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(0)


def _one_layout(layouts: Sequence[Path] | None, source: str) -> Path | None:
    """Return the layout of the only unit of a source."""
    if layouts is not None and len(layouts) > 1:
        raise InputError(
            f"--layout is given {len(layouts)} times; {source} is one unit: several units publish "
            "by `pilewatch feed` to `pilewatch run --source live`"
        )
    return layouts[0] if layouts else None


def _imported(source: str, out: Path, layout: Path | None, scenario: str | None) -> str | None:
    """Import a file of measurements into `out`; return the recording as a source."""
    from pipeline.sources.import_files import imported_source

    with progress(f"importing {source}", None) as report:
        return imported_source(Path(source), out, layout=layout, scenario=scenario, report=report)


def _session_options(
    *,
    out: Path,
    speed: str,
    way: Any,
    rrd: bool,
    zenoh: Any,
    fresh: bool,
    shards: int = 1,
    elsewhere: tuple[str, ...] = (),
) -> Any:
    from pipeline.run.options import SessionOptions

    if out.exists() and not out.is_dir():  # before anything is noted of the source
        raise InputError(f"--out {out}: File exists; a folder is needed")
    return SessionOptions(
        out=out,
        speed=speed_of(speed),
        way=way,
        rrd=rrd,
        fresh=fresh,
        zenoh=zenoh,
        shards=shards,
        elsewhere=elsewhere,
    )


def farm_note(turbines: Sequence[str], shown: str, out: Path, *, pooled: bool) -> str:
    """Return a note on whose results were printed, and where the others are.

    Parameters
    ----------
    turbines : sequence of str
        All that ran.
    shown : str
        The one whose results were printed.
    out : Path
        Folder of the session.
    pooled : bool
        Whether there are posteriors that a farm can pool.
    """
    command = f"pilewatch farm {out}" if pooled else f"pilewatch report {out}"
    return (
        f"These are the results of {shown}, one of {len(turbines)} turbines; all of them: {command}"
    )


def _or_unknown(count: int | None) -> str:
    return "unknown" if count is None else str(count)


def _print_session(session: Any, source: Any) -> None:
    figures = session.figures
    print_results(session.summary, figures, scenario=source.scenario, layout=source.layout)
    stream, timing = figures["stream"], figures["timing"]
    output.print(
        f"{count_noun(stream['published'], 'block')} published, "
        f"{_or_unknown(stream['recorded'])} recorded, "
        f"{_or_unknown(stream['lost'])} lost, {stream['recovered']} recovered, "
        f"{stream['late']} late, {stream['duplicate']} duplicate; "
        f"{_measured(figures)} in {timing['wall_s']:.1f} s"
    )
    print_written(session.files)
    for pictures in (path for path in session.files if path.suffix == ".rrd"):
        output.print(escape_markup(f"Open it: rerun {pictures}"), soft_wrap=True)


def _measured(figures: dict[str, Any]) -> str:
    """Return how long was measured, and over how long where pauses lie between."""
    measured, whole = f"{figures['measured_s']:.0f}", f"{figures['duration_s']:.0f}"
    return f"{measured} s of measurements" + (f" over {whole} s" if whole != measured else "")


def node(
    name: Annotated[
        Literal["identification", "updating", "recorder", "viewer"],
        typer.Argument(help="Which node of the graph."),
    ],
    connect: ConnectOption = None,
    listen: ListenOption = None,
    mode: ModeOption = "peer",
    zenoh_config: ZenohConfigOption = None,
    scenario: ScenarioOption = None,
    recording: Annotated[
        Path | None,
        typer.Option(help="Recording with the sensor layout, and the scenario unless given."),
    ] = None,
    layout: Annotated[
        list[Path] | None,
        typer.Option(help="Without --recording: as in `run --source live`, the same files."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for what the node writes.")] = Path("out"),
    view: Annotated[str | None, typer.Option(help="For the viewer: as in `run`.")] = None,
    rrd: Annotated[bool, typer.Option(help="For the viewer: write session.rrd.")] = True,
    sampler: SamplerOption = None,
    shard: Annotated[
        str | None,
        typer.Option(help="1/4: the first of four parts of a farm's turbines."),
    ] = None,
    tied: Annotated[
        bool, typer.Option("--tied", help="Stop when standard input ends, with the parent process.")
    ] = False,
    fresh: Annotated[
        bool,
        typer.Option("--fresh", help="Ignore existing checkpoints."),
    ] = False,
) -> None:
    """Run one node of the graph until Ctrl-C or SIGTERM."""
    from pipeline.nodes.sharding import parsed_shard
    from pipeline.run.run import run_node
    from pipeline.runtime.supervisor import stopped_with_parent
    from pipeline.sources.sources import open_source

    options = _session_options(
        out=out,
        speed="max",
        way="processes",
        rrd=rrd,
        zenoh=zenoh_settings(mode, listen, connect, zenoh_config),
        fresh=fresh,
    )
    if shard is not None:
        parsed_shard(shard)  # a mistake in it is one line, before what is noted of the source
    if name == "updating" and recording is None and scenario is None:
        raise InputError(  # before it is noted that modes alone are tracked
            "updating needs a structure: give --scenario NAME or FILE.toml, or --recording with one"
        )
    name_of_source = "live" if recording is None else f"replay:{recording}"
    opened = open_source(name_of_source, scenario, layout or ())
    source = opened.with_sampler(sampler)
    with stop_on_signals() as stopping, open_view(view) as shown:
        if tied:
            stopped_with_parent(stopping)
        options = replace(options, view=shown.output)
        run_node(name, source, options, stopping, shard, tied=tied)
