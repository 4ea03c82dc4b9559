"""Axes that pictures of a report share: time, logarithmic frequency, legends."""

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FoundationEvent
from pipeline.report.canvas import css_colour
from pipeline.report.wording import day
from pipeline.state.phrases import in_hertz
from pipeline.viewer.pictures import colours
from sensors.acquisition.blocks import has_clock
from sensors.arrays import FloatArray

Times = NDArray[np.datetime64]

MINUTES_NS = 600 * 10**9  # below this span, times have seconds [ns]
HOURS_NS = 86_400 * 10**9  # up to this span the hour suffices: the day is in the label [ns]
FEW = 40  # windows that are drawn one by one, with bars; more are drawn as a band
MODE_LABEL_RATIO = 1.2  # between two frequencies that are written, so that they do not overlap


def datetimes(times_ns: Sequence[int] | NDArray[np.int64]) -> Times:
    """(n,) as matplotlib takes times."""
    return np.asarray(times_ns, dtype=np.int64).astype("datetime64[ns]")


def draw_band(axes: Any, times: Times, bands: FloatArray, colour: colours.Colour) -> None:
    """Draw points with bars for a few windows, a band for many.

    Parameters
    ----------
    bands : ndarray, shape (n, 3)
        Middle, low, high. The band breaks where windows are missing.
    """
    middle, low, high = bands.T
    if len(times) <= FEW:
        axes.errorbar(
            times, middle, yerr=[middle - low, high - middle], fmt="o", markersize=2.5,
            elinewidth=1.2, color=css_colour(colour),
        )  # fmt: skip
        return
    for piece in unbroken(times):
        axes.fill_between(
            times[piece], low[piece], high[piece], color=css_colour(colour), alpha=0.35, linewidth=0
        )
        axes.plot(times[piece], middle[piece], color=css_colour(colour))


def unbroken(times: Times) -> list[NDArray[np.intp]]:
    """Places of the times that follow each other without a missing window, stretch by stretch."""
    if len(times) < 2:
        return [np.arange(len(times))]
    steps = np.diff(times).astype(np.int64)
    behind_holes = 1 + np.flatnonzero(steps > 1.5 * np.median(steps))
    return np.split(np.arange(len(times)), behind_holes)


def mark_events(axes: Any, events: Sequence[FoundationEvent], named: bool) -> None:
    """Draw a line at the most probable start of a change, its 90 % interval shaded."""
    colour = css_colour(colours.FAULT)
    for number, event in enumerate(events):
        since, first, last = datetimes(
            [event.since_ns, event.since_earliest_ns, event.since_latest_ns]
        )
        axes.axvspan(first, last, color=colour, alpha=0.2, linewidth=0)
        label = "change" if named and number == 0 else None
        axes.axvline(since, color=colour, linestyle=":", label=label)


def add_legend(axes: Any) -> None:
    """Name what is drawn, in one row above the picture's right edge."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            handles, labels, loc="lower right", bbox_to_anchor=(1, 1), ncols=len(handles),
            borderaxespad=0.2,
        )  # fmt: skip


def time_axis(axes: Any, span_ns: tuple[int, int], *, label: bool = True) -> None:
    """Span the recording on the time axis, in UTC or, without a clock, from the start."""
    start_ns, end_ns = span_ns
    margin = (end_ns - start_ns) // 50  # without limits, a single window spans years
    axes.set_xlim(*datetimes([start_ns - margin, end_ns + margin]))
    dates: Any = importlib.import_module("matplotlib.dates")  # its classes have no types
    locator = dates.AutoDateLocator(minticks=3, maxticks=7 if label else 4)
    locator.intervald[dates.SECONDLY].append(60)  # else two minutes fit no interval,
    locator.intervald[dates.MINUTELY].append(60)  # nor two hours
    locator.intervald[dates.HOURLY].append(24)  # nor two days
    axes.xaxis.set_major_locator(locator)
    clocked = has_clock(start_ns)
    if clocked and end_ns - start_ns > HOURS_NS:
        formatter = dates.ConciseDateFormatter(locator, show_offset=False)
    else:
        formatter = dates.DateFormatter("%H:%M:%S" if end_ns - start_ns < MINUTES_NS else "%H:%M")
    axes.xaxis.set_major_formatter(formatter)
    if label:
        unit = "h:min:s" if end_ns - start_ns < MINUTES_NS else "h:min"
        first, last = day(start_ns), day(end_ns)
        days = first if first == last else f"{first} to {last}"
        axes.set_xlabel(f"{days}, UTC" if clocked else f"time since the start [{unit}]")


def frequency_axis(axes: Any, which: str = "x", label: str = "frequency [Hz]") -> None:
    """Make the "x" or the "y" axis a logarithmic one of frequencies."""
    from matplotlib.ticker import LogLocator

    axis = getattr(axes, f"{which}axis")
    getattr(axes, f"set_{which}scale")("log")
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter("")
    axis.set_label_text(label)


def mark_modes(axes: Any, frequencies: Sequence[float], *, written: bool) -> None:
    """Draw an upright line at each mode, its frequency above those that do not overlap."""
    last = 0.0
    for frequency in sorted(frequencies):
        axes.axvline(
            frequency, color=css_colour(colours.MODEL), linewidth=0.6, alpha=0.6, zorder=0.5
        )
        if written and frequency > MODE_LABEL_RATIO * last:
            axes.text(
                frequency, 1.02, in_hertz(frequency), rotation=90, fontsize=7, ha="center",
                va="bottom", transform=axes.get_xaxis_transform(),
            )  # fmt: skip
            last = frequency
