"""The identification with what it knows of operation, clock, link and wiring.

    ScadaSample ─┐
    block ───────┴► [identification] ──► ModalEstimate with its state, yaw and water level

The ordinary node in a coat: it keeps its name and takes what that takes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

from pipeline.messages import (
    Message,
    ModalEstimate,
    StreamEnd,
    Warning,  # noqa: A004  # the field's word
    WindowRejected,
)
from pipeline.nodes.coat import Coat
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.operation import OperationLog, rejected_estimate
from pipeline.nodes.roster import MOST_TURBINES, MOST_UNITS, Roster, told_of_gone
from pipeline.oma.data_quality.block_monitor import BlockWatch
from pipeline.oma.data_quality.channel_swap import ChannelWatch
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample


class IdentificationInContext(Coat[IdentificationNode]):
    """The identification with what it knows of operation, clock, link and wiring.

    Every estimate carries the state, yaw and water level of its window by SCADA. What the link and
    the clock did wrong is told with the next estimate; a window in which two channels have changed
    place is rejected.

    compared   False: whoever has all windows compares each one's channels with the window's before
    """

    name = "identification"
    inputs: tuple[type, ...] = (*IdentificationNode.inputs, ScadaSample)

    def __init__(self, settings: OmaSettings | None = None, *, compared: bool = True) -> None:
        self._compared = compared
        self._settings = settings or OmaSettings()
        super().__init__(IdentificationNode(self._settings))
        self._log = OperationLog()
        self._blocks: dict[str, dict[str, BlockWatch]] = {}  # by turbine and unit
        self._layouts: dict[tuple[str, str], SensorLayout] = {}  # by turbine and unit
        self._channels: dict[str, ChannelWatch] = {}
        self._turbines = Roster(MOST_TURBINES)
        self._units: dict[str, Roster] = {}  # by turbine
        self._units_gone = 0  # that were let go because their turbine had too many

    def handle(self, message: Message) -> Iterator[Message]:
        yield from self._make_room(message)
        if isinstance(message, ScadaSample):
            self._log.note(message)
            return
        if isinstance(message, AccelerationBlock):
            units = self._blocks.setdefault(message.turbine, {})
            units.setdefault(message.unit, BlockWatch(self._settings.lateness)).note(message)
        if isinstance(message, SensorLayout):
            self._layouts[message.turbine, message.unit] = message
        yield from self._answers(self._inner.handle(message))

    def _answers(self, inner: Iterable[Message]) -> Iterator[Message]:
        for answer in inner:
            yield self._in_context(answer) if isinstance(answer, ModalEstimate) else answer

    def _make_room(self, message: Message) -> Iterator[Message]:
        """Let go of a turbine, or of a unit of one, where there are too many with this one."""
        leaving = self._turbines.heard(message.turbine)
        if leaving is not None:
            yield from self._answers(self._inner.forget(leaving))
            self._log.forget(leaving)
            self._blocks.pop(leaving, None)
            self._channels.pop(leaving, None)
            self._units.pop(leaving, None)
            for key in [key for key in self._layouts if key[0] == leaving]:
                del self._layouts[key]
        if isinstance(message, (AccelerationBlock, SensorLayout, StreamEnd)):
            units = self._units.setdefault(message.turbine, Roster(MOST_UNITS))
            silent = units.heard(message.unit)
            if silent is not None:
                self._units_gone += 1
                self._inner.forget_unit(message.turbine, silent)
                self._blocks.get(message.turbine, {}).pop(silent, None)
                self._layouts.pop((message.turbine, silent), None)

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """Take up what an identification that has ended answered, so that modes keep their names
        and channels are compared with the last good window's."""
        if isinstance(answer, ModalEstimate):
            self._channels.setdefault(answer.turbine, ChannelWatch()).swap_in(answer)
        self._inner.recall(answer)

    def _in_context(self, estimate: ModalEstimate) -> ModalEstimate | WindowRejected:
        estimate = self._log.with_conditions(estimate)
        still = self._still_channel(estimate)
        if still is not None:
            return rejected_estimate(estimate, "constant", still)
        if self._compared:
            watch = self._channels.setdefault(estimate.turbine, ChannelWatch())
            swapped = watch.swap_in(estimate)
            if swapped is not None:
                return rejected_estimate(estimate, "swapped-channels", swapped)
        doubts = self._link_and_clock_doubts(estimate)
        return replace(estimate, warnings=estimate.warnings + doubts)

    def _still_channel(self, estimate: ModalEstimate) -> str | None:
        """Which channel of the estimate kept one value for a while, in words."""
        for unit, watch in self._blocks[estimate.turbine].items():
            still = watch.still_channel(estimate.start_ns, estimate.end_ns)
            if still is None:
                continue
            channel, since = still
            layout = self._layouts.get((estimate.turbine, unit))
            names = layout.channel_names if layout else estimate.channels
            for name in names[channel : channel + 1]:  # a layout may not be that of the blocks
                for known_as in (name, f"{unit}/{name}"):  # the latter where two units have one
                    if known_as in estimate.channels:
                        return f"{known_as} stands still from {since:.0f} s on"
        return None

    def _link_and_clock_doubts(self, estimate: ModalEstimate) -> tuple[Warning, ...]:
        """What link and clock of every unit did wrong; of several units, each by its name."""
        units = self._blocks[estimate.turbine]
        return tuple(
            replace(doubt, text=f"unit {unit}: {doubt.text}") if len(units) > 1 else doubt
            for unit, watch in units.items()
            for doubt in watch.warnings_until(estimate.end_ns)
        )

    @property
    def warnings(self) -> tuple[Warning, ...]:
        """What the node says in its status beside its counts."""
        said = []
        if self._inner.unfit:
            said.append(
                Warning(
                    "unfit-blocks",
                    f"{self._inner.unfit} blocks of another rate, shape or time than their "
                    f"session's were dropped; the last of {self._inner.complaint}",
                )
            )
        gone = self._turbines.gone + self._units_gone
        limits = f"{MOST_TURBINES} turbines and {MOST_UNITS} units of a turbine"
        return (*said, *told_of_gone(gone, limits))
