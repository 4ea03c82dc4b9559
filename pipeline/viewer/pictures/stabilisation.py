"""The stabilisation diagram of a window as a picture: poles over frequency and model order.

A column of dots is a mode: its pole comes back at the same frequency in every order. Picture units,
y down. No rerun here.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import StabilisationDiagram
from pipeline.viewer.pictures.corner import Text
from pipeline.viewer.pictures.spectrum import (
    LOWEST,
    PANEL_WIDTH,
    FrequencyAxis,
    frame,
    vertical_line,
)
from sensors.arrays import FloatArray

HEIGHT = 1.3  # of the panel [picture units]
HEADROOM = 1.2  # of the axes beyond the highest pole [-]
ORDER_TICK = 20  # between two model orders written at the axis [-]


@dataclass(frozen=True, slots=True, eq=False)
class StabilisationPicture:
    """Everything to draw, in picture units."""

    poles: FloatArray
    """Positions of the poles, shape (n_poles, 2) [picture units]."""
    bands: NDArray[np.int64]
    """Band of each pole, shape (n_poles,); slowest 0."""
    stds: FloatArray
    """(n_poles, 2, 2) a bar of ± one standard deviation through each pole."""
    modes: tuple[FloatArray, ...]
    """(2, 2) an upright line at each identified mode."""
    frames: tuple[FloatArray, ...]
    """Outline of the panel."""
    texts: tuple[Text, ...]


def stabilisation_picture(
    diagram: StabilisationDiagram, frequencies: Sequence[float]
) -> StabilisationPicture:
    """Draw all poles of a window and the modes identified among them.

    Parameters
    ----------
    frequencies : Sequence[float]
        Natural frequencies of the identified modes [Hz].
    """
    f = diagram.frequencies.astype(float)
    inside = f > LOWEST
    axis = FrequencyAxis(LOWEST, HEADROOM * max([2 * LOWEST, *f[inside]]))
    top_order = max([1.0, *diagram.orders]) * HEADROOM
    y = HEIGHT * (1 - diagram.orders[inside].astype(float) / top_order)
    f, std = f[inside], diagram.frequency_stds[inside].astype(float)
    ends = axis.position(np.stack([np.maximum(f - std, axis.low), f + std], axis=1))
    shown = axis.shown(frequencies)
    return StabilisationPicture(
        poles=np.stack([axis.position(f), y], axis=1),
        bands=diagram.bands[inside].astype(np.int64),
        stds=np.stack([ends, np.stack([y, y], axis=1)], axis=2),
        modes=tuple(vertical_line(axis, frequency, 0.0, HEIGHT) for frequency in shown),
        frames=(frame(0.0, HEIGHT),),
        texts=_texts(axis, top_order) + axis.mode_texts(shown, -0.06),
    )


def _texts(axis: FrequencyAxis, top_order: float) -> tuple[Text, ...]:
    orders = range(0, int(top_order) + 1, ORDER_TICK)
    levels = [Text((-0.17, HEIGHT * (1 - order / top_order)), f"{order}") for order in orders]
    names = [
        Text((PANEL_WIDTH / 2, HEIGHT + 0.22), "frequency [Hz]"),
        Text((-0.12, -0.06), "order [-]"),
    ]
    return (*axis.tick_texts(HEIGHT + 0.05), *levels, *names)
