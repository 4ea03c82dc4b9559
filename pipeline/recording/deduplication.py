"""Which messages have been recorded already, so that none is recorded twice.

A recorder that is started again gets from every publisher what it still keeps, most of which the
recorder before it has written:

    recorded   ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒┐ kill
    cache                 ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒ ─► goes on live
    new                                     ▒▒▒▒▒▒

A node that takes up a checkpoint publishes its latest messages again, and an untrusted sender may
replay what it has received. A message is the same where every byte of it is.
"""

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path

from pipeline.recording.latest_messages import payloads_backwards

MOST_KNOWN_MESSAGES = 2**20  # messages of all keys: what 800 turbines' publishers keep; some 100 MB
READ_BACK = 2**18  # messages: of 200 turbines twenty minutes, more than publishers keep


class Repetition:
    """Knows again what was recorded: as much of each key as its publisher may send once more.

    recorded   payloads of the recorder before; see `latest_payloads`
    """

    def __init__(self, recorded: Iterable[bytes] = ()) -> None:
        # Python's own hash: 64 bits, with a key that no sender can know
        self._earlier = frozenset(hash(payload) for payload in recorded)
        self._latest: dict[str, deque[int]] = {}  # by key
        self._known: set[int] = set()

    def is_known(self, key: str, payload: bytes, *, kept: int) -> bool:
        """Whether these bytes have been recorded; from now on they are known.

        kept   how many messages of this key are known again
        """
        number = hash(payload)
        if number in self._known or number in self._earlier:
            return True
        latest = self._latest.pop(key, None) or deque()
        self._latest[key] = latest  # the key that was silent longest comes first
        latest.append(number)
        self._known.add(number)
        if len(latest) > kept:
            self._known.discard(latest.popleft())
        if len(self._known) > MOST_KNOWN_MESSAGES:
            self._forget_one()
        return False

    def _forget_one(self) -> None:
        """The oldest of the key that was silent longest."""
        silent = next(iter(self._latest))
        self._known.discard(self._latest[silent].popleft())
        if not self._latest[silent]:
            del self._latest[silent]


def latest_payloads(files: Sequence[Path], count: int = READ_BACK) -> Iterator[bytes]:
    """The last so many messages of recordings in order of recording, as they were sent.

    files   in order of recording; read from the end, and no further than needed
    """
    backwards = (payload for file in reversed(files) for payload in payloads_backwards(file))
    return reversed(list(islice(backwards, count)))
