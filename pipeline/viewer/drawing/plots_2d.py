"""Draw plane pictures: spectra and poles of a window, MAC matrix, status indicators."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from pipeline.viewer.drawing.entities import FARM, log_indicator_points, strips, text_labels
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.corner import Text
from pipeline.viewer.pictures.farm_overview import StatusIndicators
from pipeline.viewer.pictures.mac_matrix import MacMatrix
from pipeline.viewer.pictures.spectrum import SpectrumPicture
from pipeline.viewer.pictures.stabilisation import StabilisationPicture
from pipeline.viewer.pictures.status_text import StatusIndicator
from sensors.arrays import FloatArray


def log_spectrum(recording: rr.RecordingStream, root: str, picture: SpectrumPicture) -> None:
    """Draw spectra in the colours of their levels, identified frequencies as lines."""
    path = f"{root}/spectrum"
    thin, thick = 0.4, 0.7  # [screen points]
    palette = [colours.LEVELS[level % len(colours.LEVELS)] for level in picture.levels]
    recording.log(f"{path}/modes", _lines(picture.modes, thin, colours.NEUTRAL))
    recording.log(f"{path}/frames", _lines(picture.frames, thin, colours.NEUTRAL))
    recording.log(
        f"{path}/channels",
        rr.LineStrips2D(
            strips(picture.spectra),
            radii=rr.Radius.ui_points(thick),
            colors=palette,
        ),
    )
    recording.log(f"{path}/text", text_labels(picture.texts))


def log_stabilisation(
    recording: rr.RecordingStream, root: str, picture: StabilisationPicture
) -> None:
    """Draw poles in the colours of their bands, identified modes as lines."""
    path = f"{root}/stabilisation"
    palette = [colours.LEVELS[band % len(colours.LEVELS)] for band in picture.bands]
    recording.log(f"{path}/modes", _lines(picture.modes, 0.4, colours.NEUTRAL))
    recording.log(f"{path}/frames", _lines(picture.frames, 0.4, colours.NEUTRAL))
    recording.log(
        f"{path}/stds",
        rr.LineStrips2D(strips(picture.stds), radii=rr.Radius.ui_points(0.5), colors=palette),
    )
    recording.log(
        f"{path}/poles",
        rr.Points2D(
            picture.poles.astype(np.float32), radii=rr.Radius.ui_points(2.0), colors=palette
        ),
    )
    recording.log(f"{path}/text", text_labels(picture.texts))


def log_mac_matrix(recording: rr.RecordingStream, root: str, matrix: MacMatrix) -> None:
    """Draw a square for each pair, dark for 0, bright for 1."""
    recording.log(f"{root}/mac/values", rr.Image(matrix.image, draw_order=-1.0))
    recording.log(f"{root}/mac/text", text_labels(matrix.texts))


def log_indicators(
    recording: rr.RecordingStream, root: str, indicators: Sequence[StatusIndicator]
) -> None:
    """Draw indicators below each other, their texts beside them."""
    rows = [float(row) for row in range(len(indicators))]
    log_indicator_points(
        recording, f"{root}/indicators/points", [(0.0, row) for row in rows], indicators
    )
    texts = [
        Text((4.0, row - 0.3), indicator.text)
        for row, indicator in zip(rows, indicators, strict=True)
    ]
    recording.log(f"{root}/indicators/text", text_labels(texts))


def log_farm(recording: rr.RecordingStream, board: StatusIndicators, markdown: str) -> None:
    """Draw the indicators of all turbines and their table."""
    log_indicator_points(recording, f"{FARM}/indicators/points", board.positions, board.indicators)
    recording.log(f"{FARM}/indicators/text", text_labels(board.texts))
    recording.log(f"{FARM}/table", rr.TextDocument(markdown, media_type="text/markdown"))


def _lines(lines: Sequence[FloatArray], radius: float, colour: colours.Colour) -> rr.LineStrips2D:
    return rr.LineStrips2D(strips(lines), radii=rr.Radius.ui_points(radius), colors=colour)
