"""Identify the modes in a file, without turbine, transport or posterior: `pilewatch identify`.

Windows are cut here, not by the node's windowing: a file may have uneven times, mixed quantities
and one window of any length, where blocks have one rate and windows are the scenario's.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, QualityWarning, RefusedMode, WindowRejected
from pipeline.offline.measured_file import measured_channels
from pipeline.oma.cross_check import CrossCheck, combined_checks
from pipeline.oma.data_quality.guessed_quantities import guessed_quantities
from pipeline.oma.identification import Identification, identify
from pipeline.oma.settings import OmaSettings
from pipeline.oma.tracking import ModeTracker
from pipeline.state.repeated_warnings import DistinctWarnings
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.rounded_stamps import without_rounding
from sensors.errors import InputError
from sensors.files.channel_names import UnusedChannel, note_unknown_units, split_motions
from sensors.files.layout_file import LayoutFile
from sensors.files.stated_rate import with_stated_rate
from sensors.files.table import (
    STANDING_STAMPS,
    UNSTATED,
    ChannelTable,
    FileError,
    Quantity,
    TimeColumn,
)


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
        return warnings_of(self.estimates, self.rejected)

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


def warnings_of(
    estimates: Iterable[ModalEstimate], rejected: Iterable[WindowRejected]
) -> tuple[QualityWarning, ...]:
    """Return every warning of the windows once, then why windows were rejected."""
    found = [each for estimate in estimates for each in estimate.warnings]
    found += [QualityWarning(each.code, each.reason) for each in rejected]
    return tuple(DistinctWarnings(found))


def identify_file(
    path: Path,
    *,
    sampling_rate: float | None = None,
    window: float | None = None,
    settings: OmaSettings | None = None,
    layout: LayoutFile | None = None,
    time: TimeColumn = UNSTATED,
    rotor_speed: float | None = None,
) -> FileIdentification:
    """Identify the modes in a recording or a file of measurements.

    Parameters
    ----------
    sampling_rate : float | None, optional
        Sampling rate [Hz]; needed where the file has neither a rate nor times. Time stamps that
        increase are followed all the same, with a warning where they have another rate.
    window : float | None, optional
        Length of a window [s]; None: the whole file is one window.
    layout : LayoutFile | None, optional
        Channels to use and their units; None: all, as in the file.
    time : TimeColumn
        What its dates do not state: order of day and month, zone.
    rotor_speed : float | None, optional
        Mean speed of a turning rotor [rpm]; None: as the file has it, in a recording's SCADA
        samples or a column in rpm.

    Raises
    ------
    InputError
        If the file cannot be read, has no sampling rate or is shorter than the window.
    """
    table, rate, unused, warnings = _read(path, sampling_rate, layout, time)
    if rotor_speed is not None:
        table = replace(table, rotor_speed=_constant_speed(rotor_speed, len(table.samples)))
    lowest = None if settings is None else settings.lowest_frequency
    if lowest is not None and lowest >= rate / 2:
        raise InputError(
            f"--lowest-frequency {lowest:g} Hz: {path} is sampled at {rate:g} Hz, which reaches to "
            f"{rate / 2:g} Hz"
        )
    length = len(table.samples)
    if window is not None:
        length = window_samples("--window", window, length, rate, str(path))
    return identify_table(table, rate, length, settings=settings, unused=unused, warnings=warnings)


def window_samples(
    argument: str, window: float, n_samples: int, rate: float, origin: str = "the record"
) -> int:
    """Return the samples of a window of a stated length.

    Parameters
    ----------
    argument : str
        What states it, for an error.
    window : float
        [s]
    n_samples : int
        Of the record.
    rate : float
        Sampling rate [Hz].
    origin : str
        What to call the record in an error.

    Raises
    ------
    InputError
        If it is not positive, longer than the record or shorter than one sample.
    """
    duration = n_samples / rate
    if not window > 0:
        raise InputError(f"{argument} is {window:g} s; it must be positive")
    if window > duration * (1 + 1e-9):
        raise InputError(f"{argument} {window:g} s does not fit: {origin} is {duration:.6g} s long")
    if (length := round(window * rate)) < 1:
        raise InputError(
            f"{argument} is {window:g} s; at {rate:g} Hz a sample takes {1 / rate:g} s, and modes "
            "take windows of many periods of the lowest"
        )
    return length


def identify_table(
    table: ChannelTable,
    rate: float,
    length: int,
    *,
    settings: OmaSettings | None = None,
    unused: tuple[UnusedChannel, ...] = (),
    warnings: tuple[QualityWarning, ...] = (),
    layout: SensorLayout | None = None,
) -> FileIdentification:
    """Identify the modes in a table of channels, window by window.

    Parameters
    ----------
    rate : float
        Sampling rate [Hz].
    length : int
        Samples of a window.
    unused : tuple of UnusedChannel
        Channels that were left out, for a warning.
    warnings : tuple of QualityWarning
        Warnings of the whole file, beside those found here.
    layout : SensorLayout, optional
        Whose turbine and channels these are.
    """
    if table.times is not None:
        table = replace(table, times=without_rounding(table.times, rate))
    quantities = table.quantities or guessed_quantities(table.samples, rate)
    found = _Found(warnings + _guess(table, quantities, rate) + _unused(unused))
    for window in _windows(table, rate, length, settings or OmaSettings(), quantities):
        found.take(window, _answer(window, table, rate, layout))
    return FileIdentification(
        tuple(found.estimates),
        tuple(found.rejected),
        rate,
        len(table.samples) / rate,
        table.names,
        table.start_ns,
        found.first,
        tuple(found.candidates),
        {name: combined_checks(each) for name, each in found.checks.items()},
    )


@dataclass(slots=True)
class _Found:
    """What the windows so far gave."""

    warnings: tuple[QualityWarning, ...]
    """Of the whole file."""
    tracker: ModeTracker = field(default_factory=ModeTracker)
    estimates: list[ModalEstimate] = field(default_factory=list)
    rejected: list[WindowRejected] = field(default_factory=list)
    candidates: list[RefusedCandidate] = field(default_factory=list)
    checks: dict[str, list[CrossCheck]] = field(default_factory=dict)
    first: IdentifiedWindow | None = None

    def take(self, window: IdentifiedWindow, answer: ModalEstimate | WindowRejected) -> None:
        """Add the next window."""
        found = window.identification
        self.candidates += [RefusedCandidate(window.number, each) for each in found.refused]
        if isinstance(answer, WindowRejected):
            self.tracker.missed()
            self.rejected.append(answer)
            return
        self.first = self.first or window
        named = self.tracker.named(answer.modes)
        for mode, check in zip(named, found.cross_checks, strict=True):
            if check is not None:
                self.checks.setdefault(mode.name, []).append(check)
        warnings = answer.warnings + self.warnings
        self.estimates.append(replace(answer, modes=named, warnings=warnings))


def _read(
    path: Path,
    sampling_rate: float | None,
    layout: LayoutFile | None,
    time: TimeColumn,
) -> tuple[ChannelTable, float, tuple[UnusedChannel, ...], tuple[QualityWarning, ...]]:
    """Return the channels, their rate, those left out, and where the stated rate is not theirs."""
    if sampling_rate is not None and not 0 < sampling_rate < float("inf"):
        raise InputError(f"--sampling-rate is {sampling_rate:g} Hz; it must be positive")
    known = sampling_rate is not None
    table = measured_channels(path, layout, time, rate_known=known).table
    unused: tuple[UnusedChannel, ...] = ()
    if layout is None and path.suffix != ".mcap":
        columns, unused = split_motions(table, str(path))
        table = table.only(columns)
    note_unknown_units(table, str(path))
    if sampling_rate is not None:
        table, rate, note = with_stated_rate(table, sampling_rate)
        warnings = (QualityWarning("sampling-rate", note),) if note else ()
        return table, rate, unused, warnings
    own = table.sampling_rate
    if own is None and table.times is not None:  # they stand still
        raise FileError(STANDING_STAMPS.format(path=path))
    if own is None:
        raise FileError(
            f"{path} has neither a sampling rate nor a time column (t, time or timestamp): give "
            "--sampling-rate HZ"
        )
    return table, own, unused, ()


def _constant_speed(rotor_speed: float, n_samples: int) -> NDArray[np.float64]:
    if not np.isfinite(rotor_speed):
        raise InputError(f"--rotor-speed is {rotor_speed:g} rpm; a finite number is needed")
    if rotor_speed < 0:
        raise InputError(f"--rotor-speed is {rotor_speed:g} rpm; it must not be negative")
    return np.full(n_samples, rotor_speed)


def _guess(
    table: ChannelTable, quantities: tuple[Quantity, ...] | None, rate: float
) -> tuple[QualityWarning, ...]:
    """Return a warning where the measured quantities are inferred from phases, not declared, or
    where phases contradict what is declared."""
    if quantities is None:
        return ()
    if table.quantities is not None:
        return _contradicted(table, rate)
    slower = [
        name for name, each in zip(table.names, quantities, strict=True) if each == "velocity"
    ]
    text = (
        f"{', '.join(slower)} {'lags' if len(slower) == 1 else 'lag'} the other channels by a "
        "quarter of a period: taken for velocities beside accelerations (or displacements beside "
        "velocities); give units in the header to set this"
    )
    return (QualityWarning("quantities-guessed", text),)


def _contradicted(table: ChannelTable, rate: float) -> tuple[QualityWarning, ...]:
    """Return a warning where channels declared alike are a quarter of a period apart."""
    if len(set(table.quantities or ())) != 1:
        return ()
    by_phase = guessed_quantities(table.samples, rate)
    if by_phase is None:
        return ()
    leading = [each == "acceleration" for each in by_phase]
    few = 2 * sum(leading) <= len(leading)
    odd = [name for name, each in zip(table.names, leading, strict=True) if each == few]
    text = (
        f"{', '.join(odd)} {'differs' if len(odd) == 1 else 'differ'} from the other channels by a "
        "quarter of a period, as a velocity does from an acceleration, and the file states one "
        "quantity for all: their components of the shapes are wrong unless a unit or a layout is "
        "corrected"
    )
    return (QualityWarning("quantities-doubtful", text),)


def _unused(channels: tuple[UnusedChannel, ...]) -> tuple[QualityWarning, ...]:
    if not channels:
        return ()
    text = (
        f"not used, as no motion of the structure: {', '.join(map(str, channels))}; a layout file "
        "chooses the channels"
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
        found = identify(
            samples,
            rate,
            settings,
            times=None if table.times is None else table.times[window],
            channel_names=table.names,
            quantities=quantities,
            rotor_speed=None if table.rotor_speed is None else table.rotor_speed[window],
            cross_checked=True,
        )
        yield IdentifiedWindow(number, samples, found)


def _answer(
    window: IdentifiedWindow, table: ChannelTable, rate: float, layout: SensorLayout | None
) -> ModalEstimate | WindowRejected:
    turbine, found = layout.turbine if layout else "", window.identification
    length = len(window.samples)
    first = window.number * length
    seconds = first / rate if table.times is None else float(table.times[first])
    start_ns = table.start_ns + round(seconds * NANOSECONDS)
    end_ns = start_ns + round(length / rate * NANOSECONDS)
    if found.rejection is not None:
        why = found.rejection
        return WindowRejected(turbine, window.number, start_ns, end_ns, why.code, why.text)
    return ModalEstimate(
        turbine=turbine,
        window=window.number,
        start_ns=start_ns,
        end_ns=end_ns,
        layout_id=layout.layout_id if layout else "",
        channels=table.names,
        modes=found.modes,
        warnings=found.warnings,
    )
