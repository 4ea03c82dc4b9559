"""Pictures in the plane: spectra and poles of a window, the MAC matrix, the lamps of one turbine
and of all."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from pipeline.viewer.drawing.entities import FARM, log_lights, strips, words
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.corner import Text
from pipeline.viewer.pictures.farm_overview import StatusIndicators
from pipeline.viewer.pictures.mac_matrix import MacMatrix
from pipeline.viewer.pictures.spectrum import SpectrumPicture
from pipeline.viewer.pictures.stabilisation import StabilisationPicture
from pipeline.viewer.pictures.status_text import StatusIndicator
from sensors.arrays import FloatArray


def log_spectrum(recording: rr.RecordingStream, root: str, picture: SpectrumPicture) -> None:
    """Spectra in the colours of their levels, identified frequencies as hairs."""
    path = f"{root}/spectrum"
    hair, stroke = 0.4, 0.7  # [points on the screen]
    palette = [colours.LEVELS[level % len(colours.LEVELS)] for level in picture.levels]
    recording.log(f"{path}/modes", _lines(picture.modes, hair, colours.QUIET))
    recording.log(f"{path}/frames", _lines(picture.frames, hair, colours.QUIET))
    recording.log(
        f"{path}/channels",
        rr.LineStrips2D(
            strips(picture.spectra),
            radii=rr.Radius.ui_points(stroke),
            colors=palette,
        ),
    )
    recording.log(f"{path}/text", words(picture.texts))


def log_stabilisation(
    recording: rr.RecordingStream, root: str, picture: StabilisationPicture
) -> None:
    """Poles in the colours of their bands, the modes taken among them as hairs."""
    path = f"{root}/stabilisation"
    palette = [colours.LEVELS[band % len(colours.LEVELS)] for band in picture.bands]
    recording.log(f"{path}/modes", _lines(picture.modes, 0.4, colours.QUIET))
    recording.log(f"{path}/frames", _lines(picture.frames, 0.4, colours.QUIET))
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
    recording.log(f"{path}/text", words(picture.texts))


def log_mac_matrix(recording: rr.RecordingStream, root: str, matrix: MacMatrix) -> None:
    """A square a pair, dark for 0, bright for 1."""
    recording.log(f"{root}/mac/values", rr.Image(matrix.image, draw_order=-1.0))
    recording.log(f"{root}/mac/text", words(matrix.texts))


def log_lamps(recording: rr.RecordingStream, root: str, lamps: Sequence[StatusIndicator]) -> None:
    """A lamp above the other, its words beside it."""
    rows = [float(row) for row in range(len(lamps))]
    log_lights(recording, f"{root}/lamps/lights", [(0.0, row) for row in rows], lamps)
    texts = [Text((4.0, row - 0.3), lamp.text) for row, lamp in zip(rows, lamps, strict=True)]
    recording.log(f"{root}/lamps/text", words(texts))


def log_farm(recording: rr.RecordingStream, board: StatusIndicators, markdown: str) -> None:
    """The lamps of all turbines, and their table."""
    log_lights(recording, f"{FARM}/lamps/lights", board.lights, board.lamps)
    recording.log(f"{FARM}/lamps/text", words(board.texts))
    recording.log(f"{FARM}/table", rr.TextDocument(markdown, media_type="text/markdown"))


def _lines(lines: Sequence[FloatArray], radius: float, colour: colours.Colour) -> rr.LineStrips2D:
    return rr.LineStrips2D(strips(lines), radii=rr.Radius.ui_points(radius), colors=colour)
