"""OPC UA data values of a controller → ScadaSamples, one figure at a time."""

from collections.abc import Iterator
from typing import Any

from sensors.acquisition.scada import ScadaSample
from sensors.feeds.lru import LruCache
from sensors.feeds.opcua.values import content_of, stamp_ns
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.scada import RisingTimes, ScadaReader
from sensors.feeds.protocol import FeedCounts


class ScadaValueReader:
    """Reads the variables of a controller that an address names.

    Parameters
    ----------
    reader : ScadaReader
        Knows which figure each variable is.
    counts : FeedCounts
        Takes what is late, duplicate or no figure.
    """

    def __init__(self, reader: ScadaReader, counts: FeedCounts) -> None:
        self.newest_ns: dict[str, int] = {}  # stays empty: no history is read
        self._reader, self._counts = reader, counts
        self._times: LruCache[RisingTimes] = LruCache()

    def pass_over_known(self) -> None:
        """Nothing to do: late and duplicate reports are left out by their times."""

    def read(self, name: str, value: Any) -> Iterator[ScadaSample]:
        """Yield the report that a data value is; a bad one is none."""
        self._counts.received += 1
        time_ns = stamp_ns(value)
        if time_ns is None or value.StatusCode.is_bad():
            return
        times = self._times.get(name)
        if times is None:
            times = RisingTimes(self._counts)
            self._times.put(name, times)
        try:
            sample = self._reader.sample({"time": time_ns, name: content_of(value)})
        except MessageError as error:
            self._counts.refuse(f"{name}: {error}")
            return
        yield from times.taken(sample)
