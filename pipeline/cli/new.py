"""`pilewatch new`: from files of measurements to a folder in which a run starts."""

import shlex
import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict
from functools import cache
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.console import (
    DatesOption,
    JsonOption,
    ZoneOption,
    escape_markup,
    output,
    print_json,
    print_written,
    stderr,
)
from pipeline.state.phrases import count_noun
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.offline.new_project import NewProject, ReportedWater
    from sensors.files.channel_names import GuessedChannel, UnusedChannel
    from sensors.structure.foundation import FoundationSprings


def new(
    files: Annotated[
        list[Path], typer.Argument(help="Files of one measurement, in any format `import` reads.")
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The folder; the first file's name.")
    ] = None,
    name: Annotated[str, typer.Option(help="Of the turbine; the first file's name.")] = "",
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML file that states where each channel was; else by their names."),
    ] = None,
    structure: Annotated[
        str,
        typer.Option(
            help="A shipped description, a TOML file, OpenFAST's NAME_ElastoDyn.dat, a WindIO "
            'NAME.yaml, a BModes NAME.bmi, or "none": modes alone.'
        ),
    ] = "none",
    subdyn: Annotated[
        Path | None, typer.Option(help="SubDyn's file of the monopile below an ElastoDyn tower.")
    ] = None,
    springs: Annotated[
        str | None,
        typer.Option(
            help="k11,k22,k12 at the mudline [N/m, N·m/rad, N/rad], for files of other "
            "programs; of an embedded "
            "pile k12 < 0."
        ),
    ] = None,
    mudline: Annotated[
        float | None,
        typer.Option(
            help="Elevation at which a WindIO monopile ends, or a BModes tower begins [m]."
        ),
    ] = None,
    sampling_rate: Annotated[
        float | None, typer.Option(help="[Hz]; where the files have no time stamps that increase.")
    ] = None,
    dates: DatesOption = None,
    zone: ZoneOption = "",
    scada: Annotated[
        list[Path] | None,
        typer.Option(help="A file of wind, rotor, power or water level over time; repeatable."),
    ] = None,
    water_level_zero: Annotated[
        float,
        typer.Option(
            help="Elevation that reported water levels count from, such as that of LAT above mean "
            "water level [m]; negative below it."
        ),
    ] = 0.0,
    yes: Annotated[
        bool, typer.Option("--yes", help="Ask nothing; what the files do not state is guessed.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Start from your own files: state or guess the layout, write scenario and recording."""
    from sensors.files.channel_names import parallel_channels

    folder = out or Path(files[0].stem)
    options: dict[str, Any] = {
        "name": name,
        "layout": layout,
        "structure": structure,
        "subdyn": subdyn,
        "mudline": mudline,
        "springs": None if springs is None else _springs(springs),
        "sampling_rate": sampling_rate,
        "dates": dates,
        "zone": zone,
        "scada": scada or (),
        "water_level_zero": water_level_zero,
    }
    if folders := [file for file in files if file.is_dir()]:
        raise InputError(f"{folders[0]} is a folder; name the files in it")
    asking = sys.stdin.isatty() and stderr.is_terminal and not (yes or as_json)
    project = _started(files, folder, options, asking=asking)
    drawing = _drawn(project)
    if as_json:
        channels = [asdict(each) for each in project.channels]
        print_json(
            {
                "folder": str(project.folder),
                "recording": str(project.recording),
                "sampling_rate_hz": project.sampling_rate,
                "structure": project.structure,
                "complete": project.complete,
                "channels": channels,
                "left_out": [asdict(each) for each in project.left_out],
                "conditions": list(project.conditions),
                "water_level": None if project.water is None else _water_json(project.water),
            }
        )
        return
    number = count_noun(len(project.channels), "channel")
    output.print(f"{number} at {project.sampling_rate:g} Hz, {_span(project)}:")
    for each in project.channels:
        output.print(f"  {escape_markup(each.name)}: {escape_markup(each.reason)}", highlight=False)
    if alike := parallel_channels([] if layout else project.channels):
        also = f" (so do those of {count_noun(len(alike) - 1, 'other height')})" * (len(alike) > 1)
        names = escape_markup(" and ".join(alike[0]))
        output.print(
            f"{names} point along one axis{also}: where they do not, state the axes in "
            f"{escape_markup(str(folder / 'layout.toml'))}",
            soft_wrap=True,
            highlight=False,
        )
    if project.left_out:
        output.print(
            f"Not among the motions: {escape_markup(_by_reason(project.left_out))}", soft_wrap=True
        )
    if project.conditions:
        listed = escape_markup(", ".join(project.conditions))
        output.print(f"Recorded beside the motions as SCADA: {listed}", soft_wrap=True)
    if project.water is not None:
        for line in _water_lines(project.water):
            output.print(line, soft_wrap=True, highlight=False)
    if not project.complete:
        output.print(
            escape_markup(
                "What the names do not have is a guess. Where heights and axes matter (mode "
                f"shapes, a structure), correct {folder / 'layout.toml'} and start from it:  "
                f"{shlex.join(_again(files, project, options))}"
            ),
            soft_wrap=True,
            highlight=False,
        )
    if drawing:
        output.print(_structure_line(drawing[0]), soft_wrap=True, highlight=False)
    place = escape_markup(shlex.quote(str(folder)))
    own = [folder / "layout.toml", folder / "scenario.toml"]
    print_written([*own, *drawing, project.recording])
    output.print(f"Next:  cd {place} && pilewatch run && pilewatch report out", soft_wrap=True)


def _again(files: list[Path], project: "NewProject", options: dict[str, Any]) -> list[str]:
    """Return the command that starts from the project's layout, with all else that this one had."""
    from pipeline.offline.new_project import STRUCTURE_FILE
    from pipeline.scenario import NO_STRUCTURE
    from pipeline.sources.sources import LAYOUT_FILE

    structure, folder = project.structure, project.folder
    stated = {
        "--sampling-rate": options["sampling_rate"],
        "--dates": options["dates"],
        "--zone": options["zone"] or None,
        "--water-level-zero": options["water_level_zero"] or None,
        "--structure": None if structure == NO_STRUCTURE else structure,
    }
    if structure == STRUCTURE_FILE:
        stated["--structure"] = str(folder / structure)
    words = [word for name, value in stated.items() if value is not None for word in (name, value)]
    words += [word for path in options["scada"] for word in ("--scada", path)]
    numbers = (f"{folder}-{number}" for number in count(2))
    free = next(each for each in numbers if not Path(each).exists())
    known = ["--layout", folder / LAYOUT_FILE, *words, "-o", free]
    return ["pilewatch", "new", *map(str, files), *map(str, known)]


def _water_json(water: "ReportedWater") -> dict[str, Any]:
    levels = {f"{name}_m": level for name, level in asdict(water).items()}
    return levels | {"zero_doubted": water.zero_doubted}


def _water_lines(water: "ReportedWater") -> Iterable[str]:
    """Return where the reported level lies, and that its zero may be another one."""
    mean, lowest, highest = (
        f"{level - water.still:.2f} m" for level in (water.mean, water.lowest, water.highest)
    )
    yield (
        f"Reported water level above the description's still water ({water.still:g} m): mean "
        f"{mean}, {lowest} to {highest}"
    )
    if water.zero_doubted:
        yield (
            f"warning: tides average out over half a day, but the reported level is {mean} in the "
            "mean. If its gauge counts from another zero, such as LAT, the springs come out wrong: "
            "make the folder again with --water-level-zero METRES, the elevation of that zero "
            "above mean water level (of LAT negative)"
        )


def _by_reason(channels: "Iterable[UnusedChannel]") -> str:
    names: dict[str, list[str]] = {}
    for each in channels:
        names.setdefault(each.reason, []).append(each.name)
    return "; ".join(f"{', '.join(listed)} ({reason})" for reason, listed in names.items())


def _span(project: "NewProject") -> str:
    """Return when the record begins and how long it is: what a wrong zone or date shows in."""
    from sensors.acquisition.blocks import NANOSECONDS
    from sensors.files.block_builder import FIRST_DAY_NS, moment

    begin, end = project.span_ns
    seconds = f"{(end - begin) / NANOSECONDS:g} s"
    if begin < FIRST_DAY_NS:
        return f"{seconds} without a date"
    hint = " (dates without a zone are taken as UTC: --zone)" if project.zone_open else ""
    # stamps of a few digits scatter: 08:59:59.999996 means nine o'clock
    return f"{seconds} from {moment(begin + NANOSECONDS // 1000)[:19]} UTC{hint}"


def _started(
    files: list[Path], folder: Path, options: dict[str, Any], *, asking: bool
) -> "NewProject":
    """The project; on a terminal an error that names an option of QUESTIONS is a question."""
    from pipeline.offline.new_project import start_project

    if asking:
        options["place"] = cache(_placed)
    while True:
        try:
            return start_project(files, folder, **options)
        except InputError as error:
            name = next((each for each, words in QUESTIONS.items() if words in str(error)), None)
            if not asking or name is None or options[name] is not None:
                raise
            stderr.print(escape_markup(str(error)))
            text = typer.prompt(
                name.replace("_", " "), err=True, value_proc=_answer(READ_ANSWER[name])
            )
            options[name] = text


def _placed(channel: "GuessedChannel") -> "GuessedChannel":
    """Ask where a channel was; its guess where the answer is empty."""
    from sensors.acquisition.layout import FORE_AFT, SIDE_SIDE
    from sensors.files.channel_names import UP, placed

    axes = {FORE_AFT: "fa", SIDE_SIDE: "ss", UP: "up"}
    guess = f"{channel.elevation:g} {axes.get(channel.direction, 'as guessed')}"
    return typer.prompt(
        f"{channel.name}: {channel.reason}. Height [m] and axis (fa, ss, up)",
        default=guess,
        err=True,
        value_proc=_answer(lambda text: channel if text == guess else placed(channel, text)),
    )


def _answer(read: Callable[[str], Any]) -> Callable[[str], Any]:
    """Ask again where an answer cannot be read."""

    def read_or_ask_again(text: str) -> Any:
        try:
            return read(text)
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return read_or_ask_again


def _springs(text: str) -> "FoundationSprings":
    from sensors.structure.foundation import FoundationSprings

    try:
        k11, k22, k12 = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--springs {text!r}: three numbers are needed, k11,k22,k12") from None
    return FoundationSprings(k11, k22, abs(k12), "embedded-pile" if k12 < 0 else "published")


def _metres(text: str) -> float:
    return float(text.replace(",", ".").removesuffix("m"))


def _rate(text: str) -> float:
    return float(text.replace(",", ".").removesuffix("Hz"))


def _dates(text: str) -> str:
    if text not in ("day-first", "month-first"):
        raise InputError(f"{text!r}: day-first or month-first")
    return text


# What no file can show: an error with these words asks for the option.
QUESTIONS = {
    "sampling_rate": "--sampling-rate HZ",
    "dates": "--dates day-first",
    "springs": "give --springs",
    "mudline": "--mudline METRES",
}
READ_ANSWER: dict[str, Callable[[str], Any]] = {
    "sampling_rate": _rate,
    "mudline": _metres,
    "dates": _dates,
    "springs": _springs,
}


def _structure_line(described: Path) -> str:
    """Return where the structure stands: what a deck without its substructure gets wrong."""
    from sensors.structure.description import load_turbine

    turbine = load_turbine(described)
    water = "no water" if turbine.water is None else f"water to {turbine.water.level:g} m"
    stated = turbine.foundation.moving_mass
    pile = "" if stated is not None else "; no mass of a pile below (moving_mass)"
    return (
        f"Structure: springs at {turbine.mudline:g} m, {water}, tower top at "
        f"{turbine.tower_top:g} m{pile}"
    )


def _drawn(project: "NewProject") -> list[Path]:
    """The description that was written into the folder, and its drawing where matplotlib is."""
    from pipeline.offline.describe_structure import structure_figures
    from pipeline.offline.new_project import STRUCTURE_FILE
    from pipeline.report.structure import draw_structure
    from sensors.structure.description import load_turbine

    if project.structure != STRUCTURE_FILE:
        return []
    described = project.folder / STRUCTURE_FILE
    picture = described.with_suffix(".png")
    try:
        draw_structure(structure_figures(load_turbine(described)), picture)
    except InputError as error:  # matplotlib is an extra; the folder is complete without a drawing
        stderr.print(f"no drawing: {escape_markup(str(error))}", soft_wrap=True)
        return [described]
    return [described, picture]
