"""The feed that an address names, with the unit that is put together of it, or its raw messages."""

import asyncio
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from sensors.acquisition.layout import SensorLayout
from sensors.feeds.address import FeedAddress, parsed
from sensors.feeds.assembly.assembler import WAIT, Assembler
from sensors.feeds.csv_tail import CsvTailFeed
from sensors.feeds.live import LiveFeed, batches
from sensors.feeds.message_journal import MessageJournal
from sensors.feeds.mqtt import MqttFeed, SamplesReader, ScadaMessages, is_description
from sensors.feeds.opcua.nodes import SeenVariable
from sensors.feeds.opcua.opcua_feed import OpcUaFeed
from sensors.feeds.opcua.values import ScadaValueReader, ValueReader
from sensors.feeds.payloads.scada import ScadaReader
from sensors.feeds.position import FeedPosition, position_file
from sensors.feeds.protocol import Arrival, Feed, FeedCounts, FeedError
from sensors.feeds.seedlink import SeedLinkFeed
from sensors.feeds.udp import UdpFeed
from sensors.files.layout_file import LayoutFile, MappedChannel

MOST_MESSAGES = 2000  # that `--sniff` looks at


def open_feed(
    text: str,
    layout: LayoutFile,
    *,
    turbine: str | None = None,
    once: bool = False,
    state: Path | None = None,
) -> LiveFeed:
    """Return the feed that a URL names; nothing is connected before it is read.

    Parameters
    ----------
    text : str
        The URL.
    layout : LayoutFile
        Of its channels.
    turbine : str, optional
        That it belongs to; None: the layout's.
    once : bool, optional
        Give up where nothing can be reached at the start.
    state : Path, optional
        Folder where it is remembered how far the source was published; None: nowhere.

    Raises
    ------
    FeedError
        For a URL that cannot be understood, and for a package that is missing.
    """
    address = parsed(text)
    layout = layout if turbine is None else replace(layout, turbine=turbine)
    position = FeedPosition(None if state is None else position_file(state, text))
    feed = _feed(address, layout, once=once, position=position)
    if address.scheme.startswith("scada"):
        return LiveFeed(feed, None)
    wait = address.number("wait", WAIT)
    assert wait is not None
    rate = address.number("rate")
    return LiveFeed(feed, Assembler(layout, feed.counts, sampling_rate=rate, wait=wait), position)


def _feed(address: FeedAddress, layout: LayoutFile, *, once: bool, position: FeedPosition) -> Feed:
    names = tuple(channel.name for channel in layout.channels)
    match address.scheme:
        case "udp":
            return UdpFeed(address, names)
        case "mqtt":
            counts = FeedCounts()
            samples = SamplesReader(address, names, counts)
            return MqttFeed(
                address,
                samples,
                counts,
                once=once,
                journal=_journal(position),
                asking=samples.asking,
            )
        case "scada+mqtt":
            counts = FeedCounts()
            reader = ScadaMessages(ScadaReader(address, layout.turbine), counts)
            return MqttFeed(address, reader, counts, once=once)
        case "opcua":
            counts = FeedCounts()
            stamp = address.one_of("stamp", ("first", "last"))
            values = ValueReader(counts, address.number("rate"), stamp)
            return OpcUaFeed(address, names, values, counts, once=once, position=position)
        case "scada+opcua":
            counts = FeedCounts()
            controller = ScadaReader(address, layout.turbine)
            if not controller.declared:
                raise FeedError(f"{address.text}: which variables? e.g. ?wind_speed=ns=2;s=Wind")
            figures = ScadaValueReader(controller, counts)
            return OpcUaFeed(address, controller.declared, figures, counts, once=once)
        case "seedlink":
            return SeedLinkFeed(address, once=once, position=position)
        case _:
            return CsvTailFeed(address, ScadaReader(address, layout.turbine), once=once)


def _journal(position: FeedPosition) -> MessageJournal | None:
    if position.path is None:
        return None
    return MessageJournal(position.path.with_suffix(".messages"), position, is_description)


def layout_file_of(layout: SensorLayout) -> LayoutFile:
    """A sensor layout as a layout file would write it: the instrument uses its names and units."""
    channels = tuple(
        MappedChannel(
            channel.name,
            channel.elevation,
            channel.direction,
            coupling=channel.coupling,
            corner_frequency=channel.corner_frequency,
            serial=channel.serial,
        )
        for channel in layout.channels
    )
    return LayoutFile(channels, layout.turbine, layout.unit, layout.layout_id)


class MessageCapture:
    """A reader that keeps messages and gives no samples."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, bytes]] = []

    def read(self, topic: str, payload: bytes, *, retained: bool) -> Iterator[Arrival]:
        """Keep a message; one that a broker retained is of another time, and is left out."""
        if not retained:
            self.messages.append((topic, payload))
        return iter(())

    def learn(self, topic: str, payload: bytes) -> None:
        """Nothing is known from before."""


def listed_variables(text: str) -> list[SeenVariable]:
    """Return what an OPC UA server has.

    Raises
    ------
    FeedError
        If the URL is no OPC UA feed's, or the server cannot be reached.
    """
    counts = FeedCounts()
    feed = OpcUaFeed(parsed(text), (), ValueReader(counts, None, "first"), counts, once=True)
    return asyncio.run(feed.variables())


def captured_messages(
    text: str, seconds: float, stopping: threading.Event
) -> list[tuple[str, bytes]]:
    """Topics and payloads of the messages of some seconds, at most MOST_MESSAGES.

    Parameters
    ----------
    text : str
        An MQTT feed's URL.
    seconds : float
        How long to listen [s].
    stopping : threading.Event
        Ends it earlier.

    Raises
    ------
    FeedError
        If the URL is no MQTT feed's, or the broker cannot be reached.
    """
    address = parsed(text)
    if address.scheme != "mqtt":
        raise FeedError(
            f"{text}: --sniff is for mqtt://, mqtts:// and opcua://; others have one format"
        )
    capture = MessageCapture()
    feed = MqttFeed(address, capture, FeedCounts(), once=True)
    deadline = time.monotonic() + seconds
    for _ in batches(feed, stopping):
        if time.monotonic() > deadline or len(capture.messages) >= MOST_MESSAGES:
            break
    return capture.messages[:MOST_MESSAGES]
