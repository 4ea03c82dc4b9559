"""The tab "Signals": what the sensors measure, and its spectra."""

import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.drawing.entities import signal_path
from pipeline.viewer.pictures.spectrum import measured_sides
from pipeline.viewer.tabs.narrow import alone, in_tabs
from pipeline.viewer.view_parameters import ViewParameters, plane, time_series
from sensors.acquisition.layout import SensorLayout


def signals(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    """Return the tab for a wide screen."""
    views = [
        accelerations_view(root, layout, side)
        for layout in parameters.layouts
        for side in measured_sides(layout)
    ]
    return rrb.Horizontal(
        rrb.Vertical(*views), spectrum_view(root), column_shares=[1, 1], name="Signals"
    )


def narrow_signals(root: str, parameters: ViewParameters) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    series = [
        accelerations_view(root, layout, side)
        for layout in parameters.layouts
        for side in measured_sides(layout)
    ]
    return in_tabs(
        "Signals",
        rrb.Vertical(*series, name="Series"),
        alone(
            "Spectra",
            spectrum_view(root),
            "Last window, colours as in Series; upright lines: modes",
        ),
    )


def accelerations_view(root: str, layout: SensorLayout, side: int) -> rrb.TimeSeriesView:
    """Return the accelerations of one unit along one axis."""
    path = signal_path(root, layout.unit)
    name = ("fore-aft (x)", "side-side (y)")[side]
    along = [abs(channel.direction[side]) > 0.7 for channel in layout.channels]
    quantity, unit = _quantity(layout)
    title = f"{quantity} {name} of unit {layout.unit} [{unit}]"
    shown = {path: rr.SeriesLines(visible_series=along)}
    return time_series(path, title, "LeftTop", overrides=shown)


def _quantity(layout: SensorLayout) -> tuple[str, str]:
    """Return the quantity and unit of a layout's channels."""
    units = {channel.unit for channel in layout.channels}
    if units == {"m/s²"}:
        return "Acceleration", "m/s²"
    return "Signal", ", ".join(sorted(units - {""})) or "unscaled"


def spectrum_view(root: str) -> rrb.Spatial2DView:
    """Return the spectra of the last window."""
    return plane(
        f"{root}/spectrum",
        "Spectra of the last window, colours as on the left; lines: identified frequencies [Hz]",
        [-0.3, 2.75],
        [-0.2, 2.7],
    )
