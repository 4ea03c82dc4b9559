"""Which of a sender's numbered messages never came, came twice, or in another order."""

from enum import Enum

from sensors.bounded_dict import BoundedDict
from sensors.feeds.protocol import FeedCounts

WATCHED = 4096  # newest numbers of which it is known one by one whether they came
FARTHEST_AHEAD = 1_000_000  # a number so far ahead is nonsense, another start or a long cut
CONFIRMED = 3  # numbers on end, so far ahead, of a sender that goes on there


class Place(Enum):
    """Where a message stands among the others of its sender."""

    NEXT = "next"  # directly behind the newest
    AHEAD = "ahead"  # others are missing in between; also the first of all
    BEHIND = "behind"  # one of those that were missing
    DUPLICATE = "duplicate"
    OLD = "old"  # behind what is watched, or of an earlier session


class SequenceMonitor:
    """Counts what is missing of one sender's numbers.

    Parameters
    ----------
    rising : bool, optional
        A session's number is above those before it; an earlier one is OLD. Otherwise any other
        number that was not one of the last few begins a session, and so does a lower number with a
        later time: a sender that does not number its starts has started again.

    Notes
    -----
    A sender counts its messages from any number on, one by one; each of its starts is a session of
    its own. What came before the first message is not missing. Nor is, of numbers far ahead, what
    lies before the one that shows that the sender goes on there: it is not known how many that are.
    """

    def __init__(self, *, rising: bool = False) -> None:
        self.lost = 0  # numbers that have not come, of all sessions
        self._rising = rising
        self._session: int | None = None
        self._earlier: list[int] = []  # sessions, newest last
        self._newest = -1
        self._newest_ns = 0
        self._missing: set[int] = set()
        self._far: list[tuple[int, int]] = []  # numbers on end that are far ahead, their times [ns]

    def place(self, sequence: int, session: int = 0, *, time_ns: int = 0) -> Place:
        """Take note of a message and return where it stands among the others.

        Parameters
        ----------
        sequence : int
            Its number.
        session : int, optional
            Number of the sender's start.
        time_ns : int, optional
            Its own time [ns]; rises with the numbers of a start.
        """
        if session != self._session:
            if self._is_earlier(session):
                return Place.OLD
            self._begin(session, sequence, time_ns)
            return Place.AHEAD
        step = sequence - self._newest
        if step > FARTHEST_AHEAD:
            return self._far_ahead(sequence, session, time_ns)
        self._far.clear()
        if step > 0:
            self._advance(sequence, time_ns)
            return Place.NEXT if step == 1 else Place.AHEAD
        if sequence in self._missing:
            self._missing.discard(sequence)
            self.lost -= 1
            return Place.BEHIND
        if time_ns > self._newest_ns and not self._rising:
            self._begin(session, sequence, time_ns)
            return Place.AHEAD
        return Place.DUPLICATE if -step < WATCHED else Place.OLD

    def _far_ahead(self, sequence: int, session: int, time_ns: int) -> Place:
        """A single one is nonsense; a few, each behind the last, are what the sender sends."""
        if self._far:
            number, then_ns = self._far[-1]
            if not (0 < sequence - number <= WATCHED and time_ns >= then_ns):
                self._far.clear()
        self._far.append((sequence, time_ns))
        if len(self._far) < CONFIRMED or time_ns < self._newest_ns:
            return Place.OLD
        self._begin(session, sequence, time_ns)
        return Place.AHEAD

    def _is_earlier(self, session: int) -> bool:
        if self._session is None:
            return False
        return session < self._session if self._rising else session in self._earlier

    def _begin(self, session: int, sequence: int, time_ns: int) -> None:
        if self._session not in (None, session):
            self._earlier = [*self._earlier[-3:], self._session]
        self._session, self._newest, self._newest_ns = session, sequence, time_ns
        self._missing.clear()
        self._far.clear()

    def _advance(self, sequence: int, time_ns: int) -> None:
        first = self._newest + 1
        self.lost += sequence - first
        self._missing.update(range(max(first, sequence - WATCHED), sequence))
        self._newest, self._newest_ns = sequence, time_ns
        if len(self._missing) > WATCHED:
            self._missing = {each for each in self._missing if sequence - each <= WATCHED}


class SenderNumbers:
    """The numbers of all senders of one feed.

    Parameters
    ----------
    counts : FeedCounts
        Takes what is lost, late or duplicate.
    rising : bool, optional
        See SequenceMonitor.
    """

    def __init__(self, counts: FeedCounts, *, rising: bool = False) -> None:
        self._counts, self._rising = counts, rising
        self._watches: BoundedDict[str, SequenceMonitor] = BoundedDict()

    def follows(self, sender: str, sequence: int, session: int = 0, *, time_ns: int) -> bool | None:
        """Whether a message is directly behind its sender's last; None: it is not to be taken,
        and counted."""
        watch = self._watches.renewed(sender)
        if watch is None:
            watch = SequenceMonitor(rising=self._rising)
            self._watches.put(sender, watch)
        before = watch.lost
        place = watch.place(sequence, session, time_ns=time_ns)
        self._counts.lost += watch.lost - before
        self._counts.duplicate += place is Place.DUPLICATE
        self._counts.late += place is Place.OLD
        return None if place in (Place.DUPLICATE, Place.OLD) else place is Place.NEXT
