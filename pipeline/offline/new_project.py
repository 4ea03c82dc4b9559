"""A folder to start from, made of files of measurements: `pilewatch new`.

files ──► motions, with a guess of each one's place ──► layout.toml
      └─► wind, rotor, sea: SCADA samples              scenario.toml, recordings/NAME.mcap
"""

import logging
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.scenario import NO_STRUCTURE, scenario_from_text
from pipeline.sources.import_files import Measurement, open_measurement, record_measurement
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError
from sensors.files.channel_names import GuessedChannel, UnusedChannel, guess_channels, split_motions
from sensors.files.conditions import ConditionChannel, condition_channels, read_conditions
from sensors.files.formats import channels_in
from sensors.files.layout_file import parse_layout
from sensors.files.table import EVERYTHING, ChannelTable, DateOrder, FileError, dated
from sensors.settings import toml_string
from sensors.structure.decks.bmodes import read_bmodes
from sensors.structure.decks.elastodyn import read_elastodyn
from sensors.structure.decks.toml_text import description_toml
from sensors.structure.decks.windio import read_windio
from sensors.structure.description import (
    SHIPPED,
    TurbineDescription,
    load_turbine,
    turbine_text,
)
from sensors.structure.foundation import FoundationSprings

_log = logging.getLogger(__name__)

YAML = (".yaml", ".yml")  # of WindIO
DAT, BMI = ".dat", ".bmi"  # of ElastoDyn, of BModes
STRUCTURE_FILE = "structure.toml"  # in the folder of a project with a structure of its own
LOWEST_RATE = 0.2  # of samples that can show a tower's or a floater's motion [Hz]
WINDOW = 600.0  # length of an identified window, unless the record is shorter [s]


@dataclass(frozen=True, slots=True)
class NewProject:
    """What was written, and what was guessed on the way."""

    folder: Path
    recording: Path
    channels: tuple[GuessedChannel, ...]
    sampling_rate: float
    """[Hz]"""
    left_out: tuple[UnusedChannel, ...]
    """Channels of the files that are not in the layout."""
    conditions: tuple[str, ...]
    """Channels whose values are recorded as SCADA samples."""
    structure: str
    """Description that the scenario names; "none" for modes alone."""

    @property
    def complete(self) -> bool:
        """Whether every channel's height and axis were in its name."""
        return all(each.known for each in self.channels)


def start_project(
    files: Sequence[Path],
    folder: Path,
    *,
    name: str = "",
    structure: str = NO_STRUCTURE,
    subdyn: Path | None = None,
    springs: FoundationSprings | None = None,
    mudline: float | None = None,
    sampling_rate: float | None = None,
    dates: DateOrder | None = None,
    place: Callable[[GuessedChannel], GuessedChannel] | None = None,
) -> NewProject:
    """Write layout, scenario and recording of a measurement into a folder.

    Parameters
    ----------
    files : sequence of Path
        One measurement; several files are joined in order of time.
    folder : Path
        Made where there is none; nothing in it is overwritten.
    name : str
        Of the turbine or structure; the first file's by default.
    structure : str
        Shipped description, path of a description (TOML), of an ElastoDyn file (.dat), a WindIO
        file (.yaml) or a BModes tower (.bmi), which is brought into the folder; or "none": modes
        alone.
    subdyn : Path, optional
        SubDyn's file of the monopile below an ElastoDyn tower.
    springs : FoundationSprings, optional
        At the mudline; needed with files of other programs, which have none.
    mudline : float, optional
        Elevation at which a WindIO monopile ends, or a BModes tower begins [m].
    sampling_rate : float, optional
        [Hz]; needed where the files have neither a rate nor time stamps.
    dates : {"day-first", "month-first"}, optional
        What comes first in dates such as 3/4/2024.
    place : callable, optional
        Guess of a channel whose name lacks height or axis → where it was; None: as guessed.

    Returns
    -------
    NewProject

    Raises
    ------
    InputError
        If a file cannot be read, the folder holds such a project already, or the description
        cannot be read.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"-o {folder} is a file; a folder is needed")
    layout_file, scenario_file = folder / "layout.toml", folder / "scenario.toml"
    for path in (layout_file, scenario_file):
        if path.exists():
            raise InputError(f"{path} exists; choose another folder with -o")
    described = structure_text(structure, subdyn, springs, mudline)
    turbine = re.sub(r"[^\w.-]+", "-", name or files[0].stem).strip("-") or "structure"
    table = channels_in(files[0], None, dated(EVERYTHING, dates))
    columns, left_out = choose_channels(table, str(files[0]))
    channels = guess_channels(table.only(columns).names)
    if place is not None:
        channels = tuple(each if each.known else place(each) for each in channels)
    unknown = [each.name for each in channels if not each.known]
    if unknown and structure != NO_STRUCTURE:
        raise InputError(
            f"the structural model needs the height and axis of each channel; {unknown[0]!r} has "
            "none in its name. `pilewatch import FILE --template` prints a layout file to fill in"
        )
    measurement = _measurement(files, channels, turbine, sampling_rate, dates)
    if measurement.sampling_rate < LOWEST_RATE:
        raise InputError(
            f"{files[0]}: a value every {1 / measurement.sampling_rate:g} s is a mean, no motion; "
            f"modes need samples, at least {LOWEST_RATE:g} a second"
        )
    n_samples, still = _survey(measurement)
    if n_samples < measurement.sampling_rate:
        listed = ", ".join(str(file) for file in files)
        raise InputError(f"{listed}: less than 1 s of samples that are not NaN; nothing to watch")
    if still:
        left_out += tuple(UnusedChannel(name, "constant over the record") for name in still)
        channels = tuple(each for each in channels if each.name not in still)
        measurement = _measurement(files, channels, turbine, sampling_rate, dates)
    folder.mkdir(parents=True, exist_ok=True)
    layout_file.write_text(layout_text(channels, turbine, dates), encoding="utf-8")
    named = structure if described is None else STRUCTURE_FILE
    text = scenario_text(turbine, named, n_samples / measurement.sampling_rate)
    scenario = scenario_from_text(text, str(scenario_file))
    scenario_file.write_text(text, encoding="utf-8")
    if described is not None:
        (folder / STRUCTURE_FILE).write_text(described, encoding="utf-8")
        scenario = replace(scenario, files=((STRUCTURE_FILE, described),))
    recording = folder / "recordings" / f"{turbine}.mcap"
    recording.parent.mkdir(exist_ok=True)
    known = condition_channels(*_names_and_units(table, left_out))
    conditions = () if measurement.counted else _conditions(measurement, known)
    record_measurement(measurement, recording, scenario=scenario, conditions=conditions)
    return NewProject(
        folder,
        recording,
        channels,
        measurement.sampling_rate,
        left_out,
        tuple(each.name for each in known.values()) if conditions else (),
        named,
    )


def choose_channels(
    table: ChannelTable, origin: str
) -> tuple[list[int], tuple[UnusedChannel, ...]]:
    """Return the columns of a measurement's motions, all of one quantity, and what is left out.

    Accelerations where there are some, else what most channels measure.
    """
    columns, left_out = split_motions(table, origin)
    quantities = [table.only([column]).quantities for column in columns]
    counts = Counter(each[0] for each in quantities if each)
    if not counts:
        return columns, left_out
    wanted = "acceleration" if counts["acceleration"] else counts.most_common(1)[0][0]
    others = {
        column: each[0]
        for column, each in zip(columns, quantities, strict=True)
        if each and each[0] != wanted
    }
    left_out += tuple(
        UnusedChannel(table.names[column], f"a {quantity}, beside {wanted}s")
        for column, quantity in others.items()
    )
    return [column for column in columns if column not in others], left_out


def _measurement(
    files: Sequence[Path],
    channels: Sequence[GuessedChannel],
    turbine: str,
    sampling_rate: float | None,
    dates: DateOrder | None,
) -> Measurement:
    layout = parse_layout(layout_text(channels, turbine, dates), "layout.toml")
    return open_measurement(files, layout=layout, turbine=turbine, sampling_rate=sampling_rate)


def _survey(measurement: Measurement) -> tuple[int, frozenset[str]]:
    """Return the number of samples and the channels that never change, unless none does."""
    count = 0
    lowest = np.full(len(measurement.layout.channels), np.inf)
    highest = -lowest
    for block in measurement.blocks():
        count += len(block.samples)
        lowest = np.fmin(lowest, np.fmin.reduce(block.samples))
        highest = np.fmax(highest, np.fmax.reduce(block.samples))
    names = measurement.layout.channel_names
    still = [name for name, each in zip(names, lowest >= highest, strict=True) if each]
    return count, frozenset(still if len(still) < len(names) else ())


def _names_and_units(
    table: ChannelTable, left_out: Sequence[UnusedChannel]
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    unused = table.only([table.names.index(each.name) for each in left_out])
    return unused.names, unused.units


def _conditions(
    measurement: Measurement, channels: Mapping[str, ConditionChannel]
) -> tuple[ScadaSample, ...]:
    """Return the files' SCADA samples; none where their columns cannot be read together."""
    try:
        return tuple(read_conditions(measurement.files, channels, measurement.layout.turbine))
    except FileError as error:
        _log.warning("no SCADA samples: %s", error)
        return ()


def structure_text(
    structure: str,
    subdyn: Path | None = None,
    springs: FoundationSprings | None = None,
    mudline: float | None = None,
) -> str | None:
    """Return the description that goes into a project's folder; None for a shipped one or none.

    Raises
    ------
    InputError
        If the file cannot be read, or another program's comes without springs.
    """
    is_deck = structure.endswith((DAT, BMI, *YAML))
    if (subdyn or springs or mudline is not None) and not is_deck:
        raise InputError(
            "--subdyn, --springs and --mudline are for --structure NAME_ElastoDyn.dat, NAME.yaml "
            "and NAME.bmi"
        )
    if is_deck:
        if springs is None:
            raise InputError(
                f"{structure} has no springs of the mudline: give --springs k11,k22,k12 "
                "[N/m, N·m/rad, N/rad]"
            )
        return description_toml(_of_deck(Path(structure), springs, subdyn, mudline))
    if structure == NO_STRUCTURE:
        return None
    load_turbine(structure)
    return None if structure in SHIPPED else turbine_text(structure)


def _of_deck(
    path: Path, springs: FoundationSprings, subdyn: Path | None, mudline: float | None
) -> TurbineDescription:
    """The turbine of another program's file."""
    if subdyn is not None and path.suffix != DAT:
        raise InputError(f"--subdyn is for --structure NAME_ElastoDyn.dat, not for {path}")
    if mudline is not None and path.suffix == DAT:
        raise InputError(f"--mudline is for NAME.yaml and NAME.bmi, not for {path}")
    if path.suffix == DAT:
        return read_elastodyn(path, springs, subdyn=subdyn)
    if path.suffix == BMI:
        return read_bmodes(path, springs, mudline=mudline)
    return read_windio(path, springs, mudline=mudline)


def layout_text(
    channels: Sequence[GuessedChannel], turbine: str, dates: DateOrder | None = None
) -> str:
    """The layout file of guessed channels, each with what it was read from."""
    lines = [
        "# Axes: x downwind (fore-aft), y to the side (side-side), z up from mean water level.",
        "# What was guessed stands beside each channel; correct it and run `pilewatch import`.",
        f"turbine = {toml_string(turbine)}",
    ]
    for each in channels:
        direction = ", ".join(f"{value:g}" for value in each.direction)
        lines += [
            "",
            f"[[channels]]  # {each.reason}",
            f"name = {toml_string(each.name)}",
            f"elevation = {each.elevation:.6g}" + ("" if each.height_known else "  # place only"),
            f"direction = [{direction}]",
        ]
    if dates is not None:
        lines += ["", "[time]", f"dates = {toml_string(dates)}"]
    return "\n".join(lines) + "\n"


def scenario_text(turbine: str, structure: str, duration: float) -> str:
    """The scenario of a new project; a record shorter than a window is one window.

    Parameters
    ----------
    turbine : str
        Its id.
    structure : str
        Its description, or "none".
    duration : float
        Length of the record [s].
    """
    text = (
        f"title = {toml_string(f'Measurements of {turbine}')}\n\n"
        f"[turbine]\nid = {toml_string(turbine)}\n"
        f"description = {toml_string(structure)}\n"
    )
    if duration >= WINDOW:
        return text
    window = int(duration)
    return f"{text}\n[oma]\nwindow_duration = {window}.0  # the record [s]\nhop = {window}.0\n"
