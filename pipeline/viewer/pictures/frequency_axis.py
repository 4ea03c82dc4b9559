"""The logarithmic frequency axis that spectra and stabilisation diagrams share. No rerun here."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.viewer.pictures.corner import Text
from sensors.arrays import FloatArray

PANEL_WIDTH = 2.6  # of a panel [picture units]
LOWEST = 0.1  # left end [Hz]
LABEL_DISTANCE = 0.2  # between two frequencies written above a panel [picture units]


@dataclass(frozen=True, slots=True)
class FrequencyAxis:
    """A logarithmic axis from `low` at 0 to `high` at WIDTH."""

    low: float
    """Left end [Hz]."""
    high: float
    """Right end [Hz]."""

    def position(self, frequency: FloatArray | float) -> FloatArray:
        """Return the position of a frequency [Hz] on the axis [picture units]."""
        share = np.log(np.asarray(frequency) / self.low) / np.log(self.high / self.low)
        return PANEL_WIDTH * share

    @property
    def ticks(self) -> list[float]:
        """1, 2 and 5 times powers of ten within the axis [Hz]."""
        round_numbers = [digit * 10.0**power for power in range(-2, 4) for digit in (1, 2, 5)]
        return [number for number in round_numbers if self.low <= number <= self.high]

    def tick_texts(self, y: float) -> list[Text]:
        """Return the numbers at the ticks, at height y."""
        return [Text((float(self.position(tick)), y), f"{tick:g}") for tick in self.ticks]

    def shown(self, frequencies: Sequence[float]) -> list[float]:
        """Return the frequencies within the axis, lowest first."""
        return sorted(f for f in frequencies if self.low <= f <= self.high)

    def mode_texts(self, frequencies: Sequence[float], y: float) -> tuple[Text, ...]:
        """Return frequencies at height y, leaving out those without room."""
        texts: list[Text] = []
        for frequency in self.shown(frequencies):
            x = float(self.position(frequency))
            if not texts or x - texts[-1].position[0] >= LABEL_DISTANCE:
                texts.append(Text((x, y), f"{frequency:.3g}"))
        return tuple(texts)


def frame(top: float, bottom: float) -> FloatArray:
    """Return the outline of a panel over the whole axis, shape (5, 2)."""
    return np.array(
        [[0, top], [PANEL_WIDTH, top], [PANEL_WIDTH, bottom], [0, bottom], [0, top]], dtype=float
    )


def vertical_line(axis: FrequencyAxis, frequency: float, top: float, bottom: float) -> FloatArray:
    """Return an upright line at a frequency [Hz], shape (2, 2)."""
    x = float(axis.position(frequency))
    return np.array([[x, top], [x, bottom]])
