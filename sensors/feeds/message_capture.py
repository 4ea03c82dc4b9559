"""Messages as they come, unread: what `pilewatch feed … --sniff` looks at."""

import threading
import time
from collections.abc import Iterator

from sensors.feeds.address import parsed
from sensors.feeds.live import batches
from sensors.feeds.mqtt import MqttFeed
from sensors.feeds.protocol import Arrival, FeedCounts, FeedError

MOST_MESSAGES = 2000


class MessageCapture:
    """A reader that keeps messages and gives no samples."""

    def __init__(self) -> None:
        self.messages: list[tuple[str, bytes]] = []

    def read(self, topic: str, payload: bytes, *, retained: bool) -> Iterator[Arrival]:
        """Keep a message; one that a broker retained is of another time, and is left out."""
        if not retained:
            self.messages.append((topic, payload))
        return iter(())


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
        raise FeedError(f"{text}: --sniff is for mqtt:// and mqtts://; others have one format")
    capture = MessageCapture()
    feed = MqttFeed(address, capture, FeedCounts(), once=True)
    deadline = time.monotonic() + seconds
    for _ in batches(feed, stopping):
        if time.monotonic() > deadline or len(capture.messages) >= MOST_MESSAGES:
            break
    return capture.messages[:MOST_MESSAGES]
