"""A folder to start from, made of files of measurements: `pilewatch new`.

files ──► motions, with a guess of each one's place ──► layout.toml
      └─► wind, rotor, sea: SCADA samples              scenario.toml, recordings/NAME.mcap
"""

import logging
import math
import re
from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.offline.project_layout import (
    Placing,
    ProjectLayout,
    guessed_layout,
    stated_layout,
)
from pipeline.offline.project_texts import scenario_text, structure_text
from pipeline.oma.data_quality.input_checks import silent_channels
from pipeline.scenario import NO_STRUCTURE, Scenario, scenario_from_text
from pipeline.sources.import_files import Measurement, open_measurement, record_measurement
from pipeline.sources.sources import LAYOUT_FILE, SCENARIO_FILE
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import BoolArray
from sensors.errors import InputError
from sensors.files.block_builder import MeasurementFile, moment, open_file
from sensors.files.channel_names import NO_VALUE, GuessedChannel, UnusedChannel
from sensors.files.conditions import ConditionChannel, condition_channels, read_conditions
from sensors.files.formats import channels_in
from sensors.files.layout_file import load_layout
from sensors.files.repeated_hour import settle_repeated_hour
from sensors.files.table import (
    EVERYTHING,
    ChannelTable,
    DateOrder,
    FileError,
    TimeColumn,
    dated,
)
from sensors.structure.foundation import FoundationSprings
from sensors.structure.sensor_readings import require_on_tower

_log = logging.getLogger(__name__)

STRUCTURE_FILE = "structure.toml"  # in the folder of a project with a structure of its own
LOWEST_RATE = 0.2  # of samples that can show a tower's or a floater's motion [Hz]
SLOWER = 0.9  # of the values of others: a channel below has a lower sampling rate [-]
END = 600.0  # of a record, at both of which channels of noise alone are looked for [s]
LONGEST_SCADA_STEP = 3600 * NANOSECONDS  # of a controller's means [ns]
OTHER_ZERO = 1.0  # from still water: a tide's mean is nearer, a chart datum mostly not [m]


@dataclass(frozen=True, slots=True)
class ReportedWater:
    """The water level that the files report."""

    mean: float
    """Above mean water level [m]."""
    lowest: float
    """Lowest level [m]."""
    highest: float
    """Highest level [m]."""
    still: float
    """Level of the description's still water [m]; 0 without a structure or water."""

    @property
    def zero_doubted(self) -> bool:
        """Whether its gauge may count from another zero than the description."""
        return abs(self.mean - self.still) > OTHER_ZERO


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
    span_ns: tuple[int, int]
    """Of the record, its first sample and one past its last [ns since 1970-01-01 UTC]."""
    zone_open: bool
    """Whether neither the dates nor anything else states a zone: they are taken as UTC."""
    water: ReportedWater | None = None
    """None where no level is reported."""

    @property
    def complete(self) -> bool:
        """Whether every channel's height and axis were in its name."""
        return all(each.known for each in self.channels)


def start_project(
    files: Sequence[Path],
    folder: Path,
    *,
    name: str = "",
    layout: Path | None = None,
    structure: str = NO_STRUCTURE,
    subdyn: Path | None = None,
    springs: FoundationSprings | None = None,
    mudline: float | None = None,
    sampling_rate: float | None = None,
    dates: DateOrder | None = None,
    zone: str = "",
    scada: Sequence[Path] = (),
    water_level_zero: float = 0.0,
    place: Placing | None = None,
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
    layout : Path, optional
        Layout file that states where the channels were; None: read from their names.
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
        [Hz]; needed where the files have neither a rate nor time stamps that increase.
    dates : {"day-first", "month-first"}, optional
        What comes first in dates such as 3/4/2024.
    zone : str
        Time zone of dates that state none, such as "Europe/Berlin"; UTC by default.
    scada : sequence of Path
        The controller's files: wind, rotor, power, water level over time.
    water_level_zero : float
        Elevation that reported water levels count from, such as that of LAT [m]; it is added to
        them.
    place : callable, optional
        Guess of a channel whose name lacks height or axis → where it was; None: as guessed.

    Raises
    ------
    InputError
        If a file cannot be read, the folder holds such a project already, the description
        cannot be read, or an option is no number.
    """
    _require_no_project(folder)
    if not math.isfinite(water_level_zero):
        raise InputError(
            f"--water-level-zero {water_level_zero:g}: metres are needed, such as -1.8"
        )
    described = structure_text(structure, subdyn, springs, mudline)
    time = TimeColumn(dates=dates, zone=zone)
    everything = replace(EVERYTHING, rate_known=sampling_rate is not None)
    if layout is None:
        turbine = re.sub(r"[^\w.-]+", "-", name or files[0].stem).strip("-") or "structure"
        table = channels_in(files[0], None, replace(everything, time=time))
        places = guessed_layout(table, str(files[0]), turbine=turbine, time=time, place=place)
    else:
        stated = load_layout(layout)
        own = replace(stated.wanted(), rate_known=everything.rate_known)
        table = channels_in(files[0], None, dated(own, time))
        places = stated_layout(layout, stated, table, name=name)
    if structure != NO_STRUCTURE:
        places.require_places()

    def opened(places: ProjectLayout) -> Measurement:
        return open_measurement(
            files, layout=places.mapping, sampling_rate=sampling_rate, time=time
        )

    measurement = opened(places)
    survey = _surveyed(files, measurement)
    if places.without(survey.unused) is not places:
        places = places.without(survey.unused)
        measurement = opened(places)
    turbine, left_out = places.turbine, places.left_out
    of_controller, read = _controller_samples(scada, turbine, time, survey.span_ns)
    named = structure if described is None else STRUCTURE_FILE
    text = scenario_text(turbine, named, survey.n_samples / measurement.sampling_rate)
    scenario = scenario_from_text(text, str(folder / SCENARIO_FILE))
    if described is not None:
        scenario = replace(scenario, files=((STRUCTURE_FILE, described),))
    if scenario.has_structure:
        require_on_tower(measurement.layout, scenario.structure)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"-o {folder}: {error.strerror}; a folder is needed") from error
    for file, content in ((LAYOUT_FILE, places.text), (SCENARIO_FILE, text), *scenario.files):
        (folder / file).write_text(content, encoding="utf-8")
    recording = folder / "recordings" / f"{turbine}.mcap"
    recording.parent.mkdir(exist_ok=True)
    known = condition_channels(*_names_and_units(table, left_out))
    conditions = () if measurement.counted else _conditions(measurement, known)
    together = [
        replace(each, water_level=each.water_level + water_level_zero)
        for each in sorted((*conditions, *of_controller), key=lambda each: each.time_ns)
    ]
    record_measurement(measurement, recording, scenario=scenario, conditions=together)
    return NewProject(
        folder,
        recording,
        places.channels,
        measurement.sampling_rate,
        left_out,
        tuple(each.name for each in known.values() if conditions) + read,
        named,
        survey.span_ns,
        _is_zone_open(measurement),
        _reported_water(together, scenario),
    )


def _reported_water(samples: Sequence[ScadaSample], scenario: Scenario) -> ReportedWater | None:
    levels = [each.water_level for each in samples if math.isfinite(each.water_level)]
    if not levels:
        return None
    water = scenario.structure.water if scenario.has_structure else None
    still = 0.0 if water is None else water.level
    return ReportedWater(float(np.mean(levels)), min(levels), max(levels), still)


def _require_no_project(folder: Path) -> None:
    if folder.exists() and not folder.is_dir():
        raise InputError(f"-o {folder} is a file; a folder is needed")
    for path in (folder / LAYOUT_FILE, folder / SCENARIO_FILE):
        if path.exists():
            raise InputError(f"{path} exists; choose another folder with -o")


@dataclass(frozen=True, slots=True)
class _Survey:
    """What a measurement holds."""

    n_samples: int
    span_ns: tuple[int, int]
    """Begin and end [ns]."""
    unused: tuple[UnusedChannel, ...]
    """Channels that never change, that give noise alone, and those that are sampled more slowly
    than others."""


def _surveyed(files: Sequence[Path], measurement: Measurement) -> _Survey:
    """Raises InputError for a measurement that shows no motion."""
    if measurement.sampling_rate < LOWEST_RATE:
        raise InputError(
            f"{files[0]}: a value every {1 / measurement.sampling_rate:g} s is a mean, no motion; "
            f"modes need samples, at least {LOWEST_RATE:g} a second"
        )
    survey = _survey(measurement)
    if survey.n_samples < measurement.sampling_rate:
        listed = ", ".join(str(file) for file in files)
        raise InputError(f"{listed}: less than 1 s of samples that are not NaN; nothing to watch")
    return survey


def _is_zone_open(measurement: Measurement) -> bool:
    """Whether a measurement would begin at another time if a zone were stated."""
    first = measurement.files[0]
    if first.wanted.time.zone or not first.start_ns:
        return False
    elsewhere = dated(first.wanted, TimeColumn(zone="UTC+01:00"))
    return open_file(first.path, first.reader, elsewhere)[0].start_ns != first.start_ns


class _Ends:
    """The beginning and the end of a record.

    size   samples of each at least, where the record has as many
    """

    def __init__(self, size: int, n_channels: int) -> None:
        self._size = size
        self._none = np.zeros(n_channels, dtype=bool)
        self._first: list[NDArray[np.floating]] = []
        self._last = deque[NDArray[np.floating]]()
        self._taken = self._in_last = 0  # samples

    def add(self, samples: NDArray[np.floating]) -> None:
        """Take the record's next samples, (n, n_channels)."""
        if self._taken < self._size:
            self._first.append(samples)
        self._last.append(samples)
        self._taken += len(samples)
        self._in_last += len(samples)
        while self._in_last - len(self._last[0]) >= self._size:
            self._in_last -= len(self._last.popleft())

    def silent(self) -> BoolArray:
        """Tell which channels give noise alone at both ends, (n_channels,)."""
        if not self._first:
            return self._none
        return silent_channels(np.vstack(self._first)) & silent_channels(np.vstack(self._last))


def _survey(measurement: Measurement) -> _Survey:
    count, start_ns, end_ns = 0, 0, 0
    lowest = np.full(len(measurement.layout.channels), np.inf)
    highest = -lowest
    present = np.zeros(len(lowest), dtype=np.int64)
    ends = _Ends(round(END * measurement.sampling_rate), len(lowest))
    for block in measurement.blocks():
        start_ns, end_ns = (block.start_ns if not count else start_ns), block.end_ns
        count += len(block.samples)
        present += np.isfinite(block.samples).sum(axis=0)
        lowest = np.fmin(lowest, np.fmin.reduce(block.samples))
        highest = np.fmax(highest, np.fmax.reduce(block.samples))
        ends.add(block.samples)
    unused = []
    for name, each, still, is_silent in zip(
        measurement.layout.channel_names, present, lowest >= highest, ends.silent(), strict=True
    ):
        every = round(count / each) if each else 0
        if not each:
            unused.append(UnusedChannel(name, NO_VALUE))
        elif still:
            unused.append(UnusedChannel(name, "constant over the record"))
        elif each < SLOWER * present.max() and abs(count / each - every) < 1 - SLOWER:
            rate = measurement.sampling_rate / every
            unused.append(UnusedChannel(name, f"a value in every {every} rows: {rate:g} Hz"))
        elif is_silent:
            unused.append(
                UnusedChannel(name, "noise alone: no resonance, nothing that another channel has")
            )
    return _Survey(count, (start_ns, end_ns), tuple(unused if len(unused) < len(present) else ()))


def _controller_samples(
    files: Sequence[Path], turbine: str, time: TimeColumn, span_ns: tuple[int, int]
) -> tuple[list[ScadaSample], tuple[str, ...]]:
    """Return the SCADA samples of a controller's files, and the names of the columns that are read.

    Raises
    ------
    InputError
        If a file has none, has no times, or none during the measurement.
    """
    samples: list[ScadaSample] = []
    names: tuple[str, ...] = ()
    for path in files:
        opened, first = open_file(path, None, replace(EVERYTHING, time=time))
        (file,) = settle_repeated_hour([opened])
        known = condition_channels(file.names, file.units)
        if not known:
            raise InputError(
                f"--scada {path}: none of {', '.join(file.names)} is wind, rotor speed, pitch, "
                "yaw, power or water level by its name and unit"
            )
        _log_left_out(path, file, {each.name for each in known.values()})
        if first.times is None or not file.start_ns:
            raise InputError(f"--scada {path}: its rows have no date and time")
        own = list(read_conditions([file], known, turbine))
        begin, end = own[0].time_ns, own[-1].time_ns
        step = min(own[1].time_ns - begin, LONGEST_SCADA_STEP) if len(own) > 1 else 0
        if begin >= span_ns[1] or end + step <= span_ns[0]:
            raise InputError(
                f"--scada {path}: {_span(begin, end)} has nothing of the measurement's "
                f"{_span(*span_ns)}; dates that state no zone are UTC, or of --zone"
            )
        samples += [each for each in own if span_ns[0] - step < each.time_ns < span_ns[1]]
        names += tuple(each.name for each in known.values() if each.name not in names)
    return samples, names


def _log_left_out(path: Path, file: MeasurementFile, read: Collection[str]) -> None:
    """Name the columns of a controller's file that are no field of a SCADA sample."""
    columns = [
        f"{name} [{unit}]" if unit else name
        for name, unit in zip(file.names, file.units, strict=True)
        if name not in read
    ]
    if columns:
        _log.warning(
            "--scada %s: left out: %s; one column each is read that is wind, rotor speed, pitch, "
            "yaw, power or water level by its name and unit",
            *(path, ", ".join(columns)),
        )


def _span(begin_ns: int, end_ns: int) -> str:
    return f"{moment(begin_ns)[:19]} to {moment(end_ns)[:19]} UTC"


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
