"""What a logger writes where it has no value, as -9999 or 0: missing samples, not motion."""

from dataclasses import dataclass, field

import numpy as np

from sensors.arrays import BoolArray, FloatArray
from sensors.files.channel_names import other_quantity
from sensors.files.table import ChannelTable
from sensors.files.text.columns import log_once

FAR_OFF = 15.0  # from the median, in interquartile ranges: 20 std of a normal signal
NEAR_BY = 5.0  # from the median, of what stands beside such a value, in the same
FEWEST_REPEATED = 2  # samples that have the value exactly
MOST_FILL_VALUES = 2  # of one channel
FILLED_SHARE = 0.9  # of all samples that are far off
MEASURED_BESIDE = 0.8  # of the samples beside them that are near the median
FEWEST_LOOKED_AT = 100  # samples for median and quartiles
MOST_LOOKED_AT = 10_000


class FillValues:
    """Finds the fill values of a measurement's channels, chunk by chunk.

    Parameters
    ----------
    origin : str
        What to call the measurement in messages.

    Notes
    -----
    A fill value is repeated exactly, nearly all that is far from what the channel measures, and
    comes and goes from one sample to the next. A blow that reaches the sensor's limit rings down
    through the values between; a spike has a value of its own.
    """

    def __init__(self, origin: str) -> None:
        self._origin = origin
        self._rows = 0
        self._channels: dict[str, _Channel] = {}

    def leave_out(self, chunk: ChannelTable) -> None:
        """Set samples of the next chunk that are a fill value to NaN, in place.

        Only channels that may be motions are looked at: a rotor that stands has 0 rpm.
        """
        for name, unit, series in zip(chunk.names, chunk.units, chunk.samples.T, strict=True):
            if other_quantity(name, unit):
                continue
            channel = self._channels.setdefault(name, _Channel())
            known = set(channel.known)
            found = channel.fill_values(series)
            for value in sorted(found - known):
                first = self._rows + int(np.argmax(series == value)) + 1
                log_once(
                    f"{self._origin}: {name} has {value:.6g}{unit and f' {unit}'} again and again, "
                    f"the first time in sample {first}, far from all that it measures, as loggers "
                    "write where they have no value; these samples are taken as missing"
                )
            if found:
                series[np.isin(series, list(found))] = np.nan
        self._rows += len(chunk.samples)


@dataclass(slots=True)
class _Channel:
    """One channel of a file, as far as it was read."""

    known: set[float] = field(default_factory=set)
    """Its fill values."""

    median: float = 0.0
    width: float = float("inf")
    """Interquartile range of what it measures; infinite where that is not known yet."""

    def fill_values(self, series: FloatArray) -> set[float]:
        """Return the fill values among the next samples, (n,)."""
        lowest, highest = np.fmin.reduce(series), np.fmax.reduce(series)
        self._look_at(series[(series > lowest) & (series < highest)])
        if not max(highest - self.median, self.median - lowest) > FAR_OFF * self.width:
            return set()
        distance = np.abs(series - self.median)
        far, near = distance > FAR_OFF * self.width, ~(distance > NEAR_BY * self.width)
        values, counts = np.unique(series[far], return_counts=True)
        found = {value for value in values.tolist() if value in self.known}
        most = np.argsort(counts)[::-1][:MOST_FILL_VALUES]
        repeated = values[most][counts[most] >= FEWEST_REPEATED]
        is_fill = np.isin(series, repeated)
        if is_fill.sum() >= FILLED_SHARE * far.sum():
            for value in repeated.tolist():
                if _comes_and_goes(series == value, near, is_fill):
                    found.add(value)
        self.known |= found
        return found

    def _look_at(self, inner: FloatArray) -> None:
        """Take median and width from samples between the extremes, which may be fill values."""
        if len(inner) >= FEWEST_LOOKED_AT:
            some = inner[:: len(inner) // MOST_LOOKED_AT + 1]
            low, median, high = np.quantile(some, (0.25, 0.5, 0.75)).tolist()
            if high > low:
                self.median, self.width = median, high - low


def _comes_and_goes(is_value: BoolArray, near: BoolArray, is_fill: BoolArray) -> bool:
    """Whether most samples beside a value's are near the median, or have no value either."""
    beside = np.zeros(len(is_value), dtype=bool)
    beside[:-1] |= is_value[1:]
    beside[1:] |= is_value[:-1]
    beside &= ~is_fill
    return not beside.any() or bool(near[beside].mean() >= MEASURED_BESIDE)
