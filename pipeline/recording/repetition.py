"""Which messages have been recorded already, so that none is recorded twice.

A recorder that is started again gets from every publisher what it still keeps, most of which the
recorder before it has written:

    recorded   ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒┐ kill
    cache                 ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒ ─► goes on live
    new                                     ▒▒▒▒▒▒

A node that takes up a checkpoint says its latest words again, and a stranger may replay what it
has overheard. A message is the same where every byte of it is.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path

from pipeline.recording.recent import payloads_backwards

REMEMBERED = 2**18  # messages: of 200 turbines twenty minutes, more than publishers keep


class Repetition:
    """Knows the latest messages again.

    recorded    payloads, the newest last; see `latest_payloads`
    remembered  how many are known again; 80 bytes each
    """

    def __init__(self, recorded: Iterable[bytes] = (), *, remembered: int = REMEMBERED) -> None:
        # Python's own hash: 64 bits, with a key that no stranger can know
        self._latest = deque((hash(payload) for payload in recorded), maxlen=remembered)
        self._known = set(self._latest)

    def is_known(self, payload: bytes) -> bool:
        """Whether these bytes have been recorded; from now on they are known."""
        number = hash(payload)
        if number in self._known:
            return True
        if len(self._latest) == self._latest.maxlen:
            self._known.discard(self._latest[0])
        self._latest.append(number)
        self._known.add(number)
        return False


def latest_payloads(files: Sequence[Path], count: int = REMEMBERED) -> Iterator[bytes]:
    """The last so many messages of recordings in order of recording, as they were sent.

    files   in order of recording; read from the end, and no further than needed
    """
    backwards = (payload for file in reversed(files) for payload in payloads_backwards(file))
    return reversed(list(islice(backwards, count)))
