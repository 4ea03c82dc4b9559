"""UDP: frames of samples (`frame.py`), one a datagram.

    udp://:5005          on this machine only
    udp://0.0.0.0:5005   from everywhere; then a key belongs to it

With a key (environment PILEWATCH_FEED_KEY, or ?key-file=FILE) a frame without its signature is
dropped and counted, and so is one that was sent before and is sent again. UDP does not report what
it loses; the frames' numbers do.
"""

import asyncio
import logging
import socket
from dataclasses import replace

from sensors.bounded_dict import BoundedDict
from sensors.constants import LOOPBACK
from sensors.feeds.address import FeedAddress
from sensors.feeds.payloads.frame_reader import FrameReader
from sensors.feeds.protocol import ArrivalQueue, FeedCounts, FeedError

logger = logging.getLogger(__name__)

RECEIVE_BUFFER = 4 * 2**20  # asked of the system for datagrams that wait [bytes]


class UdpFeed:
    """Frames that come to one UDP port.

    Parameters
    ----------
    address : FeedAddress
        Where it listens.
    names : tuple of str
        Of the layout's channels, for frames that name none.
    """

    def __init__(self, address: FeedAddress, names: tuple[str, ...]) -> None:
        self.name = address.text
        self.counts = FeedCounts()
        self._reader = FrameReader(names, self.counts, address.secret("key").encode())
        self._place = (address.host or LOOPBACK, address.port)
        self.bound = asyncio.Event()  # set when the port is open
        self.port = address.port  # that is listened on; another one where 0 was asked for

    async def run(self, inbox: ArrivalQueue) -> None:
        """Raises FeedError where the port cannot be had."""
        link = await self._bind(inbox)
        try:
            self.port = link.get_extra_info("sockname")[1]
            self.counts.connect()
            self.bound.set()
            await asyncio.Event().wait()  # until it is cancelled
        finally:
            link.close()
            self.counts.connected = False

    async def _bind(self, inbox: ArrivalQueue) -> asyncio.DatagramTransport:
        loop = asyncio.get_running_loop()
        try:
            link, _ = await loop.create_datagram_endpoint(
                lambda: _Receiver(self._reader, inbox), local_addr=self._place
            )
        except OSError as error:
            host, port = self._place
            raise FeedError(
                f"{self.name}: UDP port {port} of {host} cannot be listened on: {error.strerror}"
            ) from error
        raw: socket.socket = link.get_extra_info("socket")
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER)
        return link


class _Receiver(asyncio.DatagramProtocol):
    def __init__(self, reader: FrameReader, inbox: ArrivalQueue) -> None:
        self._reader, self._inbox = reader, inbox
        self._dropped: BoundedDict[str, bool] = BoundedDict()  # streams whose last frame was

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        piece = self._reader.read(data, "")
        if piece is None:
            return
        if self._inbox.full():  # what was not read is lost, and the numbers do not show it
            self._reader.drop()
            self._dropped.put(piece.stream, True)
            return
        if self._dropped.pop(piece.stream, False):
            piece = replace(piece, follows=None)  # it lies behind a gap
        self._inbox.put_nowait(piece)

    def error_received(self, exc: Exception) -> None:
        logger.debug("UDP: %s", exc)
