"""ChannelTable: what any file of measurements gives, whatever its format."""

import re
from dataclasses import dataclass
from typing import Literal

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


VELOCITY_UNITS = {"m/s": 1.0, "cm/s": 1e-2, "mm/s": 1e-3, "um/s": 1e-6, "µm/s": 1e-6}  # [m/s]
DISPLACEMENT_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "µm": 1e-6}  # [m]
# Strain and tilt follow the displacement, if on a scale of their own.
LIKE_DISPLACEMENT = ("strain", "m/m", "um/m", "µm/m", "ue", "µε", "rad", "mrad", "deg", "°")

Quantity = Literal["acceleration", "velocity", "displacement"]

_WORDS: dict[Quantity, tuple[str, ...]] = {
    "acceleration": ("a", "acc", "accel", "acceleration", "accelerometer"),
    "velocity": ("v", "vel", "velocity", "geophone"),
    "displacement": ("d", "disp", "displ", "displacement", "strain", "tilt"),
}


class FileError(InputError):
    """A file of measurements that cannot be read; the message names file, row and column."""


@dataclass(frozen=True, slots=True, eq=False)
class ChannelTable:
    """Samples of all channels of one file, with their time stamps where it has any."""

    names: tuple[str, ...]
    units: tuple[str, ...]  # "m/s²", "m/s", "m" after conversion; "" = unscaled; else as given
    samples: NDArray[np.float64]  # (n_samples, n_channels), NaN where the file has nothing
    times: NDArray[np.float64] | None  # (n_samples,) seconds since the first sample, or None
    start_ns: int = 0  # first sample [ns since 1970-01-01 UTC]; 0 where the file does not say

    @property
    def quantities(self) -> tuple[Quantity, ...] | None:
        """What each channel measures; None where neither unit nor name tells."""
        titles = zip(self.units, self.names, strict=True)
        known = [quantity_of(unit) or quantity_named(name) for unit, name in titles]
        told = tuple(quantity for quantity in known if quantity is not None)
        return told if len(told) == len(known) else None

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
    """Unit after conversion, and the factor to it: accelerations become m/s², velocities m/s,
    displacements m; the rest stays."""
    given = unit.strip()
    for standard, factors in (
        ("m/s²", ACCELERATION_UNITS),
        ("m/s", VELOCITY_UNITS),
        ("m", DISPLACEMENT_UNITS),
    ):
        if given.lower() in factors:
            return standard, factors[given.lower()]
    return given, 1.0


def quantity_of(unit: str) -> Quantity | None:
    """What is measured in a unit (after conversion); None where it does not tell."""
    if unit.lower() in LIKE_DISPLACEMENT:
        return "displacement"
    known: dict[str, Quantity] = {"m/s²": "acceleration", "m/s": "velocity", "m": "displacement"}
    return known.get(unit)


def quantity_named(name: str) -> Quantity | None:
    """What a channel's name says that it measures: "acc_z145", "Velocity 3", "disp-x"."""
    for word in re.split(r"[^a-z]+", name.lower()):
        for quantity, words in _WORDS.items():
            if word in words:
                return quantity
    return None
