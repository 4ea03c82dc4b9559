"""What a turbine's controller reports, as JSON or as rows of a table → ScadaSample.

    {"time": "2024-03-01T12:00:00Z", "wind_speed": 9.1, "rotor_speed": 0.2, "state": "parked"}

Names are the ScadaSample's; others are mapped by options of the feed's address, with a factor
where the unit differs:  ?wind_speed=Wind.Avg&power=P_kW*1000
Where the level counts from another zero than the mean water level, water_level_zero is the
elevation of that zero above the mean [m]; a chart datum has a negative one.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.feeds.address import FeedAddress
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.timestamps import moment_ns
from sensors.feeds.protocol import FeedCounts, FeedError
from sensors.files.missing_values import is_missing

REPORTED_STATES = ("parked", "idling", "start", "operating", "stop", "")
LARGEST_FIGURE = 1e9  # of any figure, in whatever unit
LARGEST_ELEVATION = 1e4  # of a gauge's zero above or below the mean water level [m]
LEAP = 86_400.0  # between two reports: a stamp farther ahead is believed when others agree [s]
AGREEING_REPORTS = 3  # reports in a row
_FIGURES = tuple(
    field.name
    for field in dataclasses.fields(ScadaSample)
    if field.name not in ("turbine", "time_ns", "state")
)


@dataclasses.dataclass(frozen=True, slots=True)
class _Mapped:
    name: str  # as the source has it
    factor: float = 1.0


class ScadaReader:
    """Reads what one controller reports.

    Parameters
    ----------
    address : FeedAddress
        Of the feed; its options map names.
    turbine : str
        That the controller is of.

    Raises
    ------
    FeedError
        For a factor that is no number.

    Notes
    -----
    `declared` has the names that the options give, in their order.
    """

    def __init__(self, address: FeedAddress, turbine: str) -> None:
        self._turbine = turbine
        self._figures = {name: _mapped(address, name) for name in _FIGURES}
        self._zero = _elevation(address, "water_level_zero")
        given = [name for name in address.options if name in (*_FIGURES, "state")]
        self.declared = tuple(_mapped(address, name).name for name in given)
        self._time, self._state = _mapped(address, "time").name, _mapped(address, "state").name

    @property
    def names(self) -> tuple[str, ...]:
        """What it looks for."""
        return (self._time, self._state, *(each.name for each in self._figures.values()))

    def sample(self, said: Mapping[str, Any]) -> ScadaSample:
        """What is reported at one moment; what is not reported is unknown (NaN).

        Raises MessageError where there is no time, or nothing else.
        """
        if self._time not in said:
            raise MessageError(f"no {self._time!r} in it; it has {', '.join(list(said)[:10])}")
        try:
            time_ns = moment_ns(said[self._time])
        except ValueError as error:
            raise MessageError(f"{self._time}: {error}") from error
        if not any(name in said for name in self.names[1:]):
            raise MessageError(f"none of {', '.join(self.names[1:])} in it")
        written = said.get(self._state)
        state = "" if not written or is_missing(written) else str(written).strip().lower()
        if state not in REPORTED_STATES:
            raise MessageError(f"{self._state} is {state!r:.20}; {', '.join(REPORTED_STATES[:-1])}")
        figures = {name: _figure(each, said) for name, each in self._figures.items()}
        figures["water_level"] += self._zero
        return ScadaSample(self._turbine, time_ns, state, **figures)


class RisingTimes:
    """Which reports of a controller are new: every one is later than those before it.

    A stamp that leaps ahead is believed when those behind it agree, so that one wild stamp does not
    make all that follows late. What a file repeats stays late, however much of it there is;
    only a time that fewer than AGREEING reports have shown may turn out wrong itself.
    """

    def __init__(self, counts: FeedCounts) -> None:
        self._counts = counts
        self._newest_ns: int | None = None
        self._shown = 0  # reports in a row that were taken
        self._held: list[ScadaSample] = []  # whose stamps leap

    def taken(self, sample: ScadaSample) -> list[ScadaSample]:
        """What is to be given, now that this one came; the others are counted."""
        if self._newest_ns is None or _follows(sample.time_ns, self._newest_ns):
            self._drop_held()
            return self._take([sample])
        if self._held and not _follows(sample.time_ns, self._held[-1].time_ns):
            self._drop_held()
        if sample.time_ns <= self._newest_ns and self._shown >= AGREEING_REPORTS:
            self._count(sample)
            return []
        self._held.append(sample)
        if len(self._held) < AGREEING_REPORTS:
            return []
        held, self._held, self._shown = self._held, [], 0
        return self._take(held)

    def _take(self, samples: list[ScadaSample]) -> list[ScadaSample]:
        self._newest_ns = samples[-1].time_ns
        self._shown += len(samples)
        return samples

    def _drop_held(self) -> None:
        for sample in self._held:
            self._count(sample)
        self._held = []

    def _count(self, sample: ScadaSample) -> None:
        assert self._newest_ns is not None
        if sample.time_ns > self._newest_ns:
            self._counts.refuse("a report whose stamp is far ahead of those around it")
        elif sample.time_ns == self._newest_ns:
            self._counts.duplicate += 1
        else:
            self._counts.late += 1


def _follows(time_ns: int, before_ns: int) -> bool:
    return 0 < time_ns - before_ns <= LEAP * NANOSECONDS


def _mapped(address: FeedAddress, name: str) -> _Mapped:
    written, star, factor = address.options.get(name, name).rpartition("*")
    if not star:
        return _Mapped(factor)
    try:
        return _Mapped(written, float(factor))
    except ValueError as error:
        raise FeedError(
            f"{address.text}: {name}={written}*{factor}: {factor!r} is no factor"
        ) from error


def _elevation(address: FeedAddress, option: str) -> float:
    written = address.options.get(option, "0")
    try:
        elevation = float(written)
    except ValueError:
        elevation = math.nan
    if not abs(elevation) <= LARGEST_ELEVATION:
        raise FeedError(f"{address.text}: {option}={written} is no elevation in metres")
    return elevation


def _figure(mapped: _Mapped, said: Mapping[str, Any]) -> float:
    written: Any = said.get(mapped.name)
    if is_missing(written):
        return math.nan
    try:
        value = float(written) * mapped.factor
    except (TypeError, ValueError, OverflowError) as error:
        raise MessageError(f"{mapped.name} is {written!r:.40}, which is no number") from error
    return value if abs(value) <= LARGEST_FIGURE else math.nan
