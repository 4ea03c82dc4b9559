"""Where the channels of a new project were: as a layout file states, or as their names let one
guess."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.offline.project_texts import layout_text
from pipeline.sources.sources import LAYOUT_FILE
from sensors.errors import InputError
from sensors.files.channel_names import GuessedChannel, UnusedChannel, guess_channels, split_motions
from sensors.files.layout_file import LayoutFile, parse_layout
from sensors.files.table import ChannelTable, TimeColumn

Placing = Callable[[GuessedChannel], GuessedChannel]


@dataclass(frozen=True, slots=True)
class ProjectLayout:
    """Channels of a measurement with their places."""

    turbine: str
    channels: tuple[GuessedChannel, ...]
    left_out: tuple[UnusedChannel, ...]
    """Channels of the files that are not in the layout."""
    text: str
    """Of the layout file in the project's folder."""
    mapping: LayoutFile
    """As files are read by it."""
    is_stated: bool
    """Whether the places are a layout file's; else they are read from names."""

    def without(self, unused: Collection[UnusedChannel]) -> "ProjectLayout":
        """Return the layout without channels that show nothing; a stated one keeps them."""
        if self.is_stated or not unused:
            return self
        gone = {each.name for each in unused}
        channels = tuple(each for each in self.channels if each.name not in gone)
        left_out = (*self.left_out, *unused)
        return _as_guessed(self.turbine, channels, left_out, self.mapping.time)

    def require_places(self) -> None:
        """Raise InputError where a structural model could not be compared with a channel.

        A compass direction is good enough: that all sensors are turned alike is found by the modes.
        """
        unknown = [
            each
            for each in self.channels
            if not (each.height_known and (each.direction_known or each.is_compass))
        ]
        if unknown:
            first = unknown[0]
            axis_known = first.direction_known or first.is_compass
            stated = {"height": first.height_known, "axis": axis_known}
            missing = " and no ".join(what for what, is_known in stated.items() if not is_known)
            raise InputError(
                f"the structural model needs the height and axis of each channel; {first.name!r} "
                f"has no {missing} in its name: give --layout FILE.toml (`pilewatch import FILE "
                "--template` prints one to fill in)"
            )


def stated_layout(
    path: Path, stated: LayoutFile, table: ChannelTable, *, name: str = ""
) -> ProjectLayout:
    """Return the layout of a file.

    Parameters
    ----------
    path : Path
        Layout file.
    stated : LayoutFile
        What it holds.
    table : ChannelTable
        Every channel of the measurement.
    name : str
        Of the turbine, which the file states.

    Raises
    ------
    InputError
        If the turbine is given another name.
    """
    if name and name != stated.turbine:
        raise InputError(f"--name {name!r}: {path} names the turbine {stated.turbine!r}")
    listed = {channel.name for channel in stated.channels}
    channels = tuple(
        GuessedChannel(
            channel.name,
            channel.elevation,
            channel.direction,
            f"{channel.elevation:g} m, direction {_vector(channel.direction)}, as {path} states",
        )
        for channel in stated.channels
    )
    left_out = tuple(
        UnusedChannel(each, "not in the layout") for each in table.names if each not in listed
    )
    text = path.read_text("utf-8-sig")
    return ProjectLayout(stated.turbine, channels, left_out, text, stated, is_stated=True)


def guessed_layout(
    table: ChannelTable,
    origin: str,
    *,
    turbine: str,
    time: TimeColumn,
    place: Placing | None = None,
) -> ProjectLayout:
    """Return the layout that the channels' names let one guess.

    Parameters
    ----------
    table : ChannelTable
        Every channel of the measurement.
    origin : str
        The file's name, for errors.
    turbine : str
        Its name.
    time : TimeColumn
        What the titles do not state of it.
    place : callable, optional
        Guess of a channel whose name lacks height or axis → where it was; None: as guessed.
    """
    columns, left_out = choose_channels(table, origin)
    channels = guess_channels(table.only(columns).names)
    if place is not None:
        channels = tuple(each if each.known else place(each) for each in channels)
    return _as_guessed(turbine, channels, left_out, time)


def _as_guessed(
    turbine: str,
    channels: tuple[GuessedChannel, ...],
    left_out: tuple[UnusedChannel, ...],
    time: TimeColumn,
) -> ProjectLayout:
    text = layout_text(channels, turbine, time)
    mapping = parse_layout(text, LAYOUT_FILE)
    return ProjectLayout(turbine, channels, left_out, text, mapping, is_stated=False)


def choose_channels(
    table: ChannelTable, origin: str
) -> tuple[list[int], tuple[UnusedChannel, ...]]:
    """Return the columns of a measurement's motions, all of one quantity, and what is left out.

    Accelerations where there are some, else what most channels measure.
    """
    columns, left_out = split_motions(table, origin)
    quantities = [table.only([column]).quantities for column in columns]
    counts = Counter(each[0] for each in quantities if each)
    if not counts:
        return columns, left_out
    wanted = "acceleration" if counts["acceleration"] else counts.most_common(1)[0][0]
    others = {
        column: each[0]
        for column, each in zip(columns, quantities, strict=True)
        if each and each[0] != wanted
    }
    left_out += tuple(
        UnusedChannel(table.names[column], f"a {quantity}, beside {wanted}s")
        for column, quantity in others.items()
    )
    return [column for column in columns if column not in others], left_out


def _vector(direction: Sequence[float]) -> str:
    return " ".join(f"{value:g}" for value in direction)
