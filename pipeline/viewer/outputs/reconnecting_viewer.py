"""ReconnectingViewer: a show on a viewer that may come late, go, and come back.

The viewer is looked for every PERIOD. When it comes it gets what is remembered (layouts, truth, the
results so far) and from then on everything; accelerations begin at that moment, as their past is in
the recording. When it goes, the show is let go of, and the next viewer at that address gets a new
one.

Why a line of its own: the SDK's sender says nothing of a viewer that has gone, and a viewer that
is killed and back within seconds would pass for one that never left, with an empty screen.
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

PERIOD = 2.0  # between two looks for the viewer, by the machine's clock [s]
PATIENCE = 1.0  # for it to answer a look [s]
REMEMBERED = 2000  # results kept for a late viewer: a week of one turbine, some 40 MB
RENEWAL = 10.0  # age at which a line is replaced: Rerun's server hangs up on a silent one at 30 s
_log = logging.getLogger(__name__)


class ViewerLine:
    """A silent connection, to notice when a viewer goes. Raises OSError where none answers."""

    def __init__(self, url: str) -> None:
        address = urlsplit(url)
        self._place = (address.hostname or "", address.port or DEFAULT_PORT)
        self._dial()

    def is_up(self) -> bool:
        """Whether the viewer has held its end since the last look."""
        if not self._is_held():
            return False
        if time.monotonic() - self._since >= RENEWAL:
            old = self._socket
            with contextlib.suppress(OSError):  # too busy to answer: the old line still stands
                self._dial()
                old.close()
        return True

    def close(self) -> None:
        """Hang up."""
        self._socket.close()

    def _dial(self) -> None:
        self._socket = socket.create_connection(self._place, timeout=PATIENCE)
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
    """What a late viewer is told first; bounded, however long the session."""

    def __init__(self, size: int = REMEMBERED) -> None:
        self._layouts: dict[tuple[str, str], SensorLayout] = {}
        self._truths: dict[str, FoundationTruth] = {}
        self._diagrams: dict[str, StabilisationDiagram] = {}
        self._results: deque[Message] = deque(maxlen=size)

    def keep(self, message: Message) -> None:
        """Remember one message, unless it is a block or a node's status, which come anew."""
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
    """Draws on the viewer at `url` whenever there is one.

    begin    opens a show there; raises ViewerError where the viewer has just gone
    period   between two looks [s]; 0 looks with every message
    """

    def __init__(self, url: str, begin: Callable[[], Drawing], *, period: float = PERIOD) -> None:
        self._url = url
        self._begin = begin
        self._period = period
        self._past = RememberedResults()
        self._line: ViewerLine | None = None
        self._show: Drawing | None = None
        self._looked = -float("inf")
        self._look()
        if self._show is None:
            port = urlsplit(url).port or DEFAULT_PORT
            _log.warning(
                "--view connect=%s: no viewer listens there yet; it gets the session when it "
                "comes (rerun --bind 127.0.0.1 --port %d)",
                *(url, port),
            )

    def take(self, message: Message) -> None:
        """Draw one message where there is a viewer; remember it for the next one."""
        self._look()
        self._past.keep(message)
        if self._show is not None:
            self._show.take(message)

    def finish(self) -> None:
        """Hand over what waits and let go, of a viewer that is there."""
        self._looked = -float("inf")
        self._look()
        if self._show is not None:
            self._show.finish()
        self._hang_up()

    def abandon(self) -> None:
        """Let go without drawing more."""
        if self._show is not None:
            self._show.abandon()
        self._hang_up()

    def leave_behind(self) -> None:
        """Let nobody wait for what the viewer has not taken."""
        if self._show is not None:
            self._show.leave_behind()

    def _look(self) -> None:
        """Notice a viewer that went or came, where it is time to look."""
        if time.monotonic() - self._looked < self._period:
            return
        self._looked = time.monotonic()
        if self._line is not None and not self._line.is_up():
            _log.warning("%s: the viewer has gone; the session goes on", self._url)
            self.leave_behind()
            self.abandon()
        if self._line is None:
            self._greet()

    def _greet(self) -> None:
        """Begin a show where a viewer answers, with what it missed."""
        with contextlib.suppress(OSError, ViewerError):
            line = ViewerLine(self._url)
            try:
                self._show = self._begin()
            except ViewerError:
                line.close()
                raise
            self._line = line
        if self._show is not None:
            for message in self._past:
                self._show.take(message)

    def _hang_up(self) -> None:
        if self._line is not None:
            self._line.close()
        self._line = self._show = None
