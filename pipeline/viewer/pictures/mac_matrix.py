"""The modal assurance criterion of every identified mode with every model mode, as a picture.

One square per pair, the identified mode's row by the model mode's column. The picture is about SIDE
pixels wide, however many modes there are. No rerun here.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import FoundationPosterior, ModalEstimate
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.state.phrases import in_hertz
from pipeline.viewer.pictures.corner import Text
from sensors.arrays import FloatArray

ImageArray = NDArray[np.uint8]

# From 0 to 1, evenly spaced: a part of the cividis map, distinct for colour-blind readers too.
# Source: Nuñez, Anderton and Renslow, PLoS ONE 13(7), 2018.
SHADES = np.array(
    [(0, 32, 77), (59, 73, 108), (112, 113, 115), (166, 157, 117), (255, 234, 70)], dtype=float
)


SIDE = 400  # of the picture [pixels]
LABEL_PITCH = 22.0  # between two labels that do not cover each other [pixels]


@dataclass(frozen=True, slots=True, eq=False)
class MacMatrix:
    """Everything to draw, in pixels, y down."""

    values: FloatArray
    """MAC, shape (n_identified, n_model) [-]."""
    image: ImageArray
    """Red, green, blue, shape (height, width, 3); one square of pixels per value."""
    texts: tuple[Text, ...]
    """Frequencies at the rows, labels at the columns, as many as fit."""


def mac_matrix(estimate: ModalEstimate, posterior: FoundationPosterior) -> MacMatrix | None:
    """Return the MAC of the window's modes with the paired modes of the updated model.

    None where no mode is paired, or the posterior is of other channels.
    """
    names = {name for pair in posterior.pairs for name in pair.identified.split("+")}
    modes = [mode for mode in estimate.modes if mode.name in names]
    labels = [pair.model for pair in posterior.pairs]
    rows = [i for i, label in enumerate(posterior.model_labels) if label in labels]
    if not modes or not rows or posterior.model_shapes.shape[1] != len(estimate.channels):
        return None
    rows.sort(key=lambda row: float(posterior.model_frequencies[row]))
    values = modal_assurance_criterion(
        np.array([mode.shape for mode in modes]), posterior.model_shapes[rows]
    )
    square = max(1, SIDE // max(values.shape))
    height, width = (square * count for count in values.shape)
    apart = int(np.ceil(LABEL_PITCH / square))  # so many squares from one label to the next
    left = [
        Text((-18.0, square * (i + 0.5) - 8.0), in_hertz(modes[i].frequency))
        for i in range(0, len(modes), apart)
    ]
    below = [
        Text((square * (j + 0.5), height + 3.0), posterior.model_labels[rows[j]])
        for j in range(0, len(rows), apart)
    ]
    axes = [Text((width / 2, height + 20.0), "model mode"), Text((5.0, -26.0), "identified [Hz]")]
    image = np.repeat(np.repeat(shade_values(values), square, axis=0), square, axis=1)
    return MacMatrix(values, image, tuple(left + below + axes))


def shade_values(values: FloatArray) -> ImageArray:
    """Return the colours of values from 0 to 1, shape (…, 3)."""
    places = np.linspace(0.0, 1.0, len(SHADES))
    bands = [np.interp(values, places, SHADES[:, band]) for band in range(3)]
    return np.stack(bands, axis=-1).round().astype(np.uint8)
