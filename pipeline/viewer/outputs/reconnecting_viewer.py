"""Draw on a viewer that may start late, disconnect and come back.

The address is checked every PERIOD. A viewer that connects gets what is remembered (layouts, truth,
the results so far) and from then on everything; accelerations begin at that moment, as earlier ones
are in the recording. When it disconnects, its drawing is closed; the next viewer at that address
gets a new one.

Why a connection of its own: the SDK's sender does not report a lost viewer, and one that is killed
and restarted within seconds would go unnoticed, with an empty window.
"""

import contextlib
import logging
import socket
import time
from collections import deque
from collections.abc import Callable, Iterator
from urllib.parse import urlsplit

from pipeline.messages import FoundationTruth, Message, NodeStatus, StabilisationDiagram
from pipeline.viewer.outputs.drawing_thread import Drawing
from pipeline.viewer.outputs.outputs import DEFAULT_PORT, ViewerError
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout

PERIOD = 2.0  # between two checks for the viewer, by the machine's clock [s]
CHECK_TIMEOUT = 1.0  # for an answer to a check [s]
REMEMBERED_RESULTS = 2000  # results kept for a late viewer: a week of one turbine, some 40 MB
RENEWAL = 10.0  # age at which the probe reconnects: Rerun's server closes idle connections at 30 s
_log = logging.getLogger(__name__)


class ViewerProbe:
    """An idle connection that reveals when a viewer disconnects.

    Raises
    ------
    OSError
        If no viewer answers.
    """

    def __init__(self, url: str) -> None:
        address = urlsplit(url)
        self._address = (address.hostname or "", address.port or DEFAULT_PORT)
        self._open_socket()

    def is_up(self) -> bool:
        """Return whether the viewer has stayed connected since the last check."""
        if not self._is_held():
            return False
        if time.monotonic() - self._since >= RENEWAL:
            old = self._socket
            with contextlib.suppress(OSError):  # too busy to answer: the old connection still holds
                self._open_socket()
                old.close()
        return True

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _open_socket(self) -> None:
        self._socket = socket.create_connection(self._address, timeout=CHECK_TIMEOUT)
        self._socket.setblocking(False)
        self._since = time.monotonic()

    def _is_held(self) -> bool:
        try:
            return bool(self._socket.recv(1))  # nothing at all: it was closed
        except BlockingIOError:
            return True
        except OSError:
            return False


class RememberedResults:
    """What a late viewer gets first; bounded, however long the session."""

    def __init__(self, size: int = REMEMBERED_RESULTS) -> None:
        self._layouts: dict[tuple[str, str], SensorLayout] = {}
        self._truths: dict[str, FoundationTruth] = {}
        self._diagrams: dict[str, StabilisationDiagram] = {}
        self._results: deque[Message] = deque(maxlen=size)

    def keep(self, message: Message) -> None:
        """Remember one message, unless it is a block or a node's status, which recur."""
        match message:
            case AccelerationBlock() | NodeStatus():
                return
            case SensorLayout():
                self._layouts[message.turbine, message.layout_id] = message
            case FoundationTruth():
                self._truths[message.turbine] = message
            case StabilisationDiagram():
                self._diagrams[message.turbine] = message  # the last one; they are large
            case _:
                self._results.append(message)

    def __iter__(self) -> Iterator[Message]:
        """In an order in which they can be drawn."""
        yield from self._layouts.values()
        yield from self._truths.values()
        yield from self._results
        yield from self._diagrams.values()


class ReconnectingViewer:
    """Draw on the viewer at `url` whenever one is connected.

    Parameters
    ----------
    begin : Callable[[], Drawing]
        Opens a drawing there; raises ViewerError where the viewer has just disconnected.
    period : float, optional
        Interval between checks [s]; 0 checks with every message.
    """

    def __init__(
        self, url: str, open_drawing: Callable[[], Drawing], *, period: float = PERIOD
    ) -> None:
        self._url = url
        self._open_drawing = open_drawing
        self._period = period
        self._remembered = RememberedResults()
        self._probe: ViewerProbe | None = None
        self._drawing: Drawing | None = None
        self._checked_at = -float("inf")
        self._check_viewer()
        if self._drawing is None:
            port = urlsplit(url).port or DEFAULT_PORT
            _log.warning(
                "--view connect=%s: no viewer listens there yet; it gets the session when it "
                "connects (rerun --bind 127.0.0.1 --port %d)",
                *(url, port),
            )

    def take(self, message: Message) -> None:
        """Draw one message where a viewer is connected; remember it for the next one."""
        self._check_viewer()
        self._remembered.keep(message)
        if self._drawing is not None:
            self._drawing.take(message)

    def finish(self) -> None:
        """Draw what is buffered and disconnect from a connected viewer."""
        self._checked_at = -float("inf")
        self._check_viewer()
        if self._drawing is not None:
            self._drawing.finish()
        self._close_connection()

    def disconnect(self) -> None:
        """Disconnect without drawing more."""
        if self._drawing is not None:
            self._drawing.disconnect()
        self._close_connection()

    def stop_waiting(self) -> None:
        """Stop waiting for what the viewer has not accepted."""
        if self._drawing is not None:
            self._drawing.stop_waiting()

    def _check_viewer(self) -> None:
        """Detect a viewer that connected or disconnected, where a check is due."""
        if time.monotonic() - self._checked_at < self._period:
            return
        self._checked_at = time.monotonic()
        if self._probe is not None and not self._probe.is_up():
            _log.warning("%s: the viewer has disconnected; the run continues", self._url)
            self.stop_waiting()
            self.disconnect()
        if self._probe is None:
            self._connect()

    def _connect(self) -> None:
        """Open a drawing where a viewer answers, with what it missed."""
        with contextlib.suppress(OSError, ViewerError):
            probe = ViewerProbe(self._url)
            try:
                self._drawing = self._open_drawing()
            except ViewerError:
                probe.close()
                raise
            self._probe = probe
        if self._drawing is not None:
            for message in self._remembered:
                self._drawing.take(message)

    def _close_connection(self) -> None:
        if self._probe is not None:
            self._probe.close()
        self._probe = self._drawing = None
