"""ChannelTable: what any file of measurements gives, whatever its format."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.errors import InputError

STANDARD_GRAVITY = 9.80665  # [m/s²], by definition (CGPM 1901)

ACCELERATION_UNITS = {
    "m/s2": 1.0,
    "m/s^2": 1.0,
    "m/s²": 1.0,
    "m/s**2": 1.0,
    "mm/s2": 1e-3,
    "mm/s^2": 1e-3,
    "mm/s²": 1e-3,
    "cm/s2": 1e-2,
    "cm/s^2": 1e-2,
    "cm/s²": 1e-2,
    "gal": 1e-2,
    "g": STANDARD_GRAVITY,
    "mg": 1e-3 * STANDARD_GRAVITY,
}  # [m/s² per unit]


class FileError(InputError):
    """A file of measurements that cannot be read; the message names file, row and column."""


@dataclass(frozen=True, slots=True, eq=False)
class ChannelTable:
    """Samples of all channels of one file, with their time stamps where it has any."""

    names: tuple[str, ...]
    units: tuple[str, ...]  # "m/s²" after conversion; "" = unscaled; else as the file says
    samples: NDArray[np.float64]  # (n_samples, n_channels), NaN where the file has nothing
    times: NDArray[np.float64] | None  # (n_samples,) seconds since the first sample, or None
    start_ns: int = 0  # first sample [ns since 1970-01-01 UTC]; 0 where the file does not say

    @property
    def sampling_rate(self) -> float | None:
        """From the time stamps [Hz]; None without them.

        The mean step, not the median: stamps rounded to the millisecond have a median that is
        wrong by up to half a millisecond. Steps over a gap do not count.
        """
        if self.times is None or len(self.times) < 2:
            return None
        steps = np.diff(self.times)
        typical = max(float(np.median(steps)), float(np.mean(steps)) / 2)
        step = float(np.mean(steps[steps <= 3 * typical]))
        return 1.0 / step if step > 0 else None


def in_standard_unit(unit: str) -> tuple[str, float]:
    """Unit after conversion, and the factor to it: accelerations become m/s², the rest stays."""
    factor = ACCELERATION_UNITS.get(unit.strip().lower())
    return ("m/s²", factor) if factor is not None else (unit.strip(), 1.0)
