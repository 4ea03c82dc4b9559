"""Files of measurements → a recording: `pilewatch import`, and `pilewatch run --source FILE`.

CSV │ Parquet │ NPZ │ HDF5 │ TDMS │ miniSEED │ plugged in
    ──► in order of time ──► channels of the layout ──► blocks of a second ──► MCAP
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

from pipeline.recording.writer import ACTIVE_SUFFIX, Metadata, whole_recording
from pipeline.runtime.source_feed import with_end
from pipeline.scenario import (
    Scenario,
    load_scenario,
    modes_only,
    require_stated_structure,
    scenario_metadata,
)
from pipeline.sources.sources import COMPACT
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.files.block_builder import (
    BlockCutter,
    MeasurementFile,
    open_file,
    sort_by_time,
    stamp_samples,
)
from sensors.files.channel_names import note_unknown_units
from sensors.files.layout_file import LayoutFile, layout_by_names, load_layout
from sensors.files.repeated_hour import settle_repeated_hour
from sensors.files.stated_rate import rate_note, stamped_time
from sensors.files.table import (
    EVERYTHING,
    STANDING_STAMPS,
    UNSTATED,
    ChannelTable,
    FileError,
    TimeColumn,
    dated,
)
from sensors.files.text.columns import log_once
from sensors.structure.sensor_readings import require_on_tower


@dataclass(frozen=True, slots=True)
class Measurement:
    """Files that belong together, and how they are understood."""

    files: tuple[MeasurementFile, ...]
    """Files in order of time."""

    mapping: LayoutFile
    layout: SensorLayout
    sampling_rate: float
    """Sampling rate [Hz]."""

    counted: bool
    """The samples are counted from a file's start, since its stamps do not increase."""

    def blocks(self) -> Iterator[AccelerationBlock]:
        """Yield the samples as an acquisition unit would have sent them.

        Raises
        ------
        FileError
            If a file turns out to be damaged, or to overlap with another.
        """
        cutter = BlockCutter(self.layout, self.sampling_rate)
        for chunk in stamp_samples(self.files, self._chunks(), self.sampling_rate):
            yield from cutter.push(chunk)
        yield from cutter.finish()

    def _chunks(self) -> Iterator[tuple[int, ChannelTable]]:
        for number, file in enumerate(self.files):
            for chunk in file.chunks():
                chosen = self.mapping.chosen(chunk)
                yield number, replace(chosen, times=None) if self.counted else chosen


def open_measurement(
    paths: Sequence[Path],
    *,
    layout: LayoutFile | None = None,
    turbine: str = "turbine",
    sampling_rate: float | None = None,
    reader: str | None = None,
    time: TimeColumn = UNSTATED,
) -> Measurement:
    """Return the files as one measurement, before its samples are read.

    Parameters
    ----------
    layout : LayoutFile, optional
        Where the channels were; None: their names state it ("z145-fa").
    turbine : str, optional
        Name of the turbine where no layout states it.
    sampling_rate : float, optional
        Sampling rate [Hz]; samples are counted from each file's start where it has no time stamps
        or such as do not increase. Stamps that increase are followed; a warning is logged where
        they have another rate.
    reader : str, optional
        "package.module:function" that gives SEP005 channels; None: by the suffixes.
    time : TimeColumn
        What the dates do not state, order of day and month and zone; else as the layout has it.

    Raises
    ------
    FileError
    LayoutError
        A file that cannot be read; a channel without a place; channels of several quantities;
        no sampling rate; files that differ or do not state when they begin.
    """
    if sampling_rate is not None and not 0 < sampling_rate < float("inf"):
        raise FileError(f"--sampling-rate is {sampling_rate:g} Hz; it must be positive")
    if twice := [path for path in paths if paths.count(path) > 1]:
        raise FileError(f"{twice[0]} is named twice")
    wanted = dated(EVERYTHING if layout is None else layout.wanted(), time)
    wanted = replace(wanted, rate_known=sampling_rate is not None)
    opened = [open_file(path, reader, wanted) for path in paths]
    counted = sampling_rate is not None and _is_counted([file for file, _ in opened], sampling_rate)
    if counted:
        wanted = replace(wanted, stamps=False)
        opened = [open_file(path, reader, wanted) for path in paths]
    files = sort_by_time(settle_repeated_hour([file for file, _ in opened], sampling_rate))
    first = next(table for file, table in opened if file.path == files[0].path)
    mapping = layout or layout_by_names(first.names, turbine=turbine)
    if mapping is None:
        raise FileError(
            f"{files[0].path}: where on the tower are {', '.join(first.names)}? A layout file "
            "says it (--layout FILE.toml): `pilewatch import FILE --template` prints one to fill "
            "in, `pilewatch new FILE` makes one from the names"
        )
    table = mapping.chosen(first)
    _require_one_quantity(table, files[0].path)
    note_unknown_units(table, str(files[0].path))
    rate = sampling_rate if counted else files[0].sampling_rate
    if rate is None and len(first.samples) < 2:
        raise FileError(f"{files[0].path}: 1 sample; at least two are needed")
    if rate is None and first.times is not None:
        raise FileError(STANDING_STAMPS.format(path=files[0].path))
    if rate is None:
        raise FileError(
            f"{files[0].path} states neither its sampling rate nor the time of its samples: give "
            "--sampling-rate HZ"
        )
    return Measurement(tuple(files), mapping, mapping.sensor_layout(table), rate, counted)


def _is_counted(files: Sequence[MeasurementFile], sampling_rate: float) -> bool:
    """Whether the stamps of any file are missing or do not increase, so that samples are counted.

    Logs where the files' own rate is not the stated one.
    """
    counted = False
    for file in files:
        stamps = stamped_time(file.chunks())
        counted = counted or stamps is None or not stamps.increase
        if note := rate_note(file.sampling_rate, stamps, sampling_rate):
            log_once(f"{file.path}: {note}")
    return counted


def _require_one_quantity(table: ChannelTable, path: Path) -> None:
    """Blocks hold accelerations, or channels alike: mixed ones cannot be distinguished in them."""
    quantities = table.quantities
    if quantities is not None and len(set(quantities)) > 1:
        listed = ", ".join(
            f"{name} {each}" for name, each in zip(table.names, quantities, strict=True)
        )
        raise FileError(
            f"{path} mixes quantities ({listed}); a layout file (--layout) that lists channels of "
            "one quantity chooses them"
        )


def record_measurement(
    measurement: Measurement,
    path: Path,
    *,
    scenario: Scenario | None = None,
    conditions: Sequence[ScadaSample] = (),
    report: Callable[[AccelerationBlock], None] | None = None,
) -> None:
    """Write a measurement to an MCAP recording.

    Parameters
    ----------
    scenario : Scenario, optional
        Scenario under which the recording is run later; None: modes alone are tracked.
    conditions : sequence of ScadaSample, optional
        What the controller reported meanwhile, in order of time.
    report : Callable[[AccelerationBlock], None], optional
        Called with every block.

    Raises
    ------
    FileError
        As the files are read.
    LayoutError
        If a channel is not on the scenario's tower.
    ScenarioError
        If the scenario does not say which structure is measured.
    RecordingError
        If the recording exists or cannot be written. A part that was written is removed if reading
        fails.
    """
    if scenario is None:
        chosen = modes_only(measurement.layout.turbine)
    else:
        chosen = require_stated_structure(scenario)
    if chosen.has_structure:
        require_on_tower(measurement.layout, chosen.structure)
    metadata = _metadata(measurement, chosen)
    with whole_recording(path, metadata=metadata, settings=COMPACT) as recorder:
        recorder.handle(measurement.layout)
        waiting = deque(conditions)
        for message in with_end(measurement.blocks()):
            while waiting and isinstance(message, AccelerationBlock):
                if waiting[0].time_ns > message.start_ns:
                    break
                recorder.handle(waiting.popleft())
            recorder.handle(message)
            if report and isinstance(message, AccelerationBlock):
                report(message)


def _metadata(measurement: Measurement, scenario: Scenario) -> Metadata:
    names = ", ".join(file.path.name for file in measurement.files)
    return {
        "pilewatch": {"version": version("pilewatch"), "source": f"import: {names}"},
        "scenario": scenario_metadata(scenario),
    }


def imported_source(
    path: Path,
    folder: Path,
    *,
    layout: Path | None = None,
    scenario: str | None = None,
    report: Callable[[AccelerationBlock], None] | None = None,
) -> str:
    """Return the `--source` that a file stands for.

    The replay of a recording, or of a file's import.

    Parameters
    ----------
    folder : Path
        Where the import is written, beside earlier ones.
    layout : Path, optional
        Where the file's channels were.

    Notes
    -----
    Raises what `open_measurement` and `record_measurement` do.
    """
    if path.suffix == ".mcap":
        return f"replay:{path}"
    chosen = None if scenario is None else load_scenario(scenario)
    measurement = open_measurement(
        [path],
        layout=None if layout is None else load_layout(layout),
        turbine="turbine" if chosen is None else chosen.turbine.id,
    )
    folder.mkdir(parents=True, exist_ok=True)
    names = (f"{path.stem}{again}.mcap" for again in ("", *(f"-{i}" for i in range(2, 1000))))
    existing = {each.name.removesuffix(ACTIVE_SUFFIX) for each in folder.iterdir()}
    recording = next(folder / name for name in names if name not in existing)
    record_measurement(measurement, recording, scenario=chosen, report=report)
    return f"replay:{recording}"
