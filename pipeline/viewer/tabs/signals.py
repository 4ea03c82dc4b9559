"""The tab "Signals": what the sensors measure, and its spectra."""

from collections import Counter

import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.drawing.entities import signal_paths
from pipeline.viewer.pictures.spectrum import PITCH, channels_along, measured_sides
from pipeline.viewer.tabs.narrow import alone, in_tabs
from pipeline.viewer.view_parameters import ViewParameters, plane, time_series
from sensors.acquisition.layout import SensorLayout


def signals(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    """Return the tab for a wide screen."""
    return rrb.Horizontal(
        rrb.Vertical(*_accelerations(root, parameters)),
        spectrum_view(root, parameters),
        column_shares=[1, 1],
        name="Signals",
    )


def narrow_signals(root: str, parameters: ViewParameters) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    return in_tabs(
        "Signals",
        rrb.Vertical(*_accelerations(root, parameters), name="Series"),
        alone(
            "Spectra",
            spectrum_view(root, parameters),
            "Last window, colours as in Series; upright lines: modes",
        ),
    )


def _accelerations(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    """Return the accelerations of each unit along each axis; of a unit that came back with other
    channels, those of each of its layouts."""
    paths = signal_paths(root, parameters.layouts)
    layouts = {paths[layout.layout_id]: layout for layout in parameters.layouts}
    units = Counter(layout.unit for layout in layouts.values())
    return [
        accelerations_view(
            path, layout, side, of=f", {layout.layout_id}" * (units[layout.unit] > 1)
        )
        for path, layout in layouts.items()
        for side in measured_sides(layout)
    ]


def accelerations_view(
    path: str, layout: SensorLayout, side: int, *, of: str = ""
) -> rrb.TimeSeriesView:
    """Return the accelerations of one layout along one axis; `of` says which of its unit's."""
    name = ("fore-aft (x)", "side-side (y)", "vertical (z)")[side]
    along = [channel in channels_along(layout, side) for channel in range(len(layout.channels))]
    quantity, unit = _quantity(layout)
    title = f"{quantity} {name} of unit {layout.unit}{of} [{unit}]"
    shown = {path: rr.SeriesLines(visible_series=along)}
    return time_series(path, title, "LeftTop", overrides=shown)


def _quantity(layout: SensorLayout) -> tuple[str, str]:
    """Return the quantity and unit of a layout's channels."""
    units = {channel.unit for channel in layout.channels}
    if units == {"m/s²"}:
        return "Acceleration", "m/s²"
    return "Signal", ", ".join(sorted(units - {""})) or "unscaled"


def spectrum_view(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    """Return the spectra of the last window."""
    sides = {side for layout in parameters.layouts for side in measured_sides(layout)}
    return plane(
        f"{root}/spectrum",
        "Spectra of the last window, colours as on the left; lines: identified frequencies [Hz]",
        [-0.3, 2.75],
        [-0.2, 2.7 + PITCH * (len(sides) > 2)],
    )
