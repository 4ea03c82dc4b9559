"""What the layout of a session is made from, kept with it, so that it can be laid out again.

A .rrd holds it as a property of the recording; a page that is served has it in a file. From it the
page's server makes the layout for a narrow screen when one asks.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import RrdReader

from pipeline.viewer.blueprint import session_blueprint
from pipeline.viewer.outputs.connection import APPLICATION
from pipeline.viewer.outputs.outputs import ConnectedViewer, ViewerOutput
from pipeline.viewer.view_parameters import ViewParameters
from sensors.acquisition.layout import Accelerometer, SensorLayout

PROPERTY = "views"  # of a recording


@dataclass(frozen=True, slots=True)
class SessionViews:
    """Arguments of `session_blueprint`."""

    parameters: tuple[ViewParameters, ...]
    playback_speed: float
    """Sensor seconds per second of playback [-]."""
    span_ns: tuple[int, int] | None = None
    """Start and end of a session that is over [ns since 1970]."""

    def blueprint(self, *, narrow: bool = False) -> rrb.Blueprint:
        """Return the layout for a wide or for a narrow screen."""
        return session_blueprint(
            self.parameters,
            playback_speed=self.playback_speed,
            span_ns=self.span_ns,
            narrow=narrow,
        )

    def to_json(self) -> str:
        """Return the views as a text that `from_json` reads."""
        return json.dumps(asdict(self), ensure_ascii=False)

    @classmethod
    def from_json(cls, text: str) -> "SessionViews":
        """Return the views of a text of `to_json`."""
        stored = json.loads(text)
        span = stored["span_ns"]
        return cls(
            tuple(_parameters(each) for each in stored["parameters"]),
            playback_speed=stored["playback_speed"],
            span_ns=None if span is None else tuple(span),
        )


def _parameters(stored: Mapping[str, Any]) -> ViewParameters:
    layouts = tuple(_layout(each) for each in stored["layouts"])
    return ViewParameters(**{**stored, "layouts": layouts, "modes": tuple(stored["modes"])})


def _layout(stored: Mapping[str, Any]) -> SensorLayout:
    channels = tuple(
        Accelerometer(**{**each, "direction": tuple(each["direction"])})
        for each in stored["channels"]
    )
    return SensorLayout(**{**stored, "channels": channels})


def send_views(recording: rr.RecordingStream, output: ViewerOutput, views: SessionViews) -> None:
    """Send the wide layout to an output, and keep what it is made from."""
    recording.send_blueprint(views.blueprint())
    if not isinstance(output, ConnectedViewer):
        recording.send_property(PROPERTY, rr.TextDocument(views.to_json()))
    elif output.views is not None:
        unfinished = output.views.with_suffix(".new")
        unfinished.write_text(views.to_json(), "utf-8")
        unfinished.replace(output.views)


def narrow_layout(place: Path) -> bytes:
    """Return the narrow layout of a session as a .rbl; b"" where it is not known.

    Parameters
    ----------
    place : Path
        A .rrd, or the file of `ConnectedViewer.views`, which may not be there yet.
    """
    if not place.exists():
        return b""
    text = stored_views(place) if place.suffix == ".rrd" else place.read_text("utf-8")
    if not text:
        return b""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "narrow.rbl"
        SessionViews.from_json(text).blueprint(narrow=True).save(APPLICATION, file)
        return file.read_bytes()


def stored_views(rrd: Path) -> str:
    """Return the last text of PROPERTY in a .rrd; "" in one of an older version."""
    properties = RrdReader(rrd).stream().filter(content=f"/__properties/{PROPERTY}")
    texts = [
        value
        for chunk in properties.to_chunks()
        for value in chunk.to_record_batch().column("TextDocument:text").to_pylist()
    ]
    return str(texts[-1][0]) if texts else ""
