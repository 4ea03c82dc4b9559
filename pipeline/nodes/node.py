"""What a node is: a name, the messages it takes, and what it answers."""

from collections.abc import Iterable
from typing import Protocol

from pipeline.messages import Message


class Node(Protocol):
    """One step of the flow. A pure node has no I/O, reads no clock and prints nothing; a sink
    (recorder, viewer) has the same face and answers with nothing.

    An expected failure is a message (WindowRejected); an exception means that somebody must act.
    """

    @property
    def name(self) -> str:
        """Unique in a session: "identification", "updating", "recorder", …"""
        ...

    @property
    def inputs(self) -> tuple[type, ...]:
        """Message types that it takes."""
        ...

    def handle(self, message: Message) -> Iterable[Message]:
        """Take one message, give what follows from it, in order."""
        ...

    def close(self) -> None:
        """Let go of what the node holds; called once, at the end."""
        ...
