"""A folder to start from, made of files of measurements: `pilewatch new`.

files ──► guess of each channel's place ──► layout.toml, scenario.toml, recordings/NAME.mcap
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.scenario import NO_STRUCTURE, scenario_from_text
from pipeline.sources.import_files import open_measurement, record_measurement
from sensors.acquisition.layout import FORE_AFT, SIDE_SIDE
from sensors.errors import InputError
from sensors.files.formats import channels_in
from sensors.files.layout_file import parse_layout
from sensors.settings import toml_string
from sensors.structure.decks.elastodyn import read_elastodyn
from sensors.structure.decks.toml_text import description_toml
from sensors.structure.decks.windio import read_windio
from sensors.structure.description import SHIPPED, load_turbine, turbine_text
from sensors.structure.foundation import FoundationSprings

UP: tuple[float, float, float] = (0.0, 0.0, 1.0)
AXIS_OF_NAME: dict[str, tuple[tuple[float, float, float], str]] = {
    **dict.fromkeys(("fa", "foreaft", "x", "n"), (FORE_AFT, "fore-aft")),
    **dict.fromkeys(("ss", "sideside", "y", "e"), (SIDE_SIDE, "side-side")),
    **dict.fromkeys(("z", "v", "up", "vert"), (UP, "vertical")),
}
_WORD = re.compile(r"[A-Za-z]+")
_HEIGHT_IN_METRES = re.compile(r"(?<![A-Za-z0-9])(-?\d+(?:\.\d+)?) ?m(?![A-Za-z/])")
_HEIGHT_AFTER_LETTERS = re.compile(
    r"(?<![A-Za-z0-9])(?:LAT|Lat|lat|[zZhH]|el|EL)[ _-]?(-?\d+(?:\.\d+)?)"
)
_NUMBER = re.compile(r"(?<![\d.])(\d{2,3}(?:\.\d+)?)(?![\d.])")
YAML = (".yaml", ".yml")  # of WindIO
STRUCTURE_FILE = "structure.toml"  # in the folder of a project with a structure of its own
LOWEST, HIGHEST = 2.0, 300.0  # heights that a bare number in a name may stand for [m]
WINDOW = 600.0  # length of an identified window, unless the record is shorter [s]


@dataclass(frozen=True, slots=True)
class GuessedChannel:
    """Where a channel is taken to be, and what this is taken from."""

    name: str
    """As the file has it."""
    elevation: float
    """[m]; where `height_known` is False only its place in the order."""
    direction: tuple[float, float, float]
    """Of the positive axis (x, y, z) [-]."""
    reason: str
    """What elevation and direction were read from, for people."""
    height_known: bool = True
    """Whether the name has a height."""
    direction_known: bool = True
    """Whether the name has an axis."""


@dataclass(frozen=True, slots=True)
class NewProject:
    """What was written, and what was guessed on the way."""

    folder: Path
    recording: Path
    channels: tuple[GuessedChannel, ...]
    sampling_rate: float
    """[Hz]"""
    structure: str
    """Description that the scenario names; "none" for modes alone."""

    @property
    def complete(self) -> bool:
        """Whether every channel's height and axis were in its name."""
        return all(each.height_known and each.direction_known for each in self.channels)


def guess_channel(name: str, place: int) -> GuessedChannel:
    """Read a channel's height and axis from its name.

    Parameters
    ----------
    name : str
        Such as "LAT097_FA", "z145-ss", "acc 44.1m x".
    place : int
        Position among the channels, from 1; stands for the height where the name has none.

    Returns
    -------
    GuessedChannel
    """
    height, seen_height = _height(name)
    axis, seen_axis = _axis(name)
    direction, axis_name = AXIS_OF_NAME[axis] if axis else (FORE_AFT, "fore-aft")
    reasons = [
        f"{height:g} m from {seen_height!r}" if height is not None else "height not in the name",
        f"{axis_name} from {seen_axis!r}" if axis else "axis not in the name",
    ]
    return GuessedChannel(
        name=name,
        elevation=float(place) if height is None else height,
        direction=direction,
        reason=", ".join(reasons),
        height_known=height is not None,
        direction_known=bool(axis),
    )


def _height(name: str) -> tuple[float | None, str]:
    for pattern in (_HEIGHT_IN_METRES, _HEIGHT_AFTER_LETTERS, _NUMBER):
        found = pattern.search(name)
        if found and (pattern is not _NUMBER or LOWEST <= float(found[1]) <= HIGHEST):
            return float(found[1]), found[0]
    return None, ""


def _axis(name: str) -> tuple[str, str]:
    words = _WORD.findall(name)
    for word in reversed(words):
        if word.lower() in AXIS_OF_NAME:
            return word.lower(), word
    last = words[-1] if words else ""
    trailing = last[-2:].lower() if last[-2:].lower() in AXIS_OF_NAME else last[-1:].lower()
    is_suffix = bool(re.search(r"\d[XYZxyz]$", name))
    return (trailing, trailing) if is_suffix and trailing in AXIS_OF_NAME else ("", "")


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
        Shipped description, path of a description (TOML), of an ElastoDyn file (.dat) or of a
        WindIO file (.yaml), which is brought into the folder; or "none" for modes alone.
    subdyn : Path, optional
        SubDyn's file of the monopile below an ElastoDyn tower.
    springs : FoundationSprings, optional
        At the mudline; needed with files of other programs, which have none.
    mudline : float, optional
        Elevation at which a WindIO monopile ends [m].
    sampling_rate : float, optional
        [Hz]; needed where the files have neither a rate nor time stamps.

    Returns
    -------
    NewProject

    Raises
    ------
    InputError
        If a file cannot be read, the folder holds such a project already, or the description
        cannot be read.
    """
    layout_file, scenario_file = folder / "layout.toml", folder / "scenario.toml"
    for path in (layout_file, scenario_file):
        if path.exists():
            raise InputError(f"{path} exists; choose another folder with -o")
    described = structure_text(structure, subdyn, springs, mudline)
    turbine = re.sub(r"[^\w.-]+", "-", name or files[0].stem).strip("-") or "structure"
    names = channels_in(files[0], None).names
    channels = tuple(guess_channel(each, place) for place, each in enumerate(names, start=1))
    unknown = [each.name for each in channels if not (each.height_known and each.direction_known)]
    if unknown and structure != NO_STRUCTURE:
        raise InputError(
            f"the structural model needs the height and axis of each channel; {unknown[0]!r} has "
            "none in its name. `pilewatch import FILE --template` prints a layout file to fill in"
        )
    layout = parse_layout(layout_text(channels, turbine), str(layout_file))
    measurement = open_measurement(
        files, layout=layout, turbine=turbine, sampling_rate=sampling_rate
    )
    n_samples = sum(len(block.samples) for block in measurement.blocks())
    if n_samples < measurement.sampling_rate:
        listed = ", ".join(str(file) for file in files)
        raise InputError(f"{listed}: less than 1 s of samples that are not NaN; nothing to watch")
    folder.mkdir(parents=True, exist_ok=True)
    layout_file.write_text(layout_text(channels, turbine), encoding="utf-8")
    named = structure if described is None else STRUCTURE_FILE
    text = scenario_text(turbine, named, n_samples / measurement.sampling_rate)
    scenario = scenario_from_text(text, str(scenario_file))
    scenario_file.write_text(text, encoding="utf-8")
    if described is not None:
        (folder / STRUCTURE_FILE).write_text(described, encoding="utf-8")
        scenario = replace(scenario, files=((STRUCTURE_FILE, described),))
    recording = folder / "recordings" / f"{turbine}.mcap"
    recording.parent.mkdir(exist_ok=True)
    record_measurement(measurement, recording, scenario=scenario)
    return NewProject(folder, recording, channels, measurement.sampling_rate, named)


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
    is_windio = structure.endswith(YAML)
    if (subdyn or springs or mudline is not None) and not structure.endswith((".dat", *YAML)):
        raise InputError(
            "--subdyn, --springs and --mudline are for --structure NAME_ElastoDyn.dat and NAME.yaml"
        )
    if is_windio or structure.endswith(".dat"):
        if springs is None:
            raise InputError(
                f"{structure} has no springs of the mudline: give --springs k11,k22,k12 "
                "[N/m, N·m/rad, N/rad]"
            )
        if is_windio:
            return description_toml(read_windio(Path(structure), springs, mudline=mudline))
        return description_toml(read_elastodyn(Path(structure), springs, subdyn=subdyn))
    if structure == NO_STRUCTURE:
        return None
    load_turbine(structure)
    return None if structure in SHIPPED else turbine_text(structure)


def layout_text(channels: Sequence[GuessedChannel], turbine: str) -> str:
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
