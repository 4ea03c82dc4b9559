"""Which topic or sender a channel comes from: two instruments of one name are never mixed."""

from dataclasses import dataclass

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.protocol import ChannelSamples

# A channel is another stream's from now on after so many of its messages, over so long, without one
# of the owner between them. An owner of fewer messages may be a stray one: more of them suffice.
HANDED_OVER = 10
HANDED_OVER_TIME = 30.0  # [s]


@dataclass(slots=True)
class _Owner:
    stream: str
    given: int = 0  # its messages
    rival: str = ""  # another stream that gives the channel
    count: int = 0  # the rival's messages since the owner's last
    since_ns: int = 0  # when they began [ns]

    def note_message(self) -> None:
        """Take note of a message of the owner."""
        self.given, self.count = self.given + 1, 0

    def keeps(self, piece: ChannelSamples) -> bool:
        """Whether a channel is still the owner's, now that another stream gives it."""
        if piece.stream != self.rival or not self.count:
            self.rival, self.count, self.since_ns = piece.stream, 0, piece.start_ns
        self.count += 1
        if self.given < HANDED_OVER:
            keeps = self.count <= self.given
        else:
            lasted = (piece.start_ns - self.since_ns) / NANOSECONDS
            keeps = self.count < HANDED_OVER or lasted < HANDED_OVER_TIME
        if not keeps:
            self.stream, self.given, self.count = piece.stream, self.count, 0
        return keeps


class ChannelSources:
    """The owners of the channels of one unit.

    A channel is of the stream that gave it first. Another stream that gives it is of another
    instrument (`farm/t2` where the topic is `farm/+`), unless the owner has fallen silent: then it
    has another name now.
    """

    def __init__(self) -> None:
        self._owners: dict[str, _Owner] = {}  # by channel that the layout lists

    def refusal(self, piece: ChannelSamples) -> str:
        """Return why a piece of listed channels is not to be taken; "" where it is."""
        reason = ""
        for name in piece.names:
            owner = self._owners.setdefault(name, _Owner(piece.stream))
            if owner.stream == piece.stream:
                owner.note_message()
            elif owner.keeps(piece):
                reason = (
                    f"{piece.stream} gives {name!r} while {owner.stream} does: a feed is one unit, "
                    "so its address must name one of them"
                )
        return reason
