"""The updating node: each modal estimate refreshes the foundation's posterior."""

from collections.abc import Callable, Iterable, Mapping

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    QualityWarning,
    WindowRejected,
)
from pipeline.nodes.by_turbine import MOST_TURBINES, LimitedMembers, told_of_gone
from pipeline.nodes.nacelle_axes import in_nacelle_axes
from pipeline.nodes.node import Node
from pipeline.nodes.operating_state import OperationSettings, refusal_by_operation
from pipeline.updating.state import UpdatingState
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import SensorLayout


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


class UpdatingInContext:
    """The updating, one updater a turbine, fed with windows of the allowed states alone.

    make      → the updating node of one more turbine
    layout    of the sensors, whose axes the model's shapes are read along
    settings  which states are allowed
    special   turbines of a farm: how the updating node of each is made, and its own layout
    """

    name = "updating"
    inputs: tuple[type, ...] = (ModalEstimate,)

    def __init__(
        self,
        make: Callable[[], Node],
        layout: SensorLayout,
        settings: OperationSettings | None = None,
        *,
        special: Mapping[str, tuple[Callable[[], Node], SensorLayout]] | None = None,
    ) -> None:
        self._make = make
        self._layout = layout
        self._settings = settings or OperationSettings()
        self._special = dict(special or {})
        self._spare: Node | None = make()  # made before the first window waits for it
        self._updaters: dict[str, Node] = {}
        self._turbines = LimitedMembers(MOST_TURBINES)

    def handle(self, message: Message) -> Iterable[Message]:
        if not isinstance(message, ModalEstimate):
            return ()
        refused = refusal_by_operation(message, self._settings)
        if refused is not None:
            return (refused,)
        leaving = self._turbines.heard(message.turbine)
        if leaving is not None:
            self._updaters.pop(leaving).close()
        make, layout = self._special.get(message.turbine, (self._made, self._layout))
        if message.turbine not in self._updaters:
            self._updaters[message.turbine] = make()
        return self._updaters[message.turbine].handle(in_nacelle_axes(message, layout))

    def _made(self) -> Node:
        """An updater of a turbine like most; the first was made before it was needed."""
        spare, self._spare = self._spare, None
        return spare or self._make()

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """What the updaters say in the node's status."""
        updaters = self._updaters.values()
        told = tuple(doubt for each in updaters for doubt in getattr(each, "warnings", ()))
        return told + told_of_gone(self._turbines.gone, f"{MOST_TURBINES} turbines")

    def close(self) -> None:
        for updater in self._updaters.values():
            updater.close()
