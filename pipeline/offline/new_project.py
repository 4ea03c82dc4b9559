"""A folder to start from, made of files of measurements: `pilewatch new`.

files ──► guess of each channel's place ──► layout.toml, scenario.toml, recordings/NAME.mcap
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.scenario import NO_STRUCTURE, scenario_from_text
from pipeline.sources.import_files import open_measurement, record_measurement
from sensors.acquisition.layout import FORE_AFT, SIDE_SIDE
from sensors.errors import InputError
from sensors.files.formats import channels_in
from sensors.files.layout_file import load_layout
from sensors.structure.description import load_turbine

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
        Shipped description, path of a file, or "none" for modes alone.
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
    if structure != NO_STRUCTURE:
        load_turbine(structure)
    turbine = re.sub(r"[^\w.-]+", "-", name or files[0].stem).strip("-") or "structure"
    names = channels_in(files[0], None).names
    channels = tuple(guess_channel(each, place) for place, each in enumerate(names, start=1))
    unknown = [each.name for each in channels if not (each.height_known and each.direction_known)]
    if unknown and structure != NO_STRUCTURE:
        raise InputError(
            f"the structural model needs the height and axis of each channel; {unknown[0]!r} has "
            "none in its name. `pilewatch import FILE --template` prints a layout file to fill in"
        )
    folder.mkdir(parents=True, exist_ok=True)
    layout_file.write_text(layout_text(channels, turbine), encoding="utf-8")
    measurement = open_measurement(
        files, layout=load_layout(layout_file), turbine=turbine, sampling_rate=sampling_rate
    )
    n_samples = sum(len(block.samples) for block in measurement.blocks())
    text = scenario_text(turbine, structure, n_samples / measurement.sampling_rate)
    scenario = scenario_from_text(text, str(scenario_file))
    scenario_file.write_text(text, encoding="utf-8")
    recording = folder / "recordings" / f"{turbine}.mcap"
    recording.parent.mkdir(exist_ok=True)
    record_measurement(measurement, recording, scenario=scenario)
    return NewProject(folder, recording, channels, measurement.sampling_rate, structure)


def layout_text(channels: Sequence[GuessedChannel], turbine: str) -> str:
    """The layout file of guessed channels, each with what it was read from."""
    lines = [
        "# Axes: x downwind (fore-aft), y to the side (side-side), z up from mean water level.",
        "# What was guessed stands beside each channel; correct it and run `pilewatch import`.",
        f"turbine = {_quoted(turbine)}",
    ]
    for each in channels:
        direction = ", ".join(f"{value:g}" for value in each.direction)
        lines += [
            "",
            f"[[channels]]  # {each.reason}",
            f"name = {_quoted(each.name)}",
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
        f"title = {_quoted(f'Measurements of {turbine}')}\n\n[turbine]\nid = {_quoted(turbine)}\n"
        f"description = {_quoted(structure)}\n"
    )
    if duration >= WINDOW:
        return text
    window = int(duration)
    return f"{text}\n[oma]\nwindow_duration = {window}.0  # the record [s]\nhop = {window}.0\n"


def _quoted(text: str) -> str:
    """A TOML basic string."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'
