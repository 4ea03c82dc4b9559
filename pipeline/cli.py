"""The commands: thin, each a few lines around a function that does the work.

Exit codes: 0 done; 2 something the user gave is wrong (one line says what); 1 a bug or a node that
failed.
"""

import json
import logging
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.logging import RichHandler
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from pipeline.errors import NodeFailed
from sensors.errors import InputError

if TYPE_CHECKING:
    from sensors.blocks import AccelerationBlock

app = typer.Typer(
    help="Watch an offshore wind turbine's foundation through its tower's accelerations.",
    epilog="Start with `pilewatch run`: it replays recordings/parked.mcap and writes out/.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
people = Console(stderr=True)  # progress, warnings, errors
output = Console()  # results

ScenarioOption = Annotated[
    str | None,
    typer.Option(help="A shipped scenario (e.g. parked) or a TOML file of your own."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


def main() -> None:
    """Entry point of `pilewatch`: a user's mistake becomes one line and exit code 2."""
    logging.basicConfig(
        level=logging.WARNING,
        format="%(message)s",
        handlers=[RichHandler(console=people, show_path=False)],
    )
    try:
        app()
    except InputError as error:
        people.print(f"[bold red]pilewatch:[/] {_escaped(str(error))}", soft_wrap=True)
        sys.exit(2)
    except NodeFailed as failure:
        logging.getLogger(__name__).debug("a node failed", exc_info=True)
        people.print(f"[bold red]pilewatch:[/] {_escaped(str(failure))}", soft_wrap=True)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit(130)


def _escaped(text: str) -> str:
    return text.replace("[", r"\[")


@app.command()
def run(
    source: Annotated[
        str | None,
        typer.Option(
            help="replay:FILE, simulate:SCENARIO or live. "
            "Without it, recordings/parked.mcap is replayed."
        ),
    ] = None,
    scenario: ScenarioOption = None,
    speed: Annotated[
        str,
        typer.Option(help="max: as fast as the nodes follow; 1: real time; 10: ten times faster."),
    ] = "max",
    out: Annotated[Path, typer.Option(help="Folder for session.mcap, .rrd, summary.json.")] = Path(
        "out"
    ),
    view: Annotated[
        str | None,
        typer.Option(help="spawn: open the Rerun viewer; connect=URL: stream to one that runs."),
    ] = None,
    rrd: Annotated[bool, typer.Option(help="Write out/session.rrd for the Rerun viewer.")] = True,
    sampler: Annotated[
        str | None,
        typer.Option(help="importance (default), emcee, tmcmc or tmcmc-published."),
    ] = None,
    processes: Annotated[
        bool, typer.Option("--processes", help="Each node in a process of its own.")
    ] = False,
    lock_step: Annotated[
        bool, typer.Option("--lock-step", help="One thread, no transport; for checks.")
    ] = False,
    listen: Annotated[
        str | None,
        typer.Option(help="Zenoh endpoint to listen on, e.g. tcp/127.0.0.1:7447."),
    ] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option(help="Zenoh endpoint to connect to, e.g. tcp/10.0.0.5:7447; repeatable."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Turn accelerations into a posterior of the foundation's stiffness."""
    from pipeline.session import run_session
    from pipeline.sources import open_source

    if processes and lock_step:
        raise InputError("--processes and --lock-step exclude each other; choose one")
    options = _session_options(
        out=out,
        speed=speed,
        way="processes" if processes else "lock-step" if lock_step else "threads",
        rrd=rrd,
        view=view,
        listen=listen,
        connect=connect,
    )
    opened = open_source(source, scenario).with_sampler(sampler)
    with _stopped_by_signals() as stopping, _progress(f"{opened.text}", opened.duration) as report:
        session = run_session(
            opened, options, report=report, scenario_option=scenario, stopping=stopping
        )
    if as_json:
        output.print_json(json.dumps(session.figures))
    else:
        _print_session(session)


def _session_options(
    *,
    out: Path,
    speed: str,
    way: Any,
    rrd: bool,
    view: str | None,
    listen: str | None,
    connect: list[str] | None,
) -> Any:
    from pipeline.session import SessionOptions
    from pipeline.transport.zenoh_bus import ZenohSettings
    from pipeline.viewer.outputs import parse_view

    return SessionOptions(
        out=out,
        speed=_speed(speed),
        way=way,
        rrd=rrd,
        view=None if view is None else parse_view(view),
        zenoh=ZenohSettings(
            listen=() if listen is None else (listen,), connect=tuple(connect or ())
        ),
    )


def _speed(text: str) -> float:
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = float("nan")
    if not speed > 0:
        raise InputError(f"--speed {text} is neither 'max' nor a positive number")
    return speed


def _print_session(session: Any) -> None:
    from pipeline.tables import identified_modes_table, posterior_table

    figures = session.figures
    output.print(identified_modes_table(session.summary.modes, figures["windows"]["identified"]))
    if session.summary.posterior is None:
        output.print("[bold]No posterior:[/] no window could be used.")
    else:
        output.print(posterior_table(figures["posterior"]))
    for event in figures["events"]:
        output.print(f"[bold]change:[/] {_escaped(event['text'])}")
    for rejected in figures["windows"]["rejected"]:
        output.print(f"window at {rejected['start']:.0f} s not used: {rejected['reason']}")
    for warning in figures["warnings"]:
        output.print(f"[yellow]{warning['code']}[/]: {_escaped(warning['text'])}")
    stream, timing = figures["stream"], figures["timing"]
    output.print(
        f"{stream['published']} blocks published, {stream['recorded']} recorded, "
        f"{stream['lost']} lost, {stream['late']} late; "
        f"{figures['duration_s']:.0f} s of measurements in {timing['wall_s']:.1f} s"
    )
    output.print("Written: " + ", ".join(str(path) for path in session.files), soft_wrap=True)
    if any(path.suffix == ".rrd" for path in session.files):
        output.print(f"Look at it: rerun {session.files[1]}", soft_wrap=True)


@app.command()
def simulate(
    scenario: Annotated[
        str | None, typer.Argument(help="A shipped scenario or a TOML file.")
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The MCAP file to write.")] = None,
    duration: Annotated[
        float | None, typer.Option(help="Duration [s], instead of the scenario's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the scenario's.")] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the shipped scenarios.")] = False,
    describe: Annotated[
        str | None, typer.Option(help="Say what a scenario simulates, and simulate nothing.")
    ] = None,
) -> None:
    """Simulate a scenario's turbine and record what its sensors say."""
    from pipeline.scenario import load_scenario, shipped_scenarios, with_overrides
    from pipeline.sources import record_simulation, simulated
    from pipeline.tables import scenario_description, scenarios_table

    if show_list:
        output.print(scenarios_table([load_scenario(name) for name in shipped_scenarios()]))
        return
    if describe is not None:
        output.print(scenario_description(load_scenario(describe)), highlight=False)
        return
    if scenario is None or out is None:
        raise InputError(
            "simulate needs a scenario and -o FILE.mcap; `pilewatch simulate --list` shows the "
            "scenarios that come with it"
        )
    chosen = with_overrides(load_scenario(scenario), duration=duration, seed=seed)
    source = simulated(chosen)
    with _progress(source.text, source.duration) as report:
        record_simulation(source, out, report=report)
    output.print(f"{out}: {out.stat().st_size / 1e6:.2f} MB", soft_wrap=True)


@app.command()
def identify(
    file: Annotated[
        Path,
        typer.Argument(
            help="An MCAP recording, or a CSV of channels: a header row; a time column called "
            "t, time or timestamp, its unit in brackets; channel units in brackets."
        ),
    ],
    sampling_rate: Annotated[
        float | None, typer.Option(help="[Hz]; needed where the file has no time column.")
    ] = None,
    window: Annotated[
        float | None, typer.Option(help="[s]; without it the whole file is one window.")
    ] = None,
    lowest_frequency: Annotated[
        float | None, typer.Option(help="Lowest mode sought [Hz]; without it from the record.")
    ] = None,
    highest_frequency: Annotated[
        float | None, typer.Option(help="Highest mode sought [Hz]; without it from the rate.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Find the modes of the structure in a file; needs no turbine."""
    from pipeline.offline import identify_file
    from pipeline.oma.settings import OmaSettings
    from pipeline.summary import combined_modes
    from pipeline.tables import identified_modes_table

    with people.status(f"identifying {file}"):
        found = identify_file(
            file,
            sampling_rate=sampling_rate,
            window=window,
            settings=OmaSettings(
                lowest_frequency=lowest_frequency, highest_frequency=highest_frequency
            ),
        )
    modes = combined_modes(found.estimates)
    for warning in found.warnings:
        people.print(f"[yellow]{warning.code}[/]: {_escaped(warning.text)}", soft_wrap=True)
    if as_json:
        figures = {
            "modes": [mode.as_json() for mode in modes],
            "warnings": [{"code": each.code, "text": each.text} for each in found.warnings],
            "windows": found.windows_json(),
            "sampling_rate_hz": found.sampling_rate,
            "duration_s": found.duration,
            "channels": list(found.channels),
        }
        output.print_json(json.dumps(figures))
    else:
        output.print(identified_modes_table(modes, len(found.estimates)))


@app.command()
def modes(
    theta: Annotated[
        str | None,
        typer.Option(help="k11,k22,k12 as ratios to nominal, e.g. 1,0.9,1."),
    ] = None,
    sign: Annotated[
        str | None, typer.Option(help="Sign convention of k12: published or embedded-pile.")
    ] = None,
    turbine: Annotated[
        str | None, typer.Option(help="A shipped turbine or a TOML description of your own.")
    ] = None,
    scenario: ScenarioOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print the model's modes: Table 1's eleven first, then the others that sensors can see."""
    from pipeline.model_modes import model_modes
    from pipeline.tables import model_modes_table

    with people.status("solving the model"):
        found = model_modes(theta=theta, sign=sign, turbine=turbine, scenario=scenario)
    if as_json:
        output.print_json(json.dumps({"modes": found.as_json()}))
    else:
        output.print(model_modes_table(found))


@app.command()
def node(
    name: Annotated[str, typer.Argument(help="identification, updating, recorder or viewer.")],
    connect: Annotated[
        list[str] | None, typer.Option(help="Zenoh endpoint to connect to; repeatable.")
    ] = None,
    listen: Annotated[str | None, typer.Option(help="Zenoh endpoint to listen on.")] = None,
    scenario: ScenarioOption = None,
    recording: Annotated[
        Path | None,
        typer.Option(help="Take sensor layout (and scenario, unless given) from this recording."),
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for what the node writes.")] = Path("out"),
    view: Annotated[str | None, typer.Option(help="For the viewer: spawn or connect=URL.")] = None,
    rrd: Annotated[bool, typer.Option(help="For the viewer: write session.rrd.")] = True,
    sampler: Annotated[str | None, typer.Option(help="For updating: as in `run`.")] = None,
) -> None:
    """Run one node of the graph by itself until it is told to stop (Ctrl-C or SIGTERM)."""
    from pipeline.session import run_node
    from pipeline.sources import open_source

    options = _session_options(
        out=out, speed="max", way="processes", rrd=rrd, view=view, listen=listen, connect=connect
    )
    opened = open_source("live" if recording is None else f"replay:{recording}", scenario)
    source = opened.with_sampler(sampler)
    with _stopped_by_signals() as stopping:
        run_node(name, source, options, stopping)


@app.command()
def info(
    file: Annotated[Path, typer.Argument(help="An MCAP recording.")],
) -> None:
    """Show what a recording holds: channels, duration, gaps, scenario, truth."""
    from pipeline.recording.info import recording_info
    from pipeline.tables import recording_tables

    with people.status(f"reading {file}"):
        found = recording_info(file)
    for table in recording_tables(found):
        output.print(table)
    for section, texts in found.metadata.items():
        for key, text in texts.items():
            if "\n" not in text:
                output.print(f"{section}.{key} = {_escaped(text)}", soft_wrap=True)


@contextmanager
def _stopped_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set, so that files are closed before the end."""
    stopping = threading.Event()
    names = (signal.SIGINT, signal.SIGTERM)
    before = {name: signal.signal(name, lambda *_: stopping.set()) for name in names}
    try:
        yield stopping
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


@contextmanager
def _progress(
    title: str, duration: float | None
) -> Iterator["Callable[[AccelerationBlock], None]"]:
    """A bar of measured time on the error stream; gives the function that moves it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} s measured"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=people, transient=True) as progress:
        task = progress.add_task(_escaped(title), total=duration)
        yield lambda block: progress.advance(task, block.duration)
