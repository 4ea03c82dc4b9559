"""The updating, one updater a turbine, fed with windows of the allowed states alone.

    ModalEstimate ──► state allowed? ── no ──► WindowRejected
                          │ yes, its shapes turned to the nacelle's axes
                          ▼
                      [updating] ──► FoundationPosterior

The ordinary node in a coat: it keeps its name and takes what that takes.
"""

from collections.abc import Callable, Iterable, Mapping

from pipeline.messages import (
    Message,
    ModalEstimate,
    Warning,  # noqa: A004  # the field's word
)
from pipeline.nodes.nacelle_axes import in_nacelle_axes
from pipeline.nodes.node import Node
from pipeline.nodes.operation import OperationSettings, refusal_by_operation
from pipeline.nodes.roster import MOST_TURBINES, Roster, told_of_gone
from sensors.acquisition.layout import SensorLayout


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
        self._turbines = Roster(MOST_TURBINES)

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
    def warnings(self) -> tuple[Warning, ...]:
        """What the updaters say in the node's status."""
        updaters = self._updaters.values()
        told = tuple(doubt for each in updaters for doubt in getattr(each, "warnings", ()))
        return told + told_of_gone(self._turbines.gone, f"{MOST_TURBINES} turbines")

    def close(self) -> None:
        for updater in self._updaters.values():
            updater.close()
