"""Frames of some senders → samples, with their numbers watched."""

from sensors.feeds.payloads.frame import ForgedFrame, FrameError, decoded
from sensors.feeds.payloads.sequence_numbers import SenderNumbers
from sensors.feeds.protocol import ChannelSamples, FeedCounts


class FrameReader:
    """Reads the frames of one feed.

    Parameters
    ----------
    names : tuple of str
        Of the layout's channels, for frames that name none.
    counts : FeedCounts
        Takes what is lost, late, duplicate, malformed or forged.
    key : bytes, optional
        Shared with the senders; b"" where there is none.
    """

    def __init__(self, names: tuple[str, ...], counts: FeedCounts, key: bytes = b"") -> None:
        self._names, self._counts, self._key = names, counts, key
        self._numbers = SenderNumbers(counts, rising=bool(key))

    def read(self, payload: bytes, sender: str) -> ChannelSamples | None:
        """The samples of a frame; None for one that is dropped and counted.

        Parameters
        ----------
        payload : bytes
            The frame as it came.
        sender : str
            Where it came: a topic; "" where the channels' names distinguish the senders.
        """
        self._counts.received += 1
        try:
            frame = decoded(payload, self._key)
        except ForgedFrame as error:
            self._counts.refuse_forged(str(error))
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
        follows = self._numbers.follows(
            stream, frame.sequence, frame.session, time_ns=frame.start_ns
        )
        if follows is None:
            return None
        return ChannelSamples(
            stream,
            names,
            frame.samples,
            frame.start_ns,
            frame.sampling_rate,
            follows=follows,
            status=frame.status,
        )

    def drop(self) -> None:
        """Count a frame that was read and cannot be taken in."""
        self._counts.lost += 1
