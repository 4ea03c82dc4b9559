"""Measurement: samples of several channels with their rate, start and places."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from sensors.acquisition.blocks import RATE_TOLERANCE
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, one_blas_thread
from sensors.files.table import ChannelTable, Quantity, TimeColumn, rate_of_stamps

from .errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Measurement:
    """What the channels of a structure measured, evenly sampled but for gaps in `stamps`."""

    samples: FloatArray
    """(n_samples, n_channels) in the channels' units; NaN where a sample is missing."""
    sampling_rate: float
    """[Hz]"""
    channels: tuple[str, ...]
    """Channel names, in the order of the columns."""
    units: tuple[str, ...]
    """Unit of each channel; "" for unscaled."""
    start_ns: int = 0
    """First sample [ns since 1970-01-01 UTC]; 0 where it is not known."""
    layout: SensorLayout | None = None
    """Where each channel is and along which axis it measures; None where it is not known."""
    quantities: tuple[Quantity, ...] | None = None
    """What each channel measures; None for all the same."""
    rotor_speed: FloatArray | None = None
    """Speed of a turning rotor, (n_samples,) [rpm]; None where it is not known."""
    stamps: FloatArray | None = None
    """Seconds since the first sample, (n_samples,), as the source has them, which may have gaps;
    None where only the rate is known."""

    @property
    def duration(self) -> float:
        """Length of the record [s]."""
        return len(self.samples) / self.sampling_rate

    @property
    def times(self) -> FloatArray:
        """(n_samples,) seconds since the first sample [s]."""
        if self.stamps is not None:
            return self.stamps
        return np.arange(len(self.samples)) / self.sampling_rate

    @property
    def table(self) -> ChannelTable:
        """The samples as any file of measurements gives them."""
        stated = self.quantities or ()
        return ChannelTable(
            self.channels,
            self.units,
            self.samples,
            self.stamps,
            self.start_ns,
            stated_quantities=stated,
            rotor_speed=self.rotor_speed,
        )

    def between(self, start: float, end: float) -> Measurement:
        """Return the samples of a part of the record.

        Parameters
        ----------
        start, end : float
            [s] since the first sample.

        Returns
        -------
        Measurement

        Raises
        ------
        InputError
            If nothing is left.
        """
        half_a_step = 0.5 / self.sampling_rate
        part = slice(*np.searchsorted(self.times, np.array([start, end]) - half_a_step).tolist())
        if not len(self.samples[part]):
            raise InputError(f"nothing lies between {start:g} and {end:g} s of {self!r}")
        begin = float(self.times[part][0])
        return replace(
            self,
            samples=self.samples[part],
            start_ns=self.start_ns + round(begin * 1e9),
            rotor_speed=None if self.rotor_speed is None else self.rotor_speed[part],
            stamps=None if self.stamps is None else self.stamps[part] - begin,
        )

    def __repr__(self) -> str:
        return (
            f"<Measurement: {len(self.channels)} channels, {self.duration:.6g} s "
            f"at {self.sampling_rate:g} Hz>"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """Return the samples as a table, one column a channel, indexed by time.

        Returns
        -------
        pandas.DataFrame
            Index: UTC time stamps where the start is known, else seconds.
        """
        pandas = require("pandas")
        index: Any = pandas.Index(self.times, name="time_s")
        if self.start_ns:
            stamps = self.start_ns + np.round(self.times * 1e9).astype(np.int64)
            index = pandas.DatetimeIndex(stamps, tz="UTC", name="time")
        return pandas.DataFrame(self.samples, index=index, columns=list(self.channels))

    def to_xarray(self) -> xr.DataArray:
        """Return the samples as a labelled array with the dimensions time [s] and channel."""
        xarray = require("xarray")
        return xarray.DataArray(
            self.samples,
            coords={"time": self.times, "channel": list(self.channels)},
            dims=("time", "channel"),
            attrs={"sampling_rate": self.sampling_rate, "start_ns": self.start_ns},
            name="samples",
        )

    def plot(self) -> Any:
        """Draw each channel over time.

        Returns
        -------
        numpy.ndarray of matplotlib.axes.Axes
            One a channel.
        """
        pyplot = require("matplotlib.pyplot")
        height = 1.2 * len(self.channels) + 0.8
        _, drawn = pyplot.subplots(len(self.channels), sharex=True, figsize=(9, height))
        axes = np.atleast_1d(drawn)
        for number, axis in enumerate(axes):
            axis.plot(self.times, self.samples[:, number], linewidth=0.5)
            unit = self.units[number]
            axis.set_ylabel(f"{self.channels[number]}" + (f"\n[{unit}]" if unit else ""))
        axes[-1].set_xlabel("time [s]")
        return axes


def read(
    path: str | os.PathLike[str],
    *,
    sampling_rate: float | None = None,
    layout: str | os.PathLike[str] | None = None,
    dates: Literal["day-first", "month-first"] | None = None,
    zone: str = "",
    turbine: str | None = None,
) -> Measurement:
    """Read a recording (MCAP) or a file of measurements.

    Parameters
    ----------
    path : str or path
        MCAP, CSV, TSV, Parquet, NPZ, HDF5, MATLAB, TDMS, miniSEED, …; or a session's folder.
    sampling_rate : float, optional
        [Hz]; needed where the file has neither a rate nor a time column. Time stamps that
        increase are followed all the same; a warning is logged where they have another rate.
    layout : str or path, optional
        Layout file (TOML): which channels, where they are, in what units. By default the places
        are those that a recording states, or names such as "z145-fa".
    dates : str, optional
        What comes first in dates such as 3/4/2024, "day-first" or "month-first"; None: as the dates
        of the file show, which is an error where they leave it open.
    zone : str, optional
        Time zone of dates that state none, such as "Europe/Berlin"; UTC by default.
    turbine : str, optional
        Of a recording; by default the first one, where a warning is logged if there are others.

    Returns
    -------
    Measurement

    Raises
    ------
    InputError
        If the file cannot be read, lacks the turbine, or its sampling rate is not known.
    """
    return _read(path, sampling_rate, layout, dates, zone, turbine)[0]


def _read(
    path: str | os.PathLike[str],
    sampling_rate: float | None,
    layout: str | os.PathLike[str] | None = None,
    dates: Literal["day-first", "month-first"] | None = None,
    zone: str = "",
    turbine: str | None = None,
) -> tuple[Measurement, str]:
    """See `read`; with how a stated rate differs from the file's own."""
    from pipeline.offline.measured_file import measured_channels
    from sensors.files.layout_file import load_layout
    from sensors.files.stated_rate import with_stated_rate
    from sensors.files.text.columns import log_once

    if not isinstance(path, str | os.PathLike):
        raise InputError(f"read takes a file's path, not {type(path).__name__}; identify an array")
    file = Path(path)
    mapping = None if layout is None else load_layout(Path(layout))
    if dates not in (None, "day-first", "month-first"):
        raise InputError(f"dates is {dates!r}; it can be 'day-first' or 'month-first'")
    time = TimeColumn(dates=dates, zone=zone)
    known = sampling_rate is not None
    placed = measured_channels(file, mapping, time, rate_known=known, turbine=turbine)
    table = placed.table
    rate, note = table.sampling_rate, ""
    if sampling_rate is not None:
        stated = positive("sampling_rate", sampling_rate, "Hz")
        table, rate, note = with_stated_rate(table, stated)
        if note:
            log_once(f"{file}: {note}")
    if rate is None:
        raise InputError(
            f"{file} has neither a sampling rate nor a time column: give sampling_rate [Hz]"
        )
    found = Measurement(
        samples=table.samples,
        sampling_rate=rate,
        channels=table.names,
        units=table.units,
        start_ns=table.start_ns,
        layout=placed.layout,
        quantities=table.quantities,
        rotor_speed=table.rotor_speed,
        stamps=None if table.sampling_rate is None else table.times,  # None: they stand still
    )
    return found, note


@one_blas_thread()
def simulate(
    scenario: str = "parked", *, duration: float | None = None, seed: int | None = None
) -> Measurement:
    """Simulate a scenario's turbine and what its accelerometers measure.

    It is what `read` gives of a recording of the scenario: samples in order of their stamps, blocks
    that were not sent as gaps in `stamps`, several acquisition units side by side on one clock and
    NaN where one of them has no samples. Of units that start within 5 s of each other the record
    begins with the last.

    Parameters
    ----------
    scenario : str
        Name of a shipped scenario or path of a scenario file.
    duration : float, optional
        [s]; the scenario's by default.
    seed : int, optional
        Of the random loads and noise; the scenario's by default.

    Returns
    -------
    Measurement
        Of the scenario's first turbine.

    Raises
    ------
    InputError
        If there is no such scenario, or if no block of it arrives.
    """
    from pipeline.offline.measured_file import channels_of_messages
    from pipeline.scenario import farm_members, load_scenario, with_overrides
    from pipeline.sources.sources import simulated

    chosen = with_overrides(load_scenario(scenario), duration=duration, seed=seed)
    first = farm_members(chosen)[0]
    table = channels_of_messages(simulated(first).messages(), f"scenario {scenario}").table
    places = {channel.name: channel for channel in first.layout.channels}
    return Measurement(
        samples=table.samples,
        sampling_rate=first.simulation.sampling_rate,
        channels=table.names,
        units=table.units,
        start_ns=table.start_ns,
        layout=replace(first.layout, channels=tuple(places[name] for name in table.names)),
        rotor_speed=table.rotor_speed,
        stamps=table.times,
    )


def measurement_of(
    samples: Measurement | str | os.PathLike[str] | ArrayLike,
    sampling_rate: float | None,
    channels: Sequence[str] | None,
    layout: SensorLayout | None,
) -> tuple[Measurement, str]:
    """Return a Measurement of what a caller gave: one already, a file, or an array with its rate.

    Parameters
    ----------
    samples : Measurement, path or ArrayLike, shape (n, n_channels)
        What the caller gave.
    sampling_rate : float or None
        Of an array or file that does not state it [Hz].
    channels : sequence of str or None
        Names of an array's channels where no layout has them; None: those of its columns, or ch1
        and so on.
    layout : SensorLayout or None
        Which channels to use, their names, units and places. Of channels that have names, it is
        those that it lists, in its order.

    Returns
    -------
    measurement : Measurement
    note : str
        How the sampling rate differs from the time stamps, which are followed; "" if alike.

    Raises
    ------
    InputError
        If an array has no numbers, not two axes, more channels than samples, no sampling rate
        above 0, or names that do not fit; if `channels` or another rate comes beside a
        Measurement, or `channels` beside a file.
    """
    if not isinstance(samples, Measurement | str | os.PathLike):
        return _measurement_of_array(samples, sampling_rate, channels, layout)
    _refuse_names(channels)
    if isinstance(samples, Measurement):
        measured, note = samples, ""
        _require_rate_of(samples, sampling_rate)
        _require_distinct(samples.channels)
    else:
        measured, note = _read(samples, sampling_rate)
    return (measured if layout is None else _placed(measured, layout)), note


def _refuse_names(channels: Sequence[str] | None) -> None:
    if channels is None:
        return
    raise InputError(
        f"channels are {list(channels)!r}; a file or a Measurement has its own names, channels "
        "are those of an array"
    )


def _require_rate_of(measured: Measurement, sampling_rate: float | None) -> None:
    if sampling_rate is None:
        return
    stated = positive("sampling_rate", sampling_rate, "Hz")
    if abs(measured.sampling_rate / stated - 1) > RATE_TOLERANCE:
        raise InputError(
            f"sampling_rate is {stated:g} Hz; the Measurement is sampled at "
            f"{measured.sampling_rate:g} Hz"
        )


def _require_distinct(names: Sequence[str]) -> None:
    for name in names:
        if list(names).count(name) > 1:
            raise InputError(f"channel name {name!r} appears more than once; names must differ")


def _placed(measured: Measurement, layout: SensorLayout) -> Measurement:
    """The channels that a layout lists, in its order, at its places.

    Raises
    ------
    InputError
        If the measurement lacks one of them, or has it in another unit.
    """
    columns = []
    for channel in layout.channels:
        if channel.name not in measured.channels:
            raise InputError(
                f"the layout has the channel {channel.name!r}; the measurement has "
                f"{', '.join(measured.channels)}"
            )
        column = measured.channels.index(channel.name)
        if measured.units[column] not in ("", channel.unit):
            raise InputError(
                f"channel {channel.name!r} is in {channel.unit} by the layout, in "
                f"{measured.units[column]} by the measurement"
            )
        columns.append(column)
    quantities = measured.quantities
    return replace(
        measured,
        samples=measured.samples[:, columns],
        channels=layout.channel_names,
        units=tuple(channel.unit for channel in layout.channels),
        quantities=None if quantities is None else tuple(quantities[i] for i in columns),
        layout=layout,
    )


def _measurement_of_array(
    samples: ArrayLike,
    sampling_rate: float | None,
    channels: Sequence[str] | None,
    layout: SensorLayout | None,
) -> tuple[Measurement, str]:
    """See `measurement_of`."""
    from sensors.files.fill_values import FillValues
    from sensors.files.stated_rate import with_stated_rate
    from sensors.files.text.columns import log_once

    values = _array(samples)
    own = [str(each) for each in getattr(samples, "columns", ())]
    named = own if channels is None else [str(each) for each in channels]
    by_name = layout is not None and set(layout.channel_names) <= set(named)
    if layout is not None and channels is not None and not by_name:
        raise InputError(
            f"channels are {', '.join(named)}; the layout has {', '.join(layout.channel_names)}"
        )
    if layout is not None and not by_name:  # its channels are those of the array, one by one
        named = list(layout.channel_names)
    names = tuple(named or (f"ch{number + 1}" for number in range(values.shape[1])))
    if len(names) != values.shape[1]:
        raise InputError(f"{len(names)} channel names for {values.shape[1]} channels")
    _require_distinct(names)
    start_ns, stamps = _clock_of_index(samples)
    table = ChannelTable(names, ("",) * len(names), values, stamps, start_ns)
    rate, note = (None if stamps is None else rate_of_stamps(stamps)), ""
    if rate is None or sampling_rate is not None:
        stated = positive("sampling_rate", sampling_rate, "Hz")
        table, rate, note = with_stated_rate(table, stated, "the table")
    if note:
        log_once(note)
    FillValues("the table").leave_out(table)
    found = Measurement(values, rate, names, table.units, start_ns, stamps=table.times)
    return (found if layout is None else _placed(found, layout)), note


def _array(samples: ArrayLike) -> FloatArray:
    """(n_samples, n_channels), NaN where a masked array has nothing."""
    found: np.ma.MaskedArray[Any, Any] = np.ma.asarray(samples)
    if found.dtype.kind not in "fiubO":
        raise InputError(f"samples are of type {found.dtype}; real numbers are needed")
    try:
        values = np.ma.filled(found.astype(np.float64), np.nan)
    except (TypeError, ValueError) as error:
        raise InputError(f"samples are no array of numbers: {error}") from None
    values = values[:, None] if values.ndim == 1 else values
    if values.ndim != 2 or not values.size:
        raise InputError(f"samples are of shape {values.shape}; (n_samples, n_channels) is needed")
    n_samples, n_channels = values.shape
    if n_channels > n_samples:
        raise InputError(
            f"samples are of shape {values.shape}: {n_channels} channels of {n_samples} samples; "
            "transpose them to (n_samples, n_channels)"
        )
    return values


def _clock_of_index(samples: object) -> tuple[int, FloatArray | None]:
    """First sample [ns since 1970-01-01 UTC] and seconds since it, of a table that is indexed by
    time stamps (without a zone: UTC) or by durations; 0 and None of others."""
    index: Any = samples.index if hasattr(samples, "index") else ()
    if getattr(index, "tz", None) is not None:
        index = index.tz_convert(None)
    stamps = np.asarray(() if callable(index) else index)
    if stamps.ndim != 1 or len(stamps) < 2 or stamps.dtype.kind not in "mM":
        return 0, None
    if np.isnat(stamps).any():
        row = int(np.flatnonzero(np.isnat(stamps))[0])
        raise InputError(f"row {row} of the table has no time in its index, which is NaT there")
    start = stamps[0].astype("datetime64[ns]").astype(int) if stamps.dtype.kind == "M" else 0
    return int(start), np.asarray((stamps - stamps[0]) / np.timedelta64(1, "s"))


def positive(name: str, value: object, unit: str) -> float:
    """Return a caller's number above 0.

    Parameters
    ----------
    name : str
        Of the argument, for the message.
    value : object
        What the caller gave.
    unit : str
        Of the number, for the message.

    Raises
    ------
    InputError
        If it is none.
    """
    is_number = np.isscalar(value) and not isinstance(value, str | bytes | bool | complex)
    if not is_number or not 0 < value < float("inf"):  # type: ignore[operator]
        raise InputError(f"{name} is {value!r}; a number above 0 is needed [{unit}]")
    return float(value)  # type: ignore[arg-type]
