"""The updating node: each modal estimate refreshes the foundation's posterior."""

from collections.abc import Iterable

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    WindowRejected,
)
from pipeline.updating.state import UpdatingState
from pipeline.updating.updater import FoundationUpdater


class FoundationUpdaterNode:
    """Refreshes the foundation-stiffness posterior with each accepted modal estimate."""

    name = "updating"
    inputs: tuple[type, ...] = (ModalEstimate,)

    def __init__(self, updater: FoundationUpdater, state: UpdatingState | None = None) -> None:
        """state: what an earlier session ended with; None to begin with nothing seen."""
        self._updater = updater
        self._state = state or updater.initial_state()

    @property
    def state(self) -> UpdatingState:
        """What the node remembers, O(1) in the number of windows."""
        return self._state

    def checkpoint(self) -> bytes:
        """The state as a small file's bytes; `FoundationUpdater.restored` reads them."""
        return self._updater.saved(self._state)

    def handle(
        self, message: Message
    ) -> Iterable[FoundationEvent | FoundationPosterior | WindowRejected]:
        """The posterior after a ModalEstimate, before it the event where the structure has
        changed; or why the estimate could not be used."""
        if isinstance(message, ModalEstimate):
            self._state, answers = self._updater.watched(self._state, message)
            return answers
        return ()

    def close(self) -> None:
        """Nothing is held."""
