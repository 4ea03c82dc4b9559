"""Entity paths in Rerun, the timeline, and styles that several views share.

Everything of a turbine is below /{turbine}:

    tower/…                           the turbine at rest, sea, mudline, sensors
    signals/{unit}/acceleration       n scalars a row, one per channel [m/s²], 20 Hz
    signals/{unit}/acceleration {id}  the same of a later layout with other channels
    frequencies/identified/{mode}     of each window [Hz]
    modes/{label}/identified          median, ±2 standard deviations [Hz]
    modes/{label}/model               frequency of the updated model [Hz]
    frequencies/change/{mode}         against the first window [%]
    modes/{label}/damping             [% of critical]
    shapes/{label}/motion/…           the identified shape on the model's, moving
    foundation/{parameter}/posterior  5 %, 50 %, 95 %, stiffness ÷ nominal [-]; /truth
    foundation/joint/…, /pile/…       corner plot of the stiffnesses; the tower on its springs
    posterior_width/{parameter}       posterior width ÷ prior width, 90 % intervals [%]
    change/probability                of a change of the modes since the last event [-]
    change/noticed, /size/{k}         of every detected change [-], [%]
    spectrum/…, stabilisation/…, mac/…
                                      pictures of the last window: spectra, poles, MAC matrix
    health/lost, health/behind        blocks lost [-], seconds behind, a series a node; /text
    indicators, status, events        the state: as coloured points, as text, line by line

For several turbines /all-turbines holds the overview:

    indicators/…, table, events       of every turbine; events are warnings only
    {parameter}/{turbine}             median, stiffness ÷ nominal [-]

Everything is on one timeline, `time`: the sensor clock, UTC.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.colours import Colour
from pipeline.viewer.pictures.corner import Text
from pipeline.viewer.pictures.status_text import StatusIndicator
from sensors.acquisition.layout import Accelerometer, SensorLayout

TIMELINE = "time"
FARM = "/all-turbines"


def turbine_path(turbine: str) -> str:
    """Entity below which everything of one turbine lies."""
    return f"/{entity_part(turbine)}"


def entity_part(name: str) -> str:
    """Return one part of an entity path, whatever characters a name has."""
    return rr.escape_entity_path_part(name)


def signal_path(root: str, unit: str, layout_id: str = "") -> str:
    """Entity of a unit's accelerations; of a later layout's if that is named."""
    return f"{root}/signals/{entity_part(unit)}/{entity_part(f'acceleration {layout_id}'.strip())}"


def signal_paths(root: str, layouts: Sequence[SensorLayout]) -> dict[str, str]:
    """Return the entity of each layout's accelerations, by the layout's name.

    Why: an entity has one set of names and colours, for all of its rows. Layouts of one unit with
    the same channels share one.

    Parameters
    ----------
    layouts : Sequence[SensorLayout]
        In the order of arrival.
    """
    paths: dict[tuple[str, tuple[Accelerometer, ...]], str] = {}
    units: set[str] = set()
    for layout in layouts:
        later = layout.layout_id if layout.unit in units else ""
        units.add(layout.unit)
        paths.setdefault((layout.unit, layout.channels), signal_path(root, layout.unit, later))
    return {layout.layout_id: paths[layout.unit, layout.channels] for layout in layouts}


def mode_path(root: str, label: str) -> str:
    """Entity below which the tracks of one model mode lie."""
    return f"{root}/modes/{entity_part(label)}"


def shape_path(root: str, label: str) -> str:
    """Entity below which one mode's shape hangs."""
    return f"{root}/shapes/{entity_part(label)}"


def parameter_path(root: str, name: str) -> str:
    """Entity below which one parameter's bands and truth lie."""
    return f"{root}/foundation/{entity_part(name)}"


def width_path(root: str, name: str) -> str:
    """Return the entity of one parameter's posterior width over its prior width."""
    return f"{root}/posterior_width/{entity_part(name)}"


def median_path(name: str, turbine: str) -> str:
    """Entity of one turbine's median among all turbines'."""
    return f"{FARM}/{entity_part(name)}/{entity_part(turbine)}"


def at(recording: rr.RecordingStream, time_ns: int) -> None:
    """Set the sensor time of what is logged next."""
    recording.set_time(TIMELINE, timestamp=np.datetime64(time_ns, "ns"))


def time_column(times_ns: NDArray[np.int64]) -> rr.TimeColumn:
    """Sensor times of a chunk's rows."""
    return rr.TimeColumn(TIMELINE, timestamp=times_ns.astype("datetime64[ns]"))


def log_band_style(
    recording: rr.RecordingStream, path: str, names: tuple[str, str, str], colour: Colour
) -> None:
    """Three series: thin lower and upper ends, a thick middle; points keep a lone one visible."""
    low, middle, high = names
    faint = tuple(int(0.72 * part) for part in colour)
    recording.log(
        path,
        rr.SeriesLines(
            names=[low, middle, high], colors=[faint, colour, faint], widths=[1.2, 2.5, 1.2]
        ),
        rr.SeriesPoints(
            names=[low, middle, high],
            colors=[faint, colour, faint],
            markers=["up", "circle", "down"],
            marker_sizes=[2.0, 3.0, 2.0],
        ),
        static=True,
    )


def log_line_style(
    recording: rr.RecordingStream,
    path: str,
    name: str,
    colour: Colour,
    *,
    width: float = 2.0,
) -> None:
    """One series, as a line with small points."""
    recording.log(
        path,
        rr.SeriesLines(names=[name], colors=[colour], widths=[width]),
        rr.SeriesPoints(
            names=[name], colors=[colour], markers=["diamond"], marker_sizes=[width + 1.0]
        ),
        static=True,
    )


def log_indicator_points(
    recording: rr.RecordingStream,
    path: str,
    places: Sequence[tuple[float, float]],
    indicators: Sequence[StatusIndicator],
) -> None:
    """Draw an indicator at each position; position and text repeat what the colour shows."""
    shades = {"good": colours.TRUTH, "warning": colours.MODEL, "bad": colours.FAULT}
    palette = [shades.get(indicator.state, colours.NEUTRAL) for indicator in indicators]
    recording.log(path, rr.Points2D(places, radii=0.3, colors=palette))


def strips(lines: Iterable[NDArray[np.float64]]) -> Any:
    """Lines as Rerun takes them fastest: one array where all have as many points."""
    small = [line.astype(np.float32) for line in lines]
    return np.stack(small) if len({len(line) for line in small}) == 1 else small


def text_labels(texts: Sequence[Text]) -> rr.Points2D:
    """Return the texts of a plane picture, each centred on its position."""
    return rr.Points2D(
        [text.position for text in texts],
        radii=rr.Radius.ui_points(0.1),
        colors=colours.LABEL,
        labels=[text.text for text in texts],
        show_labels=True,
    )
