"""Which column of a unit's blocks a channel of the instrument is, and what turns it into m/s²."""

from dataclasses import replace

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.feeds.protocol import ChannelSamples
from sensors.files.layout_file import LayoutFile, MappedChannel
from sensors.files.table import in_standard_unit

FeedLayout = LayoutFile
LARGEST_SAMPLE = float(np.finfo(np.float32).max)  # that a block can hold, in its unit
UNSAID = "m/s²"  # what samples are in where neither layout nor message states it


class LayoutColumns:
    """The channels of a layout as the columns of a unit's blocks."""

    def __init__(self, layout: FeedLayout) -> None:
        self._channels = {channel.name: channel for channel in layout.channels}
        self._numbers = {channel.name: i for i, channel in enumerate(layout.channels)}
        self.layout = sensor_layout(layout)

    def __len__(self) -> int:
        return len(self._numbers)

    def has(self, name: str) -> bool:
        """Whether the layout lists a channel of this name."""
        return name in self._numbers

    def listed(self, piece: ChannelSamples) -> ChannelSamples:
        """Return the piece with its listed channels alone."""
        keep = [i for i, name in enumerate(piece.names) if name in self._numbers]
        if len(keep) == len(piece.names):
            return piece
        names = tuple(piece.names[i] for i in keep)
        return replace(piece, names=names, samples=piece.samples[:, keep])

    def refusal(self, piece: ChannelSamples) -> str:
        """Return why the piece's unit is none for its channels; "" where it is."""
        for name in piece.names:
            if self._channels[name].unit is None and factor_to(piece.unit) is None:
                return (
                    f"{piece.stream}: channel {name!r} comes in {piece.unit!r:.20}, which is no "
                    "acceleration; say in the layout what it is, e.g. unit = 'm/s'"
                )
        return ""

    def of(self, piece: ChannelSamples) -> tuple[list[int], FloatArray]:
        """Columns of the channels of a piece that has listed ones alone, and their samples in the
        layout's units, (n_samples, n_names); NaN where a number is none that a block can hold."""
        factors = [factor_of(self._channels[name], piece.unit) for name in piece.names]
        with np.errstate(over="ignore", invalid="ignore"):
            scaled = piece.samples * np.array(factors)
            scaled[~(np.abs(scaled) <= LARGEST_SAMPLE)] = np.nan
        return [self._numbers[name] for name in piece.names], scaled


def sensor_layout(layout: FeedLayout) -> SensorLayout:
    """Return the layout that is published: every channel in its standard unit."""
    return SensorLayout(
        layout.layout_id,
        turbine=layout.turbine,
        unit=layout.unit,
        channels=tuple(
            channel.accelerometer(in_standard_unit(channel.unit or UNSAID)[0])
            for channel in layout.channels
        ),
    )


def factor_of(channel: MappedChannel, stated: str) -> float:
    """Return what a sample is multiplied by to be in the channel's standard unit.

    Parameters
    ----------
    channel : MappedChannel
        With its unit and sensitivity where the layout states them.
    stated : str
        Unit of the samples by the message's own words; the layout's unit takes precedence.
    """
    _, factor = in_standard_unit(channel.unit or stated or UNSAID)
    return factor / (channel.sensitivity or 1.0)


def factor_to(stated: str) -> float | None:
    """Return what turns a unit into m/s²; None for one that is of no acceleration."""
    unit, factor = in_standard_unit(stated or UNSAID)
    return factor if unit == UNSAID else None
