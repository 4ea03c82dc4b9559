"""ChannelTable: what any file of measurements gives, whatever its format."""

import re
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, timedelta, timezone, tzinfo
from pathlib import Path
from typing import Literal
from zoneinfo import ZoneInfo

import numpy as np
from numpy.typing import NDArray

from sensors.constants import STANDARD_GRAVITY
from sensors.errors import InputError

MOST_STEPS_PASSED = 8.5  # by one step over missing rows
FEWEST_TOGETHER = 16  # steps through whose stamps the first line is laid
MOST_OF_SEVERAL = 0.25  # of the steps; more are of stamps with a digit of a sample or so [-]
ROUNDING = 1e-9  # relative uncertainty of a rate whose stamps are exact: rounding of doubles [-]

# Every unit as `plain_unit` writes it: lower case, no blanks, powers as digits, "u" for micro.
ACCELERATION_UNITS = {
    "m/s2": 1.0,
    "m/s/s": 1.0,
    "ms-2": 1.0,
    "mm/s2": 1e-3,
    "mm/s/s": 1e-3,
    "mms-2": 1e-3,
    "cm/s2": 1e-2,
    "um/s2": 1e-6,
    "nm/s2": 1e-9,
    "ft/s2": 0.3048,
    "in/s2": 0.0254,
    "gal": 1e-2,
    "mgal": 1e-5,
    "g": STANDARD_GRAVITY,
    "gn": STANDARD_GRAVITY,
    "g_n": STANDARD_GRAVITY,
    "mg": 1e-3 * STANDARD_GRAVITY,
    "ug": 1e-6 * STANDARD_GRAVITY,
    "g's": STANDARD_GRAVITY,
    "gs": STANDARD_GRAVITY,
    "g0": STANDARD_GRAVITY,
    "gee": STANDARD_GRAVITY,
}  # [m/s² per unit]
VELOCITY_UNITS = {
    "m/s": 1.0,
    "ms-1": 1.0,
    "cm/s": 1e-2,
    "mm/s": 1e-3,
    "um/s": 1e-6,
    "nm/s": 1e-9,
    "ft/s": 0.3048,
    "in/s": 0.0254,
}  # [m/s per unit]
DISPLACEMENT_UNITS = {
    "m": 1.0,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "nm": 1e-9,
    "ft": 0.3048,
    "in": 0.0254,
}  # [m per unit]
# Strain and tilt follow the displacement, if on a scale of their own.
LIKE_DISPLACEMENT = (
    "strain", "m/m", "mm/m", "um/m", "ue", "uε", "ustrain", "microstrain", "ε",
    "rad", "mrad", "urad", "deg", "°",
)  # fmt: skip

Quantity = Literal["acceleration", "velocity", "displacement"]
DateOrder = Literal["day-first", "month-first"]

_WORDS: dict[Quantity, tuple[str, ...]] = {
    "acceleration": ("a", "acc", "accel", "acceleration", "accelerometer"),
    "velocity": ("v", "vel", "velocity", "geophone"),
    "displacement": ("d", "disp", "displ", "displacement", "strain", "tilt"),
}


class FileError(InputError):
    """A file of measurements that cannot be read; the message names file, row and column."""


_OFFSET = re.compile(r"UTC([+-])(\d{2}):(\d{2})")


def zone_named(name: str) -> tzinfo:
    """Return the time zone of a name or an offset, such as UTC+02:00.

    UTC of "", also where no zones are installed.

    Raises
    ------
    FileError
        If there is no such zone.
    """
    offset = _OFFSET.fullmatch(name)
    try:
        if offset is not None:
            ahead = timedelta(hours=int(offset[2]), minutes=int(offset[3]))
            return timezone(ahead if offset[1] == "+" else -ahead)
        return ZoneInfo(name) if name else UTC
    except (KeyError, ValueError, OSError):
        raise FileError(
            f"zone {name!r} is no time zone; names are such as Europe/Berlin, Etc/GMT-1"
        ) from None


@dataclass(frozen=True, slots=True)
class TimeColumn:
    """What is stated of a file's time beside the file."""

    column: str = ""
    """Name as the file has it, without a unit in brackets; empty: found by its title."""

    unit: str = ""
    """Unit of its numbers: s, ms, us, ns, min, h, d. Empty: as the title states, else by size."""

    dates: DateOrder | None = None
    """What comes first in dates such as 3/4/2024; None: as the dates show."""

    zone: str = ""
    """Time zone of dates that state none, such as "Europe/Berlin"; empty: UTC."""

    second_hour: bool = False
    """Whether a file that begins in the hour that comes twice, as summer time ends, is of the
    second; False: of the first."""

    def __post_init__(self) -> None:
        zone_named(self.zone)


UNSTATED = TimeColumn()


@dataclass(frozen=True, slots=True)
class Wanted:
    """What of a file is read."""

    names: frozenset[str] = frozenset()
    """Names of the channels that are read; empty: all."""

    stamps: bool = True
    """False: the samples are counted and time stamps are not read."""

    rate_known: bool = False
    """True: the rate is stated beside the file, which then needs no time."""

    time: TimeColumn = UNSTATED
    """What is stated of the time beside the file."""

    def among(self, names: Sequence[str]) -> list[int]:
        """Return which of the channels are read; all where one that is wanted is missing."""
        complete = bool(self.names) and self.names <= set(names)
        return [i for i, name in enumerate(names) if name in self.names or not complete]


def dated(wanted: Wanted, time: TimeColumn) -> Wanted:
    """Return what is wanted with the order of dates and the zone that `time` states, if any."""
    own = wanted.time
    stated = replace(own, dates=time.dates or own.dates, zone=time.zone or own.zone)
    return replace(wanted, time=stated)


EVERYTHING = Wanted()
STANDING_STAMPS = (
    "{path}: its time stamps do not increase; --sampling-rate HZ counts the samples instead"
)


@dataclass(frozen=True, slots=True, eq=False)
class ChannelTable:
    """Samples of all channels of one file or of a chunk of it, with time stamps if it has them."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    """Units: "m/s²", "m/s", "m" after conversion; "" = unscaled; else as given."""

    samples: NDArray[np.float64]
    """Samples, (n_samples, n_channels), NaN where the file has nothing."""

    times: NDArray[np.float64] | None
    """Times, (n_samples,) seconds since the file's first sample, or None."""

    start_ns: int = 0
    """The file's first sample [ns since 1970-01-01 UTC]; 0: the file does not state it."""

    stated_rate: float | None = None
    """Sampling rate [Hz], where the file states it."""

    stated_quantities: tuple[Quantity | None, ...] = ()
    """Quantities where file or layout state them; () = neither."""

    rotor_speed: NDArray[np.float64] | None = None
    """Speed of a wind turbine's rotor, (n_samples,) [rpm], where the file holds it."""

    went_back: bool = False
    """Whether the file's local clock went back an hour up to the last of these samples."""

    def only(self, columns: Sequence[int]) -> "ChannelTable":
        """Return some of the channels, in the order of `columns`."""
        stated = self.stated_quantities
        return replace(
            self,
            names=tuple(self.names[i] for i in columns),
            units=tuple(self.units[i] for i in columns),
            samples=self.samples[:, columns],
            stated_quantities=tuple(stated[i] for i in columns) if stated else (),
        )

    @property
    def quantities(self) -> tuple[Quantity, ...] | None:
        """What each channel measures; None where neither file, unit nor name state it."""
        stated = self.stated_quantities or (None,) * len(self.names)
        titles = zip(stated, self.units, self.names, strict=True)
        known = [own or quantity_of(unit) or quantity_named(name) for own, unit, name in titles]
        found = tuple(quantity for quantity in known if quantity is not None)
        return found if len(found) == len(known) else None

    @property
    def sampling_rate(self) -> float | None:
        """Sampling rate as stated, else from the time stamps [Hz]; None without either."""
        if self.stated_rate is not None or self.times is None:
            return self.stated_rate
        return rate_of_stamps(self.times)


def rate_of_stamps(times: NDArray[np.float64]) -> float | None:
    """Return the sampling rate that time stamps have [Hz].

    None of fewer than two, or of standing time.

    The mean step, not the median: stamps rounded to the millisecond have a median that is wrong by
    up to half a millisecond. Steps over a gap do not count. Where single rows are missing, a step
    counts as the several that it is: the stamps then stray half as far from an even clock, and as
    they are by more than one and a half samples, which rounding alone does not make them. Of the
    rates that the stamps' scatter about an even clock allows, the one with the fewest digits, as a
    rate or as its period: stamps of 25.000 and 50.001 ms mean 40 Hz, not 39.9992.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Times [s].
    """
    if len(times) < 2 or not times[-1] > times[0]:
        return None
    all_steps = np.diff(times)
    typical = max(float(np.median(all_steps)), float(np.mean(all_steps)) / 2)
    steps = all_steps[all_steps <= 3 * typical]
    step = float(np.mean(steps))
    if not step > 0:
        return None
    strays = _stray(steps, step)
    if strays > 1.5 * step:
        near = all_steps[all_steps <= MOST_STEPS_PASSED * typical]
        first = float(np.mean(near[near <= 1.5 * typical]))
        for passed in (np.maximum(1, np.round(near / first)), _passed_together(near, first)):
            between = float(np.sum(near) / np.sum(passed))
            apart = _stray(near, between * passed)
            if apart < strays / 2 and np.mean(passed > 1) <= MOST_OF_SEVERAL:
                step, strays, steps = between, apart, near
    return _plainest(1.0 / step, strays / float(np.sum(steps)) + ROUNDING)


def _passed_together(steps: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """Return how many samples each step is, by the line through ever more stamps: for jitter.

    Parameters
    ----------
    steps : ndarray, shape (n,)
        [s]
    step : float
        About that of one sample [s].
    """
    times = np.concatenate([[0.0], np.cumsum(steps)])
    offset, count = 0.0, FEWEST_TOGETHER
    while True:
        some = times[: count + 1]
        for _ in range(2):
            numbers = np.round((some - offset) / step)
            if not numbers[-1] > numbers[0]:
                return np.ones_like(steps)
            step, offset = np.polyfit(numbers, some, 1).tolist()
        if count >= len(steps):
            return np.diff(numbers)
        count += max(1, count * 2 // 5)


def _stray(steps: NDArray[np.float64], even: NDArray[np.float64] | float) -> float:
    """Return how far stamps stray from an even clock with these steps [s]."""
    return float(np.ptp(np.cumsum(steps - even)))


def _plainest(rate: float, tolerance: float) -> float:
    """The number of fewest digits within a relative `tolerance` of a rate, or of its period."""
    for digits in range(1, 12):
        for value in (rate, 1.0 / rate):
            plain = float(f"{value:.{digits}g}")
            if abs(plain / value - 1.0) <= tolerance:
                return plain if value == rate else 1.0 / plain
    return rate


def join_chunks(chunks: Iterable[ChannelTable], path: Path) -> ChannelTable:
    """Return the chunks of one file, in their order, as one table.

    Raises
    ------
    FileError
        Fewer than two samples, only NaN, a time that ends before it starts.
    """
    parts = list(chunks)
    count = sum(len(part.samples) for part in parts)
    if count < 2:
        raise FileError(f"{path}: {count} sample{'s' * (count != 1)}; at least two are needed")
    samples = np.concatenate([part.samples for part in parts])
    if not np.isfinite(samples).any():
        raise FileError(f"{path}: only NaN in {', '.join(parts[0].names)}; numbers are needed")
    stamps = [part.times for part in parts if part.times is not None]
    times = np.concatenate(stamps) if len(stamps) == len(parts) else None
    if times is not None and times[-1] < times[0]:
        raise FileError(
            f"{path}: the time does not increase (the last sample is stamped "
            f"{times[0] - times[-1]:g} s before the first)"
        )
    return replace(parts[0], samples=samples, times=times)


def in_standard_unit(unit: str) -> tuple[str, float]:
    """Return the unit after conversion and the factor to it.

    Accelerations become m/s², velocities m/s, displacements m; the rest stays.
    """
    for standard, factors in (
        ("m/s²", ACCELERATION_UNITS),
        ("m/s", VELOCITY_UNITS),
        ("m", DISPLACEMENT_UNITS),
    ):
        if plain_unit(unit) in factors:
            return standard, factors[plain_unit(unit)]
    return unit.strip(), 1.0


def plain_unit(unit: str) -> str:
    """ "m·s⁻²", "m/s^2", "M / S²" and "m/sec**2" as one spelling each of what is meant."""
    plain = unit.lower().replace("sec", "s").translate(_SPELLING)
    return plain.replace("**", "").replace("*", "")


# "Â" comes before "²" and "µ" where UTF-8 was taken for Latin-1.
_SPELLING = str.maketrans("²³⁻−¹µμ", "23--1uu", "â \u00a0·⋅.^()")


def quantity_of(unit: str) -> Quantity | None:
    """Return what is measured in a unit (after conversion); None where the unit leaves it open."""
    if plain_unit(unit) in LIKE_DISPLACEMENT:
        return "displacement"
    known: dict[str, Quantity] = {"m/s²": "acceleration", "m/s": "velocity", "m": "displacement"}
    return known.get(unit)


def quantity_named(name: str) -> Quantity | None:
    """Return what a channel measures by its name: "acc_z145", "Velocity 3", "disp-x"."""
    for word in re.split(r"[^a-z]+", name.lower()):
        for quantity, words in _WORDS.items():
            if word in words:
                return quantity
    return None


@contextmanager
def readable(path: Path, kind: str, *damage: type[Exception]) -> Iterator[None]:
    """Report what a format's library raises of a damaged file in one line.

    Parameters
    ----------
    kind : str
        What the file should be, with its noun.
    damage : type of Exception
        What the library raises.

    Raises
    ------
    FileError
    """
    try:
        yield
    except FileError:
        raise
    except damage as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise FileError(f"{path}: no readable {kind}: {reason or type(error).__name__}") from error


def require_file(path: Path) -> Path:
    """Return the path.

    Raises
    ------
    FileError
        If no file is there, or it cannot be read.
    """
    try:
        with path.open("rb"):
            return path
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
