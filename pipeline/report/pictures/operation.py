"""Pictures over operation: spectrogram, control charts, frequencies against tide, wind and rotor.

Every function returns an SVG text, or "" where there is nothing to draw.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate
from pipeline.report.canvas import INK, css_colour, page_figure
from pipeline.report.pictures.axes import (
    datetimes,
    frequency_axis,
    mark_events,
    time_axis,
    unbroken,
)
from pipeline.report.recorded_session import TurbineRecord
from pipeline.report.tracks import FrequencyTrack, frequency_tracks, most_informative
from pipeline.state.posterior_json import ratios
from pipeline.updating.prior import PARAMETER_NAMES
from pipeline.viewer.pictures import colours
from sensors.arrays import FloatArray

FEWEST_WINDOWS = 8  # of a reference from which limits are drawn
CHARTED = 4  # modes with a control chart, and with panels against tide and wind
LIMIT = 3.0  # of a control chart [standard deviations]; Shewhart (1931)
SIGMA_OF_MAD = 1.4826  # standard deviation over median absolute deviation, normal distribution [-]
FARTHEST_DRAWN = 4.0  # limits; what lies farther is a diamond at the edge [-]
LEVELS_SHOWN = 60.0  # of a spectrogram below its largest density [dB]
HARMONICS = (1, 3, 6)  # of the rotor speed, three blades
LOWEST_ROTOR_SPEED = 0.5  # of a turning rotor [rpm]
SMALLEST_RANGE = {"water_level": 0.2, "wind_speed": 1.0}  # over which a dependence shows [m, m/s]
AXIS_NAMES = {"water_level": "water level [m]", "wind_speed": "wind speed [m/s]"}


@dataclass(frozen=True, slots=True)
class ControlLimits:
    """Centre and limits of a control chart, from its reference."""

    centre: float
    """Median of the reference."""
    deviation: float
    """Robust standard deviation of the reference, 1.4826 × the median absolute deviation."""

    def outside(self, values: FloatArray) -> FloatArray:
        """(n,) bool: which values lie outside the limits."""
        return np.asarray(np.abs(values - self.centre) > LIMIT * self.deviation)


def spectrogram(record: TurbineRecord) -> str:
    """Draw the densities of all channels together over time and frequency, of the first unit."""
    for unit in sorted(record.state.layouts):
        samples = record.signals.samples.get(unit)
        found = None if samples is None else samples.spectrogram.picture()
        if samples is None or found is None:
            continue
        edges_ns, densities = found
        level = 10 * np.log10(np.maximum(densities, np.finfo(float).tiny))
        top = float(np.nanmax(level))
        with page_figure(3.2) as page:
            axes = page.figure.subplots()
            image = axes.pcolormesh(
                datetimes(edges_ns), samples.spectrogram.edges, level, cmap="cividis",
                vmin=top - LEVELS_SHOWN, vmax=top, rasterized=True,
            )  # fmt: skip
            axes.grid(visible=False)
            frequency_axis(axes, "y")
            time_axis(axes, (int(edges_ns[0]), int(edges_ns[-1])))
            scale = page.figure.colorbar(image, ax=axes, label="density below the largest [dB]")
            below = (60, 40, 20, 0)
            scale.ax.set_yticks([top - each for each in below], [str(each) for each in below])
            return page.svg()
    return ""


def control_limits(values: FloatArray, n_reference: int) -> ControlLimits:
    """Limits from the first `n_reference` values.

    Parameters
    ----------
    values : ndarray, shape (n,)
        In order of time.
    n_reference : int
        Values before the first change.
    """
    reference = values[:n_reference]
    centre = float(np.median(reference))
    deviation = SIGMA_OF_MAD * float(np.median(np.abs(reference - centre)))
    return ControlLimits(centre, deviation)


@dataclass(frozen=True, slots=True, eq=False)
class _Chart:
    label: str
    times_ns: NDArray[np.int64]
    values: FloatArray  # departure from the reference's median [%]
    limit: float  # [%]


def control_charts(record: TurbineRecord) -> str:
    """Draw frequencies and stiffnesses with limits of three standard deviations of a reference.

    The reference is what came before the first change; without one, everything.
    """
    charts = [*_stiffness_charts(record), *_frequency_charts(record)]
    if not charts:
        return ""
    with page_figure(0.7 + 0.95 * len(charts)) as page:
        panels = page.figure.subplots(len(charts), 1, sharex=True, squeeze=False)[:, 0]
        for axes, chart in zip(panels, charts, strict=True):
            _control_panel(axes, chart)
            mark_events(axes, record.state.events, named=False)
        time_axis(panels[-1], record.span_ns)
        return page.svg()


def _stiffness_charts(record: TurbineRecord) -> list[_Chart]:
    history = [record.state.posteriors[time] for time in sorted(record.state.posteriors)]
    times = np.array([each.time_ns for each in history], dtype=np.int64)
    return [
        chart
        for name in PARAMETER_NAMES
        if (
            chart := _chart(
                record,
                f"{name} [%]",
                times,
                np.array([ratios(each.parameter(name))[0] for each in history]),
            )
        )
    ]


def _frequency_charts(record: TurbineRecord) -> list[_Chart]:
    tracks = most_informative(frequency_tracks(record), CHARTED)
    return [
        chart
        for track in tracks
        if (chart := _chart(record, f"{_track_name(track)} [%]", track.times_ns, track.frequencies))
    ]


def _track_name(track: FrequencyTrack) -> str:
    return f"{float(np.median(track.frequencies)):.3g} Hz"


def _chart(
    record: TurbineRecord, label: str, times_ns: NDArray[np.int64], values: FloatArray
) -> _Chart | None:
    first = min((event.since_ns for event in record.state.events), default=None)
    n_reference = len(times_ns) if first is None else int(np.sum(times_ns <= first))
    if n_reference < FEWEST_WINDOWS:
        return None
    limits = control_limits(values, n_reference)
    if not limits.deviation > 0:
        return None
    percent = 100 * (values / limits.centre - 1)
    limit = 100 * LIMIT * limits.deviation / abs(limits.centre)
    return _Chart(label, times_ns, percent, limit)


def _control_panel(axes: Any, chart: _Chart) -> None:
    times = datetimes(chart.times_ns)
    outside = np.abs(chart.values) > chart.limit
    far = np.abs(chart.values) > FARTHEST_DRAWN * chart.limit
    edge = FARTHEST_DRAWN * chart.limit
    values = np.clip(chart.values, -edge, edge)  # else one of them hides all others
    for piece in unbroken(times):
        axes.plot(times[piece], values[piece], color=css_colour(colours.MEASURED), linewidth=0.7)
    for chosen, marker, colour in (
        (~outside, "o", colours.MEASURED),
        (outside & ~far, "o", colours.FAULT),
        (far, "D", colours.FAULT),
    ):
        axes.plot(
            times[chosen], values[chosen], marker, markersize=2.5, color=css_colour(colour),
            linestyle="none",
        )  # fmt: skip
    for limit in (-chart.limit, chart.limit):
        axes.axhline(limit, color=css_colour(colours.MODEL), linestyle="--", linewidth=0.9)
    axes.axhline(0.0, color=INK, linewidth=0.5)
    axes.set_title(chart.label)
    axes.locator_params(axis="y", nbins=4)


def beyond_limits(record: TurbineRecord) -> str:
    """Return one sentence on how many points of the control charts lie outside their limits."""
    charts = [*_stiffness_charts(record), *_frequency_charts(record)]
    total = sum(len(chart.values) for chart in charts)
    outside = sum(int(np.sum(np.abs(chart.values) > chart.limit)) for chart in charts)
    return f"{outside} of {total} points lie outside the limits"


def frequencies_against(record: TurbineRecord, quantity: str) -> str:
    """Draw frequencies against SCADA's mean of each window.

    Parameters
    ----------
    quantity : str
        "water_level" [m] or "wind_speed" [m/s].
    """
    found = _against(record, quantity)
    if not found:
        return ""
    columns = min(2, len(found))
    rows = -(-len(found) // columns)
    with page_figure(0.6 + 1.5 * rows) as page:
        panels = page.figure.subplots(rows, columns, sharex=True, squeeze=False)
        for axes, (name, x, y) in zip(panels.flat, found, strict=False):
            axes.plot(x, y, "o", markersize=2.5, color=css_colour(colours.MEASURED))
            axes.set_title(f"{name} [%], r = {np.corrcoef(x, y)[0, 1]:+.2f}")
            axes.locator_params(nbins=4)
        for axes in panels.flat[len(found) :]:
            axes.remove()
        for axes in panels.flat[max(0, len(found) - columns) : len(found)]:
            axes.tick_params(labelbottom=True)
            axes.set_xlabel(AXIS_NAMES[quantity])
        return page.svg()


def _against(record: TurbineRecord, quantity: str) -> list[tuple[str, FloatArray, FloatArray]]:
    """Name, SCADA's value and frequency over its median [%], of the modes found most often."""
    by_middle = {
        (each.start_ns + each.end_ns) // 2: float(getattr(each, quantity))
        for each in record.state.estimates
    }
    found = []
    for track in most_informative(frequency_tracks(record), CHARTED):
        x = np.array([by_middle.get(int(time), np.nan) for time in track.times_ns])
        known = np.isfinite(x)
        if known.sum() < FEWEST_WINDOWS or np.ptp(x[known]) < SMALLEST_RANGE[quantity]:
            continue
        y = 100 * (track.frequencies / np.median(track.frequencies) - 1)
        if np.ptp(y[known]) > 0:
            found.append((_track_name(track), x[known], y[known]))
    return found


def campbell(record: TurbineRecord) -> str:
    """Draw identified frequencies against the rotor speed, with its harmonics 1P, 3P and 6P."""
    windows = [each for each in record.state.estimates if np.isfinite(each.rotor_speed)]
    speeds = np.array([each.rotor_speed for each in windows])
    if not len(speeds) or np.max(speeds) < LOWEST_ROTOR_SPEED:
        return ""
    highest = 1.15 * float(np.max(speeds))
    top = 1.2 * passing_frequency(HARMONICS[-1], highest)
    with page_figure(3.6) as page:
        axes = page.figure.subplots()
        for harmonic in HARMONICS:
            end = passing_frequency(harmonic, highest)
            axes.plot([0, highest], [0, end], "--", linewidth=0.9, color=css_colour(colours.MODEL))
            axes.annotate(
                f"{harmonic}P", (highest, end), xytext=(3, 0), textcoords="offset points",
                va="center", fontsize=8,
            )  # fmt: skip
        x, y = _points_below(windows, top)
        axes.plot(x, y, "o", markersize=2.5, alpha=0.8, color=css_colour(colours.MEASURED))
        axes.set_xlim(-0.03 * highest, highest)
        axes.set_ylim(0, top)
        axes.set_xlabel("rotor speed [rpm]")
        axes.set_ylabel("frequency [Hz]")
        return page.svg()


def passing_frequency(harmonic: int, rotor_speed: float) -> float:
    """Frequency of a harmonic of the rotor speed [rpm], [Hz]."""
    return harmonic * rotor_speed / 60


def _points_below(windows: Sequence[ModalEstimate], top: float) -> tuple[list[float], list[float]]:
    points = [
        (window.rotor_speed, mode.frequency)
        for window in windows
        for mode in window.modes
        if mode.frequency < top
    ]
    return [x for x, _ in points], [y for _, y in points]
