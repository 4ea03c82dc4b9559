"""Frames of some senders → samples, with their numbers watched."""

from sensors.feeds.feed import ChannelSamples, FeedCounts
from sensors.feeds.frame import ForgedFrame, FrameError, decoded
from sensors.feeds.sequences import Place, SequenceWatch

MOST_SENDERS = 1000  # whose numbers are watched; more are nonsense


class FrameReader:
    """Reads the frames of one feed.

    names    of the layout's channels, for frames that name none
    counts   takes what is lost, late, duplicate, malformed or forged
    key      shared with the senders; b"" where there is none
    """

    def __init__(self, names: tuple[str, ...], counts: FeedCounts, key: bytes = b"") -> None:
        self._names, self._counts, self._key = names, counts, key
        self._watches: dict[str, SequenceWatch] = {}

    def read(self, payload: bytes, sender: str) -> ChannelSamples | None:
        """The samples of a frame; None for one that is dropped and counted.

        sender   where it came: a topic; "" where the channels' names tell the senders apart
        """
        self._counts.received += 1
        try:
            frame = decoded(payload, self._key)
        except ForgedFrame as error:
            self._counts.forged += 1
            self._counts.refusal = str(error)
            return None
        except FrameError as error:
            self._counts.refuse(f"{sender or 'a frame'}: {error}")
            return None
        names = frame.names or self._names
        if len(names) != frame.samples.shape[1]:
            self._counts.refuse(
                f"{sender or 'a frame'}: {frame.samples.shape[1]} channels without names; the "
                f"layout has {len(names)}"
            )
            return None
        stream = sender or ",".join(names)
        place = self._place(stream, frame.sequence, frame.session, frame.start_ns)
        if place in (Place.DUPLICATE, Place.OLD):
            return None
        return ChannelSamples(
            stream,
            names,
            frame.samples,
            frame.start_ns,
            frame.sampling_rate,
            follows=place is Place.NEXT,
            status=frame.status,
        )

    def drop(self) -> None:
        """Count a frame that was read and cannot be taken in."""
        self._counts.lost += 1

    def _place(self, stream: str, sequence: int, session: int, time_ns: int) -> Place:
        if stream not in self._watches and len(self._watches) >= MOST_SENDERS:
            self._counts.refuse(f"{stream}: more than {MOST_SENDERS} senders")
            return Place.OLD
        watch = self._watches.setdefault(stream, SequenceWatch(rising=bool(self._key)))
        before = watch.lost
        place = watch.place(sequence, session, time_ns=time_ns)
        self._counts.lost += watch.lost - before
        self._counts.duplicate += place is Place.DUPLICATE
        self._counts.late += place is Place.OLD
        return place
