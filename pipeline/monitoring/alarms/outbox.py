"""What is to go out waits on disk, and a thread a channel sends it, oldest first.

    FOLDER/webhook-1/000000000017.json      one telling a file; gone when it was taken

While the outside is away a channel tries again after 1, 2, 4 … seconds, at most every five
minutes. So nothing is lost by a restart or a cut, up to a bound: beyond `MOST_WAITING` the oldest
go, and are counted.
"""

import json
import logging
import threading
from pathlib import Path
from typing import Any

from pipeline.monitoring.alarms.channels import Channel, DeliveryFailed
from pipeline.recording.atomic_write import written_whole

logger = logging.getLogger(__name__)

MOST_WAITING = 1000  # tellings of one channel
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 300.0  # between attempts [s]


class Outbox:
    """The tellings of one channel that wait. One thread puts, another takes."""

    def __init__(self, folder: Path, most: int = MOST_WAITING) -> None:
        self._folder = folder
        self._most = most
        folder.mkdir(parents=True, exist_ok=True)
        self._next = max((int(path.stem) for path in self.waiting()), default=0) + 1
        self.dropped = 0  # that were too many

    def waiting(self) -> list[Path]:
        """Files of tellings, oldest first."""
        return sorted(path for path in self._folder.glob("*.json") if path.stem.isdecimal())

    def put(self, telling: dict[str, Any]) -> None:
        """Keep a telling until it is sent. Raises OSError where the disk refuses."""
        path = self._folder / f"{self._next:012d}.json"
        content = json.dumps(telling | {"serial": self._next}, ensure_ascii=False)
        self._next += 1
        written_whole(path, content.encode())
        waiting = self.waiting()
        for oldest in waiting[: max(0, len(waiting) - self._most)]:
            oldest.unlink(missing_ok=True)
            self.dropped += 1


class Delivery(threading.Thread):
    """Sends what waits in one channel's outbox until it is told to stop.

    pause   before the second attempt; each further one waits twice as long [s]
    """

    def __init__(self, channel: Channel, outbox: Outbox, pause: float = FIRST_PAUSE) -> None:
        self._pause = pause
        super().__init__(name=f"notices-{channel.name}", daemon=True)
        self._channel = channel
        self._outbox = outbox
        self._stopping = threading.Event()
        self._woken = threading.Event()
        self.sent = 0
        self.problem = ""  # why the last attempt failed; "" where it did not

    def wake(self) -> None:
        """Something new waits."""
        self._woken.set()

    def stop(self, patience: float) -> None:
        """Send what waits, if it goes at once; what does not stays on disk. patience [s]"""
        self._stopping.set()
        self._woken.set()
        self.join(patience)

    def run(self) -> None:
        pause = self._pause
        while True:
            self._woken.clear()
            for path in self._outbox.waiting():
                if not self._sent(path):
                    break
                pause = self._pause
            if self._stopping.is_set():
                return
            if self.problem:
                self._stopping.wait(pause)
                pause = min(2 * pause, LONGEST_PAUSE)
            else:
                self._woken.wait()

    def _sent(self, path: Path) -> bool:
        """Whether the telling of a file has gone out, or was none."""
        try:
            telling = json.loads(path.read_bytes())
        except FileNotFoundError:
            return True  # one too many, dropped meanwhile
        except ValueError:
            logger.warning("%s is no telling; it is left out", path)
            path.unlink(missing_ok=True)
            return True
        try:
            self._channel.send(telling)
        except DeliveryFailed as failure:
            if not self.problem:
                logger.warning("a notice waits in %s: %s", path.parent, failure)
            self.problem = str(failure)
            return False
        path.unlink(missing_ok=True)
        self.sent, self.problem = self.sent + 1, ""
        return True
