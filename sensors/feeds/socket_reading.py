"""Reads the socket of an MQTT link no faster than its messages are taken (aiomqtt)."""

import asyncio
import errno
from collections.abc import Iterator
from typing import Any

WAITING_MESSAGES = 1000  # between the socket and the inbox; then the socket is not read


class SocketReading:
    """Leaves messages with the broker while too many wait: aiomqtt would drop or gather them.

    Parameters
    ----------
    connection : aiomqtt.Client
        That is not connected yet.

    Notes
    -----
    It reaches into aiomqtt, hence the narrow version range in pyproject.toml.
    """

    def __init__(self, connection: Any) -> None:
        self._connection, self._paho = connection, connection._client
        self._queue = connection._queue
        self._is_held = False
        handle = self._paho.on_message

        def held_after(*arguments: Any) -> None:
            handle(*arguments)
            self._hold_if_many_wait()

        self._paho.on_message = held_after

    def go_on_if_few_wait(self) -> None:
        """Read the socket again once half of what waited is taken."""
        socket_ = self._paho.socket()
        if self._is_held and socket_ is not None and self._queue.qsize() <= WAITING_MESSAGES // 2:
            self._is_held = False
            asyncio.get_running_loop().add_reader(socket_.fileno(), self._read)
            self._read()  # what TLS has decrypted already wakes no reader

    def waiting(self) -> Iterator[Any]:
        """Take what waits."""
        while not self._queue.empty():
            yield self._queue.get_nowait()

    def _hold_if_many_wait(self) -> None:
        if not self._is_held and self._queue.qsize() >= WAITING_MESSAGES:
            self._is_held = True
            asyncio.get_running_loop().remove_reader(self._paho.socket().fileno())

    def _read(self) -> None:
        """As aiomqtt reads."""
        try:
            self._paho.loop_read()
            while not self._is_held and getattr(self._paho.socket(), "pending", int)() > 0:
                self._paho.loop_read()
        except Exception as error:  # noqa: BLE001 - as aiomqtt has it: whatever broke, the link did
            if not self._connection._disconnected.done():
                self._connection._disconnected.set_exception(error)


def pass_over_closed_socket(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Handle what a callback of the loop raised: aiomqtt connects in a thread and has the loop
    watch the socket afterwards, when a broker may have ended the link, which is reported as such.
    """
    error = context.get("exception")
    if not (isinstance(error, OSError) and error.errno == errno.EBADF):
        loop.default_exception_handler(context)
