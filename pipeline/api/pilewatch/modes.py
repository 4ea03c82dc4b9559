"""Modes of a structure from its measured response, with their uncertainty."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.messages import ModalEstimate, Mode, QualityWarning, WindowRejected
from sensors.acquisition.blocks import has_clock
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, one_blas_thread

from .errors import InputError, require
from .measurement import Measurement, measurement_of, positive

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


MODE_COLUMNS = (
    *("window", "start", "mode", "frequency_hz", "frequency_std_hz"),
    *("damping_ratio", "damping_ratio_std", "quality"),
)  # of a table of modes, before the channels


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Modes:
    """Modes identified in each window of a measurement."""

    estimates: tuple[ModalEstimate, ...]
    """One a window that was identified, in order of time."""
    rejected: tuple[WindowRejected, ...]
    """Windows that were not identified, each with its reason."""
    channels: tuple[str, ...]
    """Channel names, in the order of the shapes' components."""
    layout: SensorLayout | None = None
    """Where the channels are; None where it is not known."""

    @property
    def last(self) -> tuple[Mode, ...]:
        """Modes of the last identified window, lowest frequency first."""
        return self.estimates[-1].modes if self.estimates else ()

    @property
    def frequencies(self) -> FloatArray:
        """(n_modes,) natural frequencies of the last identified window [Hz]."""
        return np.array([mode.frequency for mode in self.last])

    @property
    def damping_ratios(self) -> FloatArray:
        """(n_modes,) fractions of critical damping in the last identified window [-]."""
        return np.array([mode.damping_ratio for mode in self.last])

    @property
    def shapes(self) -> FloatArray:
        """(n_modes, n_channels) shapes of the last identified window, largest component 1 [-]."""
        return np.array([mode.shape for mode in self.last]).reshape(-1, len(self.channels))

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """Every reservation of the windows once, then why windows were rejected."""
        from pipeline.offline.identify_file import warnings_of

        return warnings_of(self.estimates, self.rejected)

    def __len__(self) -> int:
        return len(self.last)

    def __repr__(self) -> str:
        windows = f"{len(self.estimates)} window{'' if len(self.estimates) == 1 else 's'}"
        rejected = f", {len(self.rejected)} rejected" if self.rejected else ""
        if not len(self):
            why = f": {self.rejected[0].reason}" if self.rejected and not self.estimates else ""
            return f"<Modes: none in {windows}{rejected}{why}>"
        listed = ", ".join(f"{f:.4g}" for f in self.frequencies[:8])
        more = ", …" if len(self) > 8 else ""
        return f"<Modes: {len(self)} in the last of {windows}{rejected}: {listed}{more} Hz>"

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row a mode and window.

        Returns
        -------
        pandas.DataFrame
            window, start (UTC; NaT without a clock), mode, frequency_hz, frequency_std_hz,
            damping_ratio, damping_ratio_std, quality, then one column a channel with the shape, NaN
            in windows without the channel; one that is called like a column before it is "NAME
            (shape)".
        """
        pandas = require("pandas")
        figures = [
            {
                "window": estimate.window,
                "start": pandas.Timestamp(estimate.start_ns, tz="UTC")
                if has_clock(estimate.start_ns)
                else pandas.NaT,
                "mode": mode.name,
                "frequency_hz": mode.frequency,
                "frequency_std_hz": mode.frequency_std,
                "damping_ratio": mode.damping_ratio,
                "damping_ratio_std": mode.damping_ratio_std,
                "quality": mode.quality,
            }
            for estimate in self.estimates
            for mode in estimate.modes
        ]
        table = pandas.DataFrame(figures, columns=list(MODE_COLUMNS))
        used = [name for estimate in self.estimates for name in estimate.channels]
        columns = channel_columns(dict.fromkeys(used or self.channels), MODE_COLUMNS)
        shapes = [
            {columns[name]: each for name, each in zip(estimate.channels, mode.shape, strict=True)}
            for estimate in self.estimates
            for mode in estimate.modes
        ]
        return table.join(pandas.DataFrame(shapes, columns=list(columns.values()), dtype=float))

    def to_xarray(self) -> xr.Dataset:
        """Return the last window's modes: frequency, damping ratio and shape with their std."""
        xarray = require("xarray")
        per_mode = {
            name: ("mode", np.array([getattr(mode, name) for mode in self.last]))
            for name in ("frequency", "frequency_std", "damping_ratio", "damping_ratio_std")
        }
        shapes = {"shape": (("mode", "channel"), self.shapes)}
        coordinates = {"mode": [mode.name for mode in self.last], "channel": list(self.channels)}
        return xarray.Dataset(per_mode | shapes, coords=coordinates)

    def plot(self) -> Any:
        """Draw the frequencies of all windows with their 90 % intervals, over the windows' starts;
        one window after the other where no clock is known.

        Returns
        -------
        matplotlib.axes.Axes
        """
        pyplot = require("matplotlib.pyplot")
        _, axis = pyplot.subplots(figsize=(9, 5))
        clocked = all(has_clock(estimate.start_ns) for estimate in self.estimates)
        for number, estimate in enumerate(self.estimates):
            stds = np.array([mode.frequency_std for mode in estimate.modes])
            frequencies = [mode.frequency for mode in estimate.modes]
            # not by their number, which begins again with a session
            start = np.datetime64(estimate.start_ns, "ns") if clocked else number
            place = np.full(len(frequencies), start)
            axis.errorbar(place, frequencies, yerr=1.645 * stds, fmt=".", color="C0")
        when = "start of the window (UTC)" if clocked and self.estimates else "window"
        axis.set(xlabel=when, ylabel="natural frequency [Hz]", yscale="log")
        return axis

    def plot_shapes(self) -> Any:
        """Draw the shapes of the last window, one panel a mode, over height where it is known.

        Returns
        -------
        numpy.ndarray of matplotlib.axes.Axes
            One a mode.

        Raises
        ------
        InputError
            If there is no mode.
        """
        return draw_shapes(self.shapes, self.frequencies, self.channels, self.layout)


def channel_columns(channels: Iterable[str], others: Collection[str]) -> dict[str, str]:
    """Return the column of each channel in a table that has other columns too: its name, or
    "NAME (shape)" where another column is called so."""
    columns: dict[str, str] = {}
    for name in channels:
        column = name
        while column in others or column in columns.values():
            column += " (shape)"
        columns[name] = column
    return columns


def draw_shapes(
    shapes: FloatArray,
    frequencies: FloatArray,
    channels: Sequence[str],
    layout: SensorLayout | None,
) -> Any:
    """Draw mode shapes, one panel a mode, one line a direction of the tower.

    At each height it is the displacement that its sensors show, as in the viewer: one that points
    the other way round is turned. A direction that they measure less than across is not drawn.

    Parameters
    ----------
    shapes : ndarray, shape (n_modes, n_channels)
        [-].
    frequencies : ndarray, shape (n_modes,)
        For the titles [Hz].
    channels : sequence of str
        Names, in the order of the shapes' columns.
    layout : SensorLayout or None
        Where the channels are; None: they are drawn one above the other.

    Raises
    ------
    InputError
        If there is no mode.
    """
    if not len(shapes):
        raise InputError("there is no mode to draw")
    pyplot = require("matplotlib.pyplot")
    columns = min(6, len(shapes))
    rows = -(-len(shapes) // columns)
    size = (1.7 * columns, 3.0 * rows)
    _, axes = pyplot.subplots(rows, columns, sharex=True, sharey=True, figsize=size, squeeze=False)
    for axis, shape, frequency in zip(axes.flat, shapes, frequencies, strict=False):
        for line in _shape_lines(shape, channels, layout):
            axis.plot(line.components, line.heights, "o-", markersize=3, label=line.name)
        axis.axvline(0.0, color="grey", linewidth=0.6)
        axis.set_title(f"{frequency:.4g} Hz")
    for axis in axes.flat[len(shapes) :]:
        axis.remove()
    axes[0, 0].set_ylabel("elevation [m]" if layout is not None else "channel")
    if layout is None:
        axes[0, 0].set_yticks(np.arange(len(channels)), list(channels))
    else:
        axes[0, 0].legend(fontsize="small")
    return axes


@dataclass(frozen=True, slots=True, eq=False)
class _ShapeLine:
    """A shape's components along one direction."""

    name: str
    components: FloatArray
    """(n_heights,) [-]"""
    heights: FloatArray
    """(n_heights,) [m]; without a layout the channels' numbers."""


def _shape_lines(
    shape: FloatArray, channels: Sequence[str], layout: SensorLayout | None
) -> list[_ShapeLine]:
    """Each direction that is measured, lowest height first: of the sensors at a height, the
    smallest displacement that explains all of them best, as `deflection` of the viewer."""
    if layout is None:
        return [_ShapeLine("", shape, np.arange(len(channels), dtype=np.float64))]
    by_name = {channel.name: channel for channel in layout.channels}
    elevations = np.array([by_name[name].elevation for name in channels])
    directions = np.array([by_name[name].direction for name in channels])
    heights = np.unique(elevations)
    displacements, shares = np.empty((2, len(heights), 3))
    for number, height in enumerate(heights):
        own = elevations == height
        inverse = np.linalg.pinv(directions[own])
        displacements[number] = inverse @ shape[own]
        shares[number] = np.diag(inverse @ directions[own])  # cos² from an axis to what is measured
    seen = shares >= 0.5 - 1e-9
    return [
        _ShapeLine(name, displacements[at, axis], heights[at])
        for axis, name in enumerate(("fore-aft", "side-side", "vertical"))
        if (at := seen[:, axis]).any()
    ]


@one_blas_thread()
def identify(
    samples: Measurement | str | os.PathLike[str] | ArrayLike,
    sampling_rate: float | None = None,
    *,
    channels: Sequence[str] | None = None,
    layout: SensorLayout | None = None,
    window: float | None = None,
    rotor_speed: float | ArrayLike | None = None,
) -> Modes:
    """Identify the modes of a structure from its measured response alone (SSI-cov).

    Parameters
    ----------
    samples : Measurement, path or array_like, shape (n_samples, n_channels)
        Accelerations, velocities or displacements under ambient load, in any unit. Of a file,
        channels that are no motion (wind, power) or never change are left out, with a warning.
    sampling_rate : float, optional
        [Hz]; needed with an array, unless it is a table indexed by time stamps. Stamps that
        increase are followed all the same, with a warning where they have another rate.
    channels : sequence of str, optional
        Channel names of an array; a table's columns by default.
    layout : SensorLayout, optional
        Which channels to use and where they are; `update` needs it. An array without names has
        those of the layout.
    window : float, optional
        Length of one window [s]; the whole record by default.
    rotor_speed : float or array_like, shape (n_samples,), optional
        Speed of a turning rotor [rpm], whose harmonics are then no modes; the measurement's by
        default.

    Returns
    -------
    Modes

    Raises
    ------
    InputError
        If the samples have no rate or not two axes, or an argument does not fit them: a window
        longer than the record, another rate or `channels` beside what states its own, a layout with
        channels that are not there, a negative rotor speed.
    """
    from pipeline.offline.identify_file import identify_table
    from sensors.files.channel_names import UnusedChannel, split_motions

    measured, note = measurement_of(samples, sampling_rate, channels, layout)
    speed = measured.rotor_speed if rotor_speed is None else _speed(rotor_speed, measured)
    table = replace(measured.table, rotor_speed=speed)
    unused: tuple[UnusedChannel, ...] = ()
    if isinstance(samples, Measurement | str | os.PathLike) and measured.layout is None:
        columns, unused = split_motions(replace(table, times=None))
        table = table.only(columns)
    found = identify_table(
        table,
        measured.sampling_rate,
        _window_samples(measured, window),
        unused=unused,
        warnings=(QualityWarning("sampling-rate", note),) if note else (),
        layout=measured.layout,
    )
    return Modes(found.estimates, found.rejected, found.channels, measured.layout)


def _speed(rotor_speed: float | ArrayLike, measured: Measurement) -> FloatArray:
    """At each sample [rpm]."""
    try:
        given = np.asarray(rotor_speed, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"rotor_speed is {rotor_speed!r}; numbers are needed [rpm]") from None
    if given.shape not in ((), (len(measured.samples),)):
        raise InputError(
            f"rotor_speed has the shape {given.shape}; one number or one a sample, "
            f"({len(measured.samples)},), is needed [rpm]"
        )
    speeds = np.broadcast_to(given, len(measured.samples))
    wrong = np.flatnonzero(~(np.isfinite(speeds) & (speeds >= 0)))
    if wrong.size:
        where = f" at sample {wrong[0]}" if given.shape else ""
        raise InputError(
            f"rotor_speed is {speeds[wrong[0]]:g} rpm{where}; a finite number, 0 or more, is needed"
        )
    return speeds


def _window_samples(measured: Measurement, window: float | None) -> int:
    from pipeline.offline.identify_file import window_samples

    if window is None:
        return len(measured.samples)
    length = positive("window", window, "s")
    return window_samples("window", length, len(measured.samples), measured.sampling_rate)


def with_layout(modes: Modes, layout: SensorLayout) -> Modes:
    """Return the same modes with the places of their channels.

    Raises
    ------
    InputError
        If the layout's channels are not those of the modes.
    """
    if layout.channel_names != modes.channels:
        raise InputError(
            f"the layout has the channels {', '.join(layout.channel_names)}; the modes have "
            f"{', '.join(modes.channels)}"
        )
    return replace(modes, layout=layout)
