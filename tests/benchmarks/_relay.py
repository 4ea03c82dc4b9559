"""A cable between two Zenoh sessions on one machine, which can be cut and mended.

    session ──tcp──► Relay ──tcp──► session that listens

"silent": what is sent goes nowhere and nobody is told, as when a cable is pulled or a radio link
fades. "reset": both ends see their connection closed, as when a modem restarts.
"""

import socket
import threading
from contextlib import suppress
from typing import Literal

Cut = Literal["silent", "reset"]
PIECE = 65536  # [bytes]


class Relay:
    """Forwards every connection to `endpoint` ("tcp/HOST:PORT"); listens at `self.endpoint`."""

    def __init__(self, endpoint: str) -> None:
        host, port = endpoint.removeprefix("tcp/").split(":")
        self._target = (host, int(port))
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.endpoint = f"tcp/127.0.0.1:{self._listening.getsockname()[1]}"
        self._whole = threading.Event()
        self._whole.set()
        self._open: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self, how: Cut) -> None:
        """Nothing comes through until `mend`."""
        self._whole.clear()
        if how == "reset":
            for each in self._open:
                _shut(each)
            self._open.clear()

    def mend(self) -> None:
        """Let everything through again, what was held back by the silence first."""
        self._whole.set()

    def close(self) -> None:
        """Take the cable away."""
        self._listening.close()
        self.mend()
        for each in self._open:
            _shut(each)

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._listening.accept()
                self._whole.wait()
                far = socket.create_connection(self._target)
            except OSError:
                if self._listening.fileno() < 0:
                    return
                continue
            self._open += [near, far]
            for one, other in ((near, far), (far, near)):
                threading.Thread(target=self._pump, args=(one, other), daemon=True).start()

    def _pump(self, one: socket.socket, other: socket.socket) -> None:
        try:
            while self._whole.wait() and (data := one.recv(PIECE)):
                self._whole.wait()
                other.sendall(data)
        except OSError:
            pass
        _shut(one)
        _shut(other)


def _shut(connection: socket.socket) -> None:
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
    connection.close()
