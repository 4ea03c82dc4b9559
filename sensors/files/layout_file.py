"""A layout file: where on the tower the channels of a measurement were, and what they measured.

    turbine = "t07"
    [[channels]]
    name = "ACC_1X"
    elevation = 145.0
    direction = [1.0, 0.0, 0.0]

    [time]                     only where the titles do not state the time
    column = "Messpunkt"
    unit = "ms"
    dates = "day-first"        where 3/4/2024 is in April
    zone = "Europe/Berlin"     of dates that state none

What it lists is taken, in its order; other channels of the measurement are left out.
"""

import difflib
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from sensors.acquisition.key_parts import named_key_part_error
from sensors.acquisition.layout import (
    FORE_AFT,
    SIDE_SIDE,
    Accelerometer,
    Coupling,
    LayoutError,
    SensorLayout,
    require_height,
)
from sensors.files.table import (
    UNSTATED,
    ChannelTable,
    Quantity,
    TimeColumn,
    Wanted,
    in_standard_unit,
    quantity_named,
    quantity_of,
)
from sensors.settings import settings_from_table, toml_string, toml_table

if TYPE_CHECKING:
    from sensors.files.channel_names import GuessedChannel

_OUR_NAMES = re.compile(r"z(?P<elevation>-?\d+(\.\d+)?)-(?P<axis>fa|ss)")
_CONVERTED = ("m/s²", "m/s", "m")  # units of channels whose file states its unit


@dataclass(frozen=True, slots=True)
class MappedChannel:
    """One channel of a measurement."""

    name: str
    """Name of the channel as the measurement has it."""

    elevation: float
    """Elevation above mean water level [m]."""

    direction: tuple[float, float, float]
    """Direction of the positive axis (x, y, z); of any length."""

    quantity: Literal["acceleration", "velocity", "displacement", "strain"] | None = None
    """What the channel measures; None: by its unit, else an acceleration."""
    unit: str | None = None
    """Unit of the samples, or of what the sensitivity divides to."""

    sensitivity: float | None = None
    """Sensitivity of the samples per `unit`: V per g, counts per m/s²."""

    coupling: Coupling = "dc"
    """"dc" or "ac"; a DC-coupled sensor feels the tilt of the tower."""
    corner_frequency: float = 0.0
    """Corner frequency of an AC-coupled axis [Hz]."""

    serial: str = ""
    """Serial number of the sensor."""

    def __post_init__(self) -> None:
        where = f"channel {self.name!r}"
        require_height(self.name, self.elevation)
        if not any(self.direction):
            raise LayoutError(f"{where}: direction is {self.direction}; it must point somewhere")
        if self.sensitivity is not None and not abs(self.sensitivity) > 0:
            raise LayoutError(f"{where}: sensitivity is {self.sensitivity:g}; 0 measures nothing")
        if self.sensitivity is not None and self.unit is None:
            raise LayoutError(
                f"{where}: sensitivity {self.sensitivity:g} is per what? Its unit is missing, "
                "e.g. unit = 'g' where it is in V per g"
            )

    def accelerometer(self, unit: str) -> Accelerometer:
        """Return what is published of the channel, of samples in that unit."""
        x, y, z = (np.array(self.direction) / np.linalg.norm(self.direction)).tolist()
        return Accelerometer(
            self.name,
            self.elevation,
            (x, y, z),
            self.coupling,
            self.corner_frequency,
            self.serial,
            unit=unit,
        )


@dataclass(frozen=True, slots=True)
class LayoutFile:
    """All that is known of how a measurement was mounted."""

    channels: tuple[MappedChannel, ...]
    turbine: str = "turbine"
    """Name of the turbine, part of a Zenoh key."""

    unit: str = "tower"
    """Name of the acquisition unit, part of a Zenoh key."""

    layout_id: str = "imported"
    """Name of the layout, in every message, one of each unit; absent: turbine and unit, joined
    by a hyphen (`t1-tower`).
    """
    origin: str = "layout"
    """The file's name, for errors."""

    time: TimeColumn = UNSTATED
    """What the titles do not state of it."""

    def __post_init__(self) -> None:
        if not self.channels:
            raise LayoutError("no [[channels]]; at least one is needed")
        names = [channel.name for channel in self.channels]
        if twice := [name for name in names if names.count(name) > 1]:
            raise LayoutError(f"channel {twice[0]!r} is listed twice")
        for key in ("turbine", "unit"):
            name = getattr(self, key)
            if wrong := named_key_part_error(name):
                raise LayoutError(f"{key} is {name!r}: {wrong}")

    def wanted(self) -> Wanted:
        """Return what of a file is read."""
        return Wanted(frozenset(channel.name for channel in self.channels), time=self.time)

    def chosen(self, table: ChannelTable) -> ChannelTable:
        """Return the channels that the layout lists, in their units.

        Raises
        ------
        LayoutError
            For a channel that the measurement lacks, and for a unit that it states itself.
        """
        columns = [self._column(channel, table) for channel in self.channels]
        pairs = list(zip(self.channels, columns, strict=True))
        units, factors = zip(*(self._scale(channel, table, i) for channel, i in pairs), strict=True)
        self._require_one_scale(units)
        stated = table.stated_quantities or (None,) * len(table.names)
        return replace(
            table,
            names=tuple(channel.name for channel in self.channels),
            units=units,
            samples=table.samples[:, columns] * np.array(factors),
            stated_quantities=self._quantities([stated[i] for i in columns], units),
        )

    def _quantities(
        self, stated: Sequence[Quantity | None], units: Sequence[str]
    ) -> tuple[Quantity | None, ...]:
        """What each channel measures: as the layout says, else the file; where the layout says it
        of some channels, the others are accelerations unless unit or name says otherwise."""
        known = [
            _quantity(channel) or of_file
            for channel, of_file in zip(self.channels, stated, strict=True)
        ]
        if not any(channel.quantity for channel in self.channels):
            return tuple(known)
        names = [channel.name for channel in self.channels]
        return tuple(
            own or quantity_of(unit) or quantity_named(name) or "acceleration"
            for own, unit, name in zip(known, units, names, strict=True)
        )

    def sensor_layout(self, table: ChannelTable) -> SensorLayout:
        """Return the layout of a table's channels, which `chosen` gave."""
        return SensorLayout(
            self.layout_id,
            turbine=self.turbine,
            unit=self.unit,
            channels=tuple(
                channel.accelerometer(unit)
                for channel, unit in zip(self.channels, table.units, strict=True)
            ),
        )

    def _column(self, channel: MappedChannel, table: ChannelTable) -> int:
        if channel.name in table.names:
            return table.names.index(channel.name)
        by_lower = {name.lower(): name for name in table.names}
        close = difflib.get_close_matches(channel.name.lower(), by_lower, n=1)
        advice = (
            f"did you mean {by_lower[close[0]]!r}?" if close else f"it has {', '.join(table.names)}"
        )
        raise LayoutError(
            f"{self.origin}: the measurement has no channel {channel.name!r}; {advice}"
        )

    def _scale(self, channel: MappedChannel, table: ChannelTable, column: int) -> tuple[str, float]:
        """Unit of a channel's samples, and the factor to it."""
        stated = table.units[column]
        if channel.unit is None:
            return stated, 1.0
        if stated in _CONVERTED:
            if channel.sensitivity is None and in_standard_unit(channel.unit) == (stated, 1.0):
                return stated, 1.0  # the layout repeats what the file states
            raise LayoutError(
                f"{self.origin}: channel {channel.name!r} is in {stated}, or what becomes it, by "
                f"the measurement's own words; leave unit = {channel.unit!r} out"
            )
        from sensors.files.text.column_titles import is_unit  # pyarrow: not on a tower unit

        if not is_unit(channel.unit):
            raise LayoutError(
                f"{self.origin}: channel {channel.name!r}: unit {channel.unit!r} is not known; it "
                "can be m/s², g, mm/s, mm and alike; leave it out where samples have no scale"
            )
        unit, factor = in_standard_unit(channel.unit)
        return unit, factor / (channel.sensitivity or 1.0)

    def _require_one_scale(self, units: Sequence[str]) -> None:
        """Raise LayoutError for samples in volts beside samples in m/s², unless it says so."""
        scaled = [unit for unit in units if quantity_of(unit)]
        for channel, unit in zip(self.channels, units, strict=True):
            if scaled and unit and quantity_of(unit) is None and channel.unit is None:
                raise LayoutError(
                    f"{self.origin}: channel {channel.name!r} is in {unit}, others are in "
                    f"{scaled[0]}: state its unit and sensitivity, unit = {unit!r} to take it as "
                    "it is, or delete it"
                )


def load_layout(path: Path) -> LayoutFile:
    """Return the layout in a TOML file.

    Raises
    ------
    LayoutError
        One line: no such file, not TOML, an unknown or missing key, a wrong value.
    """
    try:
        text = path.read_text("utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8"
        raise LayoutError(f"layout {path} cannot be read: {reason}") from error
    return parse_layout(text, str(path))


def parse_layout(text: str, path: str) -> LayoutFile:
    """Return the layout of a TOML text.

    Parameters
    ----------
    text : str
        Content of a layout file.
    path : str
        Its name, for errors.

    Raises
    ------
    LayoutError
        One line: not TOML, an unknown or missing key, a wrong value.
    """
    table = toml_table(text, path, LayoutError)
    channels = table.get("channels", [])
    if not isinstance(channels, list) or not all(isinstance(each, dict) for each in channels):
        raise LayoutError(f"{path}: channels are written as [[channels]], one a channel")
    mapped = tuple(
        settings_from_table(MappedChannel, each, f"{path} [[channels]] {i + 1}", LayoutError)
        for i, each in enumerate(channels)
    )
    others = {key: each for key, each in table.items() if key != "channels"}
    checked = settings_from_table(_Heading, others, path, LayoutError)
    try:
        _require_heights(mapped)
        layout_id = checked.layout_id or f"{checked.turbine}-{checked.unit}"
        return LayoutFile(mapped, checked.turbine, checked.unit, layout_id, path, checked.time)
    except LayoutError as error:
        raise LayoutError(f"{path}: {error}") from error


@dataclass(frozen=True, slots=True)
class _Heading:
    """The keys above the channels."""

    turbine: str = "turbine"
    unit: str = "tower"
    layout_id: str = ""
    time: TimeColumn = UNSTATED

    def __post_init__(self) -> None:
        if not self.time.unit:
            return
        if not self.time.column:
            raise LayoutError(f"[time] unit is {self.time.unit!r}, but no column is named")
        from sensors.files.text.time_column import known_unit  # pyarrow: not on a tower unit

        if known_unit(self.time.unit) is None:
            raise LayoutError(
                f"[time] unit is {self.time.unit!r}; it can be s, ms, us, ns, min, h or d"
            )


def _require_heights(channels: Sequence[MappedChannel]) -> None:
    """Raise LayoutError for a template that was not filled in: every height is 0."""
    horizontal = all(channel.direction[2] == 0 for channel in channels)
    if channels and horizontal and all(channel.elevation == 0 for channel in channels):
        raise LayoutError(
            f"elevation is 0 for all {len(channels)} channels; fill in each sensor's height above "
            "mean water level [m]"
        )


def layout_by_names(names: Sequence[str], *, turbine: str = "turbine") -> LayoutFile | None:
    """Return the layout that names like "z145-fa" state, which our own recordings have.

    None of others.
    """
    found = [_OUR_NAMES.fullmatch(name) for name in names]
    channels = tuple(
        MappedChannel(
            name,
            elevation=float(match["elevation"]),
            direction=FORE_AFT if match["axis"] == "fa" else SIDE_SIDE,
        )
        for name, match in zip(names, found, strict=True)
        if match is not None
    )
    if len(channels) < len(names):
        return None
    return LayoutFile(channels, turbine, "tower", origin="channel names")


def layout_template(table: ChannelTable, constant: Collection[str] = ()) -> str:
    """Return a layout file of a measurement's channels, to fill in.

    Heights and axes are those that the names state, as in `pilewatch new`.

    Parameters
    ----------
    table : ChannelTable
        Names and units.
    constant : collection of str
        Channels that never change: a comment beside them says so.
    """
    from sensors.files.channel_names import guess_channels  # pyarrow: not on a tower unit

    lines = [
        "# Where the channels of the measurement were. Axes: x downwind (fore-aft), y to the side",
        "# (side-side), z up from mean water level. Delete the channels that are not to be used.",
        'turbine = "turbine"                # no spaces: it becomes part of keys',
        'unit = "tower"                     # the acquisition unit',
    ]
    guessed = guess_channels(table.names)
    some_known = any(each.height_known for each in guessed)
    for each, unit in zip(guessed, table.units, strict=True):
        lines += ["", "[[channels]]", f"name = {toml_string(each.name)}"]
        if each.name in constant:
            lines.append("# constant over the file: it measures nothing; delete this channel")
        lines += _place_lines(each, some_known=some_known)
        if unit in _CONVERTED:
            lines.append(f"# unit and sensitivity: the file states {unit}, or what becomes it")
        else:
            hint = f"; the file states {unit!r}" if unit else ""
            lines += [
                f'# unit = "m/s²"                    # of its samples{hint}',
                "# sensitivity = 1.0                # samples per unit, e.g. 0.1 for 100 mV per g",
            ]
        lines += [
            '# quantity = "acceleration"        # velocity, displacement, strain',
            '# coupling = "ac"                  # of one that does not feel tilt; "dc" without it',
            "# corner_frequency = 0.05          # below which an AC-coupled one falls off [Hz]",
        ]
    lines += [
        "",
        "# [time]                             # only where the file's titles do not state the time",
        '# column = "t"                       # the column that holds it',
        '# unit = "s"                         # s, ms, us, ns, min, h, d',
        '# zone = "Europe/Berlin"             # of dates that state none; UTC without it',
    ]
    return "\n".join(lines) + "\n"


def _place_lines(channel: "GuessedChannel", *, some_known: bool) -> list[str]:
    """Lines of a channel's height and axis.

    A height that is not known beside others that are is commented out, so that the file is refused
    until it is filled in: 0 is a height, too.
    """
    height, axis = channel.reason.split(", ", 1)
    above, positive = "above mean water level [m]", "of its positive axis, x y z"
    if channel.height_known:
        elevation = f"elevation = {channel.elevation!r}".ljust(35)
        lines = [f"{elevation}# {above}: {height[height.index('from') :]}"]
    else:
        lines = [f"{'# elevation = ' if some_known else 'elevation = 0.0'}".ljust(35)]
        lines[0] += f"# {above}: fill in"
    x, y, z = channel.direction
    direction = f"direction = [{float(x)}, {float(y)}, {float(z)}]".ljust(35)
    seen = axis if channel.direction_known or channel.is_compass else "fill in"
    return [*lines, f"{direction}# {positive}: {seen}"]


def _quantity(channel: MappedChannel) -> Quantity | None:
    return "displacement" if channel.quantity == "strain" else channel.quantity
