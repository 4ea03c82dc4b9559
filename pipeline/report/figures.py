"""Draw the pictures of a report: stiffness and frequencies over time, joint posterior, windows.

Every function returns an SVG text, or "" where there is nothing to draw. Times are UTC.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipeline.messages import (
    HALF_INTERVAL,
    FoundationPosterior,
    ModalEstimate,
    StreamGap,
    WindowRejected,
)
from pipeline.report.canvas import INK, css_colour, page_figure
from pipeline.report.pictures.axes import (
    Times,
    add_legend,
    datetimes,
    draw_band,
    frequency_axis,
    mark_events,
    time_axis,
)
from pipeline.report.recorded_session import TurbineRecord
from pipeline.report.tracks import FrequencyTrack, frequency_tracks, most_informative
from pipeline.state.phrases import in_hertz
from pipeline.state.posterior_json import ratios
from pipeline.updating.prior import PARAMETER_NAMES
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.scene import Deflection, deflection
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

_Spanned = ModalEstimate | WindowRejected | StreamGap

SHAPES = 12  # modes whose shapes are drawn
FEWEST_FOR_TIME = 2  # windows; one is in the table, and shows nothing over time
TRACKS = 8  # modes with a panel of their own
VECTOR_POINTS = 1500  # more of them are drawn as pixels


def stiffness_over_time(record: TurbineRecord) -> str:
    """Draw median and 90 % interval of k11, k22, k12 ÷ nominal after every window.

    With the truth where it is known, and detected changes.
    """
    history = sorted(record.state.posteriors.values(), key=lambda posterior: posterior.time_ns)
    if not history:
        return ""
    times = datetimes([posterior.time_ns for posterior in history])
    with page_figure(4.6) as page:
        panels = page.figure.subplots(len(PARAMETER_NAMES), 1, sharex=True)
        for axes, name in zip(panels, PARAMETER_NAMES, strict=True):
            bands = np.array([ratios(posterior.parameter(name)) for posterior in history])
            draw_band(axes, times, bands, colours.POSTERIOR)
            _mark_untrusted(axes, times, bands, [posterior.trusted for posterior in history])
            _mark_truth(axes, record, name, times)
            mark_events(axes, record.state.events, axes is panels[0])
            axes.set_ylabel(f"{name} ÷ nominal")
        add_legend(panels[0])
        time_axis(panels[-1], record.span_ns)
        return page.svg()


def joint_posterior(posterior: FoundationPosterior | None, record: TurbineRecord) -> str:
    """Return the last posterior's draws ÷ nominal: pairs, and marginals on the diagonal."""
    if posterior is None or len(posterior.draws) < 2:
        return ""
    nominal = np.array([posterior.parameter(name).nominal for name in PARAMETER_NAMES])
    draws = posterior.draws[:, : len(nominal)] / nominal
    truth = record.state.truth
    true = None if truth is None else np.array([truth.k11, truth.k22, truth.k12]) / nominal
    with page_figure(4.6) as page:
        grid = page.figure.subplots(3, 3, sharex="col")
        for row in range(3):
            for column in range(3):
                _corner_panel(grid[row, column], draws, true, row, column)
        return page.svg()


def _corner_panel(
    axes: Any, draws: FloatArray, true: FloatArray | None, row: int, column: int
) -> None:
    if column > row:
        axes.remove()
        return
    if row == column:
        axes.hist(
            draws[:, row], bins=30, histtype="stepfilled", alpha=0.6, color=_POSTERIOR, linewidth=0
        )
        axes.set_yticks([])
    else:
        axes.plot(
            draws[:, column], draws[:, row], ".", markersize=2, alpha=0.5, color=_POSTERIOR,
            markeredgewidth=0, rasterized=True,
        )  # fmt: skip
        axes.locator_params(axis="y", nbins=4)
    axes.locator_params(axis="x", nbins=3)
    if true is not None:
        axes.axvline(true[column], color=_TRUTH, linewidth=1)
        if row != column:
            axes.axhline(true[row], color=_TRUTH, linewidth=1)
    if row == 2:
        axes.set_xlabel(f"{PARAMETER_NAMES[column]} ÷ nominal")
    if column == 0 and row > 0:
        axes.set_ylabel(f"{PARAMETER_NAMES[row]} ÷ nominal")
    elif column != row:
        axes.tick_params(labelleft=False)


def most_informative_frequencies(record: TurbineRecord) -> str:
    """Return the frequencies of the modes with most information on the stiffness.

    One panel per mode: frequency and 90 % interval in every window, and the frequency of the model
    at the last posterior.
    """
    chosen = most_informative(frequency_tracks(record), TRACKS)
    if not chosen or len(record.state.estimates) < FEWEST_FOR_TIME:
        return ""
    rows = (len(chosen) + 1) // 2
    with page_figure(0.4 + 1.25 * rows) as page:
        panels = page.figure.subplots(rows, 2, sharex=True, squeeze=False)
        for axes, track in zip(panels.flat, chosen, strict=False):
            _track_panel(axes, track)
            mark_events(axes, record.state.events, named=False)
        for axes in panels.flat[len(chosen) :]:
            axes.remove()
        for axes in panels.flat[max(0, len(chosen) - 2) : len(chosen)]:
            axes.tick_params(labelbottom=True)
            time_axis(axes, record.span_ns, label=False)
        return page.svg()


def _track_panel(axes: Any, track: FrequencyTrack) -> None:
    half = HALF_INTERVAL * track.stds
    bands = np.column_stack([track.frequencies, track.frequencies - half, track.frequencies + half])
    draw_band(axes, datetimes(track.times_ns), bands, colours.MEASURED)
    if np.isfinite(track.model_frequency):
        axes.axhline(
            track.model_frequency, color=css_colour(colours.MODEL), linestyle="--", linewidth=1
        )
    axes.set_title(f"{track.label} [Hz]")
    axes.locator_params(axis="y", nbins=3)
    axes.ticklabel_format(axis="y", useOffset=False)


def all_frequencies(record: TurbineRecord) -> str:
    """Draw the frequencies of all identified modes over time."""
    tracks = frequency_tracks(record)
    if not tracks or len(record.state.estimates) < FEWEST_FOR_TIME:
        return ""
    times = datetimes(np.concatenate([track.times_ns for track in tracks]))
    frequencies = np.concatenate([track.frequencies for track in tracks])
    with page_figure(3.4) as page:
        axes = page.figure.subplots()
        axes.plot(
            times, frequencies, "_", markersize=4, color=css_colour(colours.MEASURED),
            rasterized=len(times) > VECTOR_POINTS,
        )  # fmt: skip
        frequency_axis(axes, "y", "natural frequency [Hz]")
        mark_events(axes, record.state.events, named=False)
        time_axis(axes, record.span_ns)
        return page.svg()


def mode_shapes(record: TurbineRecord) -> str:
    """Draw the identified mode shapes over the height of their sensors, one panel per mode."""
    layout = record.layout
    modes = [
        mode
        for mode in record.state.modes
        if layout is not None and set(mode.channels) <= set(layout.channel_names)
    ][:SHAPES]
    if layout is None or not modes:
        return ""
    columns = min(4, len(modes))
    rows = -(-len(modes) // columns)
    with page_figure(0.5 + 1.7 * rows) as page:
        panels = page.figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
        for axes, mode in zip(panels.flat, modes, strict=False):
            _shape_panel(axes, deflection(layout, mode.channels, np.array(mode.shape)))
            label = mode.name if mode.pair is None else f"mode {mode.name}"
            axes.set_title(f"{label}\n{in_hertz(mode.frequency)} Hz")
        for axes in panels.flat[len(modes) :]:
            axes.remove()
        for axes in panels[:, 0]:
            axes.set_ylabel("height [m]" if heights_known(layout) else "place in the file")
        return page.svg()


def heights_known(layout: SensorLayout) -> bool:
    """Return whether heights are more than the channels' places 1, 2, …, as `new` writes them."""
    places = np.arange(1, len(layout.channels) + 1)
    return len(places) < 2 or not np.array_equal(layout.elevations, places)


def _shape_panel(axes: Any, shape: Deflection) -> None:
    """Draw the components along x, y and z with the largest one's maximum at 1."""
    largest = max(float(np.abs(shape.displacements).max()), 1e-12)
    styles = (
        ("-", "o", colours.MEASURED), ("--", "s", colours.POSTERIOR), (":", "^", colours.MODEL)
    )  # fmt: skip
    for axis, (line, marker, colour) in enumerate(styles):
        if not np.any(shape.displacements[:, axis]):
            continue  # no channel measures this direction
        axes.plot(
            shape.displacements[:, axis] / largest, shape.elevations, linestyle=line,
            marker=marker, markersize=3, color=css_colour(colour),
        )  # fmt: skip
    axes.axvline(0.0, color=INK, linewidth=0.5)
    axes.set_xlim(-1.15, 1.15)
    axes.set_xticks([-1, 0, 1])


def windows_over_time(record: TurbineRecord) -> str:
    """Draw identified and rejected windows and gaps over time."""
    summary = record.state
    rows: tuple[tuple[str, Sequence[_Spanned], colours.Colour], ...] = (
        ("identified", summary.estimates, colours.MEASURED),
        ("rejected", summary.rejected, colours.FAULT),
        ("gaps", summary.gaps, colours.NEUTRAL),
    )
    start, end = datetimes(record.span_ns)
    visible = (end - start) // 300  # shortest bar that is drawn
    with page_figure(1.5) as page:
        axes = page.figure.subplots()
        many = sum(len(spans) for _, spans, _ in rows) > VECTOR_POINTS
        for place, (_, spans, colour) in enumerate(rows):
            starts = datetimes([s.start_ns for s in spans])
            ends = np.maximum(datetimes([s.end_ns for s in spans]), starts + visible)
            axes.hlines(
                [-place] * len(spans), starts, ends, color=css_colour(colour), linewidth=9,
                alpha=0.75, rasterized=many,
            )  # fmt: skip
        axes.set_yticks([0, -1, -2], [name for name, _, _ in rows])
        axes.set_ylim(-2.6, 0.6)
        axes.grid(False, axis="y")
        time_axis(axes, record.span_ns)
        return page.svg()


def _mark_untrusted(axes: Any, times: Times, bands: FloatArray, trusted: Sequence[bool]) -> None:
    untrusted = ~np.array(trusted)
    if untrusted.any():
        axes.plot(
            times[untrusted], bands[untrusted, 0], "x", markersize=4,
            color=css_colour(colours.FAULT), label="not trusted",
        )  # fmt: skip


def _mark_truth(axes: Any, record: TurbineRecord, name: str, times: Times) -> None:
    """Draw a step at every change of the truth."""
    if not record.state.truths:
        return
    truths = sorted(record.state.truths.values(), key=lambda truth: truth.time_ns)
    posterior = record.state.posterior
    nominal = posterior.parameter(name).nominal if posterior else float("nan")
    starts = datetimes([max(truth.time_ns, int(times[0].astype(np.int64))) for truth in truths])
    values = [getattr(truth, name) / nominal for truth in truths]
    end = max(times[-1], starts[-1])
    axes.step(
        np.append(starts, end), [*values, values[-1]], where="post", color=_TRUTH, label="truth"
    )


_POSTERIOR = css_colour(colours.POSTERIOR)
_TRUTH = css_colour(colours.TRUTH)
