"""Updating: each modal estimate refreshes its turbine's posterior, once."""

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

from pipeline.messages import (
    FoundationEvent,
    Message,
    ModalEstimate,
    QualityWarning,
    UnitOrigin,
    WindowRejected,
    rejected_estimate,
)
from pipeline.nodes.by_turbine import NodeByTurbine, SnapshotStore
from pipeline.nodes.node import NodeSnapshot, NodeStatistics
from pipeline.nodes.operating_state import (
    Answer,
    OperationSettings,
    at_its_channels,
    usable_estimate,
)
from pipeline.updating.state import UpdatingState
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import SensorLayout
from sensors.bounded_dict import BoundedDict

logger = logging.getLogger(__name__)

LATEST_ANSWERS = 10  # answers that are given again when their estimates come again
MOST_BOOTS = 256  # sets of units' boots whose last window is remembered
MOST_LAYOUTS = 1000  # of turbines of which no estimate has come
MOST_DIFFERENT = 16  # units whose layout differs from the scenario's that are reported

_READ_AT = attrgetter("elevation", "direction", "coupling")  # what of a channel the model needs

Boots = tuple[tuple[str, str, int], ...]  # unit, session and number of each unit's boot


class AnsweredWindows:
    """Which windows have been answered, by where they begin in their units' own counts.

    Windows of the same boots come in order, so that the last one of each says it of all.
    """

    def __init__(self) -> None:
        self._last = BoundedDict[Boots, int](MOST_BOOTS)
        """First sample of the last window, in the first unit."""
        self._without_origins: set[int] = set()  # ends of windows of older recordings [ns]

    def __contains__(self, estimate: ModalEstimate) -> bool:
        """Whether a window has been answered."""
        if not estimate.origins:
            return estimate.end_ns in self._without_origins
        boots, first = _key(estimate.origins)
        return first <= self._last.get(boots, -1)

    def add(self, estimate: ModalEstimate) -> None:
        """Remember a window as answered."""
        if not estimate.origins:
            self._without_origins.add(estimate.end_ns)
            if len(self._without_origins) > 2 * MOST_BOOTS:
                self._without_origins.discard(min(self._without_origins))
            return
        boots, first = _key(estimate.origins)
        self._last[boots] = max(first, self._last.pop(boots, -1))

    def state(self) -> dict[str, Any]:
        """Return the answered windows as JSON can hold them."""
        return {
            "last": list(self._last.items()),
            "without_origins": sorted(self._without_origins),
        }

    def resume(self, state: dict[str, Any]) -> None:
        """Go on from what `state` gave."""
        self._without_origins = set(state["without_origins"])
        for boots, first in state["last"]:
            self._last[tuple((unit, session, number) for unit, session, number in boots)] = first


def _key(origins: Sequence[UnitOrigin]) -> tuple[Boots, int]:
    return tuple((o.unit, o.session, o.boot) for o in origins), origins[0].first_sample


class TurbineUpdating:
    """Refreshes one turbine's posterior with each accepted modal estimate.

    Parameters
    ----------
    updater : FoundationUpdater
        The mathematics.
    layout : SensorLayout, optional
        Of the sensors, along whose axes the model's shapes are read; None: as the estimates say.
    settings : OperationSettings, optional
        Which windows may update the foundation.
    """

    def __init__(
        self,
        updater: FoundationUpdater,
        layout: SensorLayout | None = None,
        settings: OperationSettings | None = None,
    ) -> None:
        self.revision = 0
        self._updater = updater
        self._layout = layout
        self._settings = settings or OperationSettings()
        self._state = updater.initial_state()
        self._answered = AnsweredWindows()
        self._answers: tuple[Answer, ...] = ()  # the latest
        # unit → that its layout is another one; of names that are made up the latest
        self._different = BoundedDict[str, QualityWarning](MOST_DIFFERENT)

    @property
    def state(self) -> UpdatingState:
        """What the node remembers, O(1) in the number of windows."""
        return self._state

    def handle(self, message: Message) -> Sequence[Answer]:
        """Return the posterior after a ModalEstimate, before it the event where the structure has
        changed; or why the estimate could not be used. One that comes again gets the answers that
        it got, if they are among the latest."""
        if isinstance(message, SensorLayout):
            self._compare(message)
        if not isinstance(message, ModalEstimate):
            return ()
        if message in self._answered:
            return tuple(each for each in self._answers if _is_of(each, message))
        answers = tuple(_identified(each, message) for each in self._answers_to(message))
        self._answers = (*self._answers, *answers)[-LATEST_ANSWERS:]
        self._answered.add(message)
        self.revision += 1
        return answers

    def _answers_to(self, estimate: ModalEstimate) -> Iterable[Answer]:
        usable = usable_estimate(estimate, self._settings, self._layout)
        if isinstance(usable, WindowRejected):
            return (usable,)
        try:
            self._state, answers = self._updater.watched(self._state, usable)
            channels = self._state.evidence.channels
            answers = tuple(at_its_channels(each, estimate, channels) for each in answers)
        except Exception as error:  # else it would end every refresh to come, at each start again
            logger.exception("window %d of %s", estimate.window, estimate.turbine)
            reason = f"the updating failed: {error!r}; the log has where"
            return (rejected_estimate(estimate, "failed", reason),)
        return answers

    def _compare(self, live: SensorLayout) -> None:
        """Note how a unit's own layout differs from the one that the model is read at."""
        if self._layout is None:
            return
        described = {channel.name: channel for channel in self._layout.channels}
        different = [
            channel.name
            for channel in live.channels
            for name in (channel.name, f"{live.unit}/{channel.name}")
            if name in described and _READ_AT(channel) != _READ_AT(described[name])
        ]
        self._different.pop(live.unit, None)
        if different:
            self._different[live.unit] = QualityWarning(
                "layout-differs",
                f"unit {live.unit} says another height, direction or coupling of "
                f"{', '.join(different)} than the scenario, which is used",
            )

    @property
    def statistics(self) -> NodeStatistics:
        """A layout that differs from the scenario's is warned of."""
        return NodeStatistics(warnings=tuple(self._different.values()))

    def finish(self) -> Iterator[Message]:
        """Return nothing: every estimate has its answer at once."""
        return iter(())

    def snapshot(self) -> NodeSnapshot:
        """Return the state, which windows have been answered, and the latest answers."""
        head = json.dumps(self._answered.state()).encode()
        state = head + b"\n" + self._updater.saved(self._state)
        return NodeSnapshot(state, self._answers)

    def restore(self, snapshot: NodeSnapshot, past: Iterable[Message]) -> Iterator[Message]:
        """Go on from a snapshot, with the estimates that were recorded and not answered.

        Raises CheckpointError.
        """
        head, _, state = snapshot.state.partition(b"\n")
        self._state = self._updater.restored(state)
        self._answered.resume(json.loads(head))
        self._answers = tuple(each for each in snapshot.messages if isinstance(each, Answer))
        estimates = [each for each in past if isinstance(each, ModalEstimate)]
        return (a for each in estimates if each not in self._answered for a in self.handle(each))


def _identified(answer: Answer, estimate: ModalEstimate) -> Answer:
    """Return the answer with its window's identity, its times in order whatever the clock did."""
    answer = replace(answer, origins=estimate.origins)
    if not isinstance(answer, FoundationEvent):
        return answer
    earliest, latest = sorted((answer.since_earliest_ns, answer.since_latest_ns))
    return replace(answer, since_earliest_ns=earliest, since_latest_ns=latest)


def _is_of(answer: Answer, estimate: ModalEstimate) -> bool:
    if answer.origins or estimate.origins:
        return answer.origins == estimate.origins
    end_ns = answer.end_ns if isinstance(answer, WindowRejected) else answer.time_ns
    return end_ns == estimate.end_ns


class UpdatingNode(NodeByTurbine[TurbineUpdating]):
    """The updating of any number of turbines, fed with windows of the allowed states alone.

    Parameters
    ----------
    make : callable
        Turbine → its updating.
    store : SnapshotStore, optional
        Where it goes on from; None: it begins with nothing seen.
    past : sequence of Message
        Estimates that were recorded last.
    """

    name = "updating"
    inputs = (ModalEstimate, SensorLayout)

    def __init__(
        self,
        make: Callable[[str], TurbineUpdating],
        *,
        store: SnapshotStore | None = None,
        past: Sequence[Message] = (),
    ) -> None:
        super().__init__(self._made, store=store, past=past)
        self._make_one = make
        self._layouts = BoundedDict[tuple[str, str], SensorLayout](MOST_LAYOUTS)

    def handle(self, message: Message) -> Iterator[Message]:
        """See `NodeByTurbine.handle`; a layout alone makes no updating."""
        if not isinstance(message, SensorLayout) or message.turbine in self.members:
            yield from super().handle(message)
            return
        self._layouts.put((message.turbine, message.unit), message)

    def _made(self, turbine: str) -> TurbineUpdating:
        node = self._make_one(turbine)
        for key in [key for key in self._layouts if key[0] == turbine]:
            node.handle(self._layouts.pop(key))
        return node
