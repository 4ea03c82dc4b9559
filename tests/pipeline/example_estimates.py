"""Estimates of eight channels of which only what a test asks about matters."""

from collections.abc import Iterable

import numpy as np

from pipeline.messages import ModalEstimate, Mode
from sensors.acquisition.blocks import NANOSECONDS
from tests.pipeline.example_messages import LAYOUT, START_NS

WINDOW = 600  # [s]


def mode(frequency: float, shape: Iterable[float]) -> Mode:
    factor = np.zeros((10, 3))
    factor[0, 0] = 1e-3
    factor[2:, 1] = 1e-3
    values = np.array(list(shape), dtype=float)
    unit = int(np.argmax(np.abs(values)))
    factor[2 + unit] = 0.0
    return Mode("m", frequency, 1e-3, 0.01, 1e-3, values / values[unit], factor, 3)


def estimate(*modes: Mode, number: int = 0, turbine: str = "t1") -> ModalEstimate:
    start_ns = START_NS + number * WINDOW * NANOSECONDS
    return ModalEstimate(
        turbine,
        number,
        start_ns,
        start_ns + WINDOW * NANOSECONDS,
        LAYOUT.layout_id,
        LAYOUT.channel_names,
        modes,
    )
