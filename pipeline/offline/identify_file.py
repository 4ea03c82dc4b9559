"""Identify the modes in a file, without turbine, transport or posterior: `pilewatch identify`.

Windows are cut here, not by the node's windowing: a file may have uneven times, mixed quantities
and one window of any length, where blocks have one rate and windows are the scenario's.
"""

import heapq
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, QualityWarning, RefusedMode, WindowRejected
from pipeline.nodes.operating_state import OperationLog
from pipeline.oma.cross_check import CrossCheck, combined_checks
from pipeline.oma.data_quality.guessed_quantities import guessed_quantities
from pipeline.oma.identification import Identification, identify
from pipeline.oma.settings import OmaSettings
from pipeline.oma.tracking import ModeTracker
from pipeline.oma.windows.unit_alignment import UnitJoiner
from pipeline.oma.windows.windowing import BlockOrder, MissingSamples
from pipeline.recording.reader import read_messages
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError
from sensors.files.channel_names import UnusedChannel, split_motions
from sensors.files.formats import read_file
from sensors.files.layout_file import LayoutFile
from sensors.files.rotor_speed import with_rotor_speed_apart
from sensors.files.table import EVERYTHING, STANDING_STAMPS, ChannelTable, FileError, Quantity

JOINING = 5.0  # waiting time for a missing unit [s]


@dataclass(frozen=True, slots=True, eq=False)
class IdentifiedWindow:
    """An identified window with the data of its stabilisation diagram."""

    number: int
    """Number of the window, from 0."""
    samples: NDArray[np.float64]
    """Samples, shape (n, n_channels) [unit of the channels]."""
    identification: Identification


@dataclass(frozen=True, slots=True)
class RefusedCandidate:
    """What looked like a mode in a window and is not reported."""

    window: int
    """Number of the window, from 0."""
    refused: RefusedMode

    def as_json(self) -> dict[str, Any]:
        """Return frequency, damping, code and reason."""
        return {
            "window": self.window,
            "frequency_hz": self.refused.frequency,
            "damping_ratio": self.refused.damping_ratio,
            "code": self.refused.code,
            "reason": self.refused.text,
        }


@dataclass(frozen=True, slots=True, eq=False)
class FileIdentification:
    """Results of a file's windows, in order of time."""

    estimates: tuple[ModalEstimate, ...]
    rejected: tuple[WindowRejected, ...]
    sampling_rate: float
    """Sampling rate [Hz]."""
    duration: float
    """Duration of the file [s]."""
    channels: tuple[str, ...]
    start_ns: int
    """Time of the first sample [ns since 1970-01-01 UTC]; 0 where the file does not say."""
    first_identified: IdentifiedWindow | None
    """The first identified window; None where every window was rejected."""
    candidates: tuple[RefusedCandidate, ...] = ()
    """Candidates of all windows that were refused, in order of window and frequency."""
    cross_checks: Mapping[str, CrossCheck] = field(default_factory=dict)
    """Mean of a second estimator over the windows, by the mode's name."""

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """Every warning once: of identified windows, then of rejected ones."""
        warnings = [each for estimate in self.estimates for each in estimate.warnings]
        warnings += [QualityWarning(each.code, each.reason) for each in self.rejected]
        return tuple(dict.fromkeys(warnings))

    def windows_json(self) -> dict[str, Any]:
        """Return the number of identified windows and the rejected ones, as in `summary.json`."""
        rejected = [
            {
                "start": (each.start_ns - self.start_ns) / NANOSECONDS,
                "code": each.code,
                "reason": each.reason,
            }
            for each in self.rejected
        ]
        return {"identified": len(self.estimates), "rejected": rejected}


def identify_file(
    path: Path,
    *,
    sampling_rate: float | None = None,
    window: float | None = None,
    settings: OmaSettings | None = None,
    layout: LayoutFile | None = None,
    rotor_speed: float | None = None,
) -> FileIdentification:
    """Identify the modes in a recording or a file of measurements.

    Parameters
    ----------
    sampling_rate : float | None, optional
        Sampling rate [Hz]; needed where the file has neither a rate nor times.
    window : float | None, optional
        Length of a window [s]; None: the whole file is one window.
    layout : LayoutFile | None, optional
        Channels to use and their units; None: all, as in the file.
    rotor_speed : float | None, optional
        Mean speed of a turning rotor [rpm]; None: as the file has it, in a recording's SCADA
        samples or a column in rpm.

    Raises
    ------
    InputError
        If the file cannot be read, has no sampling rate or is shorter than the window.
    """
    table, rate, unused = _read(path, sampling_rate, layout)
    if rotor_speed is not None:
        table = replace(table, rotor_speed=_constant_speed(rotor_speed, len(table.samples)))
    lowest = None if settings is None else settings.lowest_frequency
    if lowest is not None and lowest >= rate / 2:
        raise InputError(
            f"--lowest-frequency {lowest:g} Hz: {path} is sampled at {rate:g} Hz, which reaches to "
            f"{rate / 2:g} Hz"
        )
    duration = len(table.samples) / rate
    if window is not None and not 0 < window <= duration * (1 + 1e-9):
        raise InputError(f"--window {window:g} s does not fit: {path} is {duration:.6g} s long")
    length = len(table.samples) if window is None else round(window * rate)
    quantities = table.quantities or guessed_quantities(table.samples, rate)
    guessed = _guess(table, quantities) + _unused(unused)
    tracker = ModeTracker()
    estimates, rejected = [], []
    first: IdentifiedWindow | None = None
    candidates: list[RefusedCandidate] = []
    checks: dict[str, list[CrossCheck]] = {}
    for window_found in _windows(table, rate, length, settings or OmaSettings(), quantities):
        answer = _answer(window_found, table, rate)
        refused = window_found.identification.refused
        candidates += [RefusedCandidate(window_found.number, each) for each in refused]
        if isinstance(answer, ModalEstimate):
            first = first or window_found
            named = tracker.named(answer.modes)
            found = window_found.identification.cross_checks
            for mode, check in zip(named, found, strict=True):
                if check is not None:
                    checks.setdefault(mode.name, []).append(check)
            estimates.append(replace(answer, modes=named, warnings=answer.warnings + guessed))
        else:
            tracker.missed()
            rejected.append(answer)
    return FileIdentification(
        tuple(estimates),
        tuple(rejected),
        rate,
        duration,
        table.names,
        table.start_ns,
        first,
        tuple(candidates),
        {name: combined_checks(each) for name, each in checks.items()},
    )


def _read(
    path: Path, sampling_rate: float | None, layout: LayoutFile | None
) -> tuple[ChannelTable, float, tuple[UnusedChannel, ...]]:
    if sampling_rate is not None and not 0 < sampling_rate < float("inf"):
        raise InputError(f"--sampling-rate is {sampling_rate:g} Hz; it must be positive")
    wanted = EVERYTHING if layout is None else layout.wanted()
    recorded = path.suffix == ".mcap"
    table = (
        recorded_channels(path)
        if recorded
        else with_rotor_speed_apart(read_file(path, wanted=wanted))
    )
    unused: tuple[UnusedChannel, ...] = ()
    if layout is not None:
        table = layout.chosen(table)
    elif not recorded:
        columns, unused = split_motions(table)
        table = table.only(columns)
    stamped = table.sampling_rate
    if stamped is None and table.times is not None:  # they stand still
        table = replace(table, times=None)
        if sampling_rate is None:
            raise FileError(STANDING_STAMPS.format(path=path))
    if sampling_rate is None and stamped is None:
        raise FileError(
            f"{path} has neither a sampling rate nor a time column (t, time or timestamp): give "
            "--sampling-rate HZ"
        )
    return table, sampling_rate or stamped or 0.0, unused


def recorded_channels(path: Path) -> ChannelTable:
    """Return the samples of a recording's first turbine, in order of time.

    Missing blocks are visible in `times`. Several acquisition units are joined on one clock.

    Raises
    ------
    RecordingError, FileError
        If it holds no blocks.
    """
    layouts: dict[str, SensorLayout] = {}
    blocks: dict[str, list[AccelerationBlock]] = {}  # of the first turbine, by unit
    operation: dict[str, OperationLog] = {}
    turbine = ""
    for message in read_messages(path, (SensorLayout, AccelerationBlock, ScadaSample)):
        if isinstance(message, ScadaSample):
            operation.setdefault(message.turbine, OperationLog(None)).note(message)
        elif isinstance(message, SensorLayout):
            layouts[message.layout_id] = message
        elif isinstance(message, AccelerationBlock):
            turbine = turbine or message.turbine
            if message.turbine == turbine:
                blocks.setdefault(message.unit, []).append(message)
    if not blocks:
        raise FileError(f"{path} holds no acceleration blocks")
    by_unit = {unit: _in_order(blocks[unit]) for unit in sorted(blocks)}
    if len(by_unit) > 1:
        table = _join_blocks(by_unit, layouts)
    else:
        (ordered,) = by_unit.values()
        table = _table(ordered, layouts)
    return _with_speed(table, operation.get(turbine, OperationLog()))


def _with_speed(table: ChannelTable, operation: OperationLog) -> ChannelTable:
    assert table.times is not None
    end_ns = table.start_ns + round(float(table.times[-1]) * NANOSECONDS) + 1
    seconds = np.linspace(0.0, float(table.times[-1]), len(table.times))
    speed = operation.rotor_speed(table.start_ns, end_ns, len(seconds))
    if speed is None:
        return table
    return replace(table, rotor_speed=np.interp(table.times, seconds, speed))


def _constant_speed(rotor_speed: float, n_samples: int) -> NDArray[np.float64]:
    if not 0 <= rotor_speed < float("inf"):
        raise InputError(f"--rotor-speed is {rotor_speed:g} rpm; it must not be negative")
    return np.full(n_samples, rotor_speed)


def _in_order(blocks: list[AccelerationBlock]) -> list[AccelerationBlock]:
    once = {(block.session, block.sequence): block for block in blocks}
    return sorted(once.values(), key=lambda block: block.start_ns)


def _join_blocks(
    by_unit: dict[str, list[AccelerationBlock]], layouts: dict[str, SensorLayout]
) -> ChannelTable:
    joiner = UnitJoiner([layouts[blocks[0].layout_id] for blocks in by_unit.values()], JOINING)
    orders = {unit: BlockOrder(JOINING) for unit in by_unit}
    chunks: list[AccelerationBlock | MissingSamples] = []
    for block in heapq.merge(*by_unit.values(), key=lambda block: block.start_ns):
        chunks += joiner.push(block, list(orders[block.unit].push(block)))
    chunks += joiner.finish()
    joined = [chunk for chunk in chunks if isinstance(chunk, AccelerationBlock)]
    return _table(joined, {joiner.layout.layout_id: joiner.layout})


def _table(blocks: list[AccelerationBlock], layouts: dict[str, SensorLayout]) -> ChannelTable:
    start_ns = blocks[0].start_ns
    times = [
        (block.start_ns - start_ns) / NANOSECONDS
        + np.arange(len(block.samples)) / block.sampling_rate
        for block in blocks
    ]
    samples = np.concatenate([block.samples for block in blocks]).astype(np.float64)
    layout = layouts.get(blocks[0].layout_id)
    names = tuple(f"ch{i + 1}" for i in range(samples.shape[1]))
    units = ("m/s²",) * len(names)
    if layout is not None:
        names, units = layout.channel_names, tuple(channel.unit for channel in layout.channels)
    return ChannelTable(names, units, samples, np.concatenate(times), start_ns)


def _guess(
    table: ChannelTable, quantities: tuple[Quantity, ...] | None
) -> tuple[QualityWarning, ...]:
    """Return a warning where the measured quantities are inferred from phases, not declared."""
    if quantities is None or table.quantities is not None:
        return ()
    slower = [
        name for name, each in zip(table.names, quantities, strict=True) if each == "velocity"
    ]
    text = (
        f"{', '.join(slower)} {'lags' if len(slower) == 1 else 'lag'} the other channels by a "
        "quarter of a period: taken for velocities beside accelerations (or displacements beside "
        "velocities); give units in the header to set this"
    )
    return (QualityWarning("quantities-guessed", text),)


def _unused(channels: tuple[UnusedChannel, ...]) -> tuple[QualityWarning, ...]:
    if not channels:
        return ()
    text = (
        f"not used, as no motion of the structure: {', '.join(map(str, channels))}; a layout file "
        "(--layout) chooses the channels"
    )
    return (QualityWarning("channels-left-out", text),)


def _windows(
    table: ChannelTable,
    rate: float,
    length: int,
    settings: OmaSettings,
    quantities: tuple[Quantity, ...] | None,
) -> Iterator[IdentifiedWindow]:
    for number, first in enumerate(range(0, len(table.samples) - length + 1, length)):
        window = slice(first, first + length)
        samples = table.samples[window]
        times = None if table.times is None else table.times[window]
        speed = None if table.rotor_speed is None else table.rotor_speed[window]
        found = identify(
            samples,
            rate,
            settings,
            times=times,
            channel_names=table.names,
            quantities=quantities,
            rotor_speed=speed,
            cross_checked=True,
        )
        yield IdentifiedWindow(number, samples, found)


def _answer(
    window: IdentifiedWindow, table: ChannelTable, rate: float
) -> ModalEstimate | WindowRejected:
    first = window.number * len(window.samples)
    start_ns = table.start_ns + _nanoseconds(
        first, rate, None if table.times is None else table.times[first:]
    )
    end_ns = start_ns + round(len(window.samples) / rate * NANOSECONDS)
    rejection = window.identification.rejection
    if rejection is not None:
        return WindowRejected("", window.number, start_ns, end_ns, rejection.code, rejection.text)
    return ModalEstimate(
        turbine="",
        window=window.number,
        start_ns=start_ns,
        end_ns=end_ns,
        layout_id="",
        channels=table.names,
        modes=window.identification.modes,
        warnings=window.identification.warnings,
    )


def _nanoseconds(first: int, rate: float, times: NDArray[np.float64] | None) -> int:
    seconds = first / rate if times is None else float(times[0])
    return round(seconds * NANOSECONDS)
