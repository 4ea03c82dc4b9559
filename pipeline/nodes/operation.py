"""What the turbine was doing during a window, and which windows may speak of the foundation.

    ScadaSample ─┐
    block ───────┴► [identification] ──► ModalEstimate with its state, yaw and water level
                                             │
                       [updating]: state allowed? ── no ──► WindowRejected
                                             │ yes, its shapes turned to the nacelle's axes
                                             ▼
                                       FoundationPosterior

Both are the ordinary nodes in a coat: they keep their names and take what those take.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import (
    Message,
    ModalEstimate,
    Mode,
    StreamEnd,
    Warning,  # noqa: A004  # the field's word
    WindowRejected,
)
from pipeline.modal_shapes import normalised_to, renormalised_factor
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.node import Node
from pipeline.nodes.roster import MOST_TURBINES, MOST_UNITS, Roster, told_of_gone
from pipeline.oma.block_watch import BlockWatch
from pipeline.oma.channel_watch import ChannelWatch
from pipeline.oma.settings import OmaSettings
from sensors.blocks import AccelerationBlock
from sensors.errors import InputError
from sensors.layout import SensorLayout
from sensors.scada import ScadaSample

FloatArray = NDArray[np.float64]

STATES = ("parked", "idling", "start", "operating", "stop")
CHANGING = "changing"  # state of a window during which the state or the yaw changed
STEADY_YAW = 2.0  # range of the yaw over a window whose axes are known [deg]
KEPT = 10_000  # SCADA samples that are remembered: more than a day at 10 s


@dataclass(frozen=True, slots=True)
class OperationSettings:
    """Which windows may update the foundation."""

    allowed_states: tuple[str, ...] = ("parked", "idling")  # "" (unknown) always may
    unusable: tuple[str, ...] = ("duplicate-channel", "clipped")  # codes that spoil the shapes

    def __post_init__(self) -> None:
        for state in self.allowed_states:
            if state not in STATES:
                raise InputError(
                    f"[operation] allowed_states has {state!r}; states are {', '.join(STATES)}"
                )


class OperationLog:
    """What the controllers of some turbines have said lately."""

    def __init__(self) -> None:
        self._samples: dict[str, deque[ScadaSample]] = {}  # by turbine

    def note(self, sample: ScadaSample) -> None:
        """Remember a sample."""
        self._samples.setdefault(sample.turbine, deque(maxlen=KEPT)).append(sample)

    def forget(self, turbine: str) -> None:
        """Let go of a turbine."""
        self._samples.pop(turbine, None)

    def with_conditions(self, estimate: ModalEstimate) -> ModalEstimate:
        """The estimate with what the controller said of its window; unchanged where it said
        nothing."""
        samples = self._during(estimate)
        if not samples:
            return estimate
        states = list(dict.fromkeys(sample.state for sample in samples))
        yaws = np.array([sample.yaw for sample in samples])
        steady = len(states) == 1 and np.ptp(yaws) <= STEADY_YAW
        return replace(
            estimate,
            operating_state=states[0] if steady else CHANGING,
            wind_speed=float(np.mean([sample.wind_speed for sample in samples])),
            rotor_speed=float(np.mean([sample.rotor_speed for sample in samples])),
            yaw=float(np.mean(yaws)),
            water_level=float(np.mean([sample.water_level for sample in samples])),
        )

    def _during(self, estimate: ModalEstimate) -> list[ScadaSample]:
        """Samples of the window, and the one that holds when it begins."""
        known = self._samples.get(estimate.turbine, ())
        before = [sample for sample in known if sample.time_ns <= estimate.start_ns]
        inside = [s for s in known if estimate.start_ns < s.time_ns < estimate.end_ns]
        return before[-1:] + inside


class IdentificationInContext:
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
        self._inner = IdentificationNode(self._settings)
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

    def close(self) -> None:
        self._inner.close()

    @property
    def late(self) -> int:
        """See `IdentificationNode.late`."""
        return self._inner.late

    @property
    def duplicate(self) -> int:
        """See `IdentificationNode.duplicate`."""
        return self._inner.duplicate

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


def refusal_by_operation(
    estimate: ModalEstimate, settings: OperationSettings
) -> WindowRejected | None:
    """Why an estimate may not speak of the foundation; None: it may."""
    state, allowed = estimate.operating_state, settings.allowed_states
    if state and state not in allowed:
        reason = (
            f"the turbine was {state}; only {' and '.join(allowed)} windows update the foundation"
        )
        return rejected_estimate(estimate, "operating-state", reason)
    for doubt in estimate.warnings:
        if doubt.code in settings.unusable:
            return rejected_estimate(estimate, doubt.code, f"{doubt.text}; not used")
    return None


def rejected_estimate(estimate: ModalEstimate, code: str, reason: str) -> WindowRejected:
    """The estimate's window as one that is not used."""
    return WindowRejected(
        turbine=estimate.turbine,
        window=estimate.window,
        start_ns=estimate.start_ns,
        end_ns=estimate.end_ns,
        code=code,
        reason=reason,
    )


def in_nacelle_axes(estimate: ModalEstimate, layout: SensorLayout) -> ModalEstimate:
    """The estimate with its shapes turned from the tower's axes to those of the yawed nacelle.

    Sensors are fixed to the tower while fore-aft follows the nacelle. Two axes at one height span
    the horizontal motion there, whatever their directions; it is read again along the layout's own
    directions after a turn by −yaw. Unchanged where the yaw is 0 or unknown.
    """
    if not np.isfinite(estimate.yaw) or abs(estimate.yaw) < 1e-9:
        return estimate
    by_name = {channel.name: channel for channel in layout.channels}
    if not by_name.keys() >= set(estimate.channels):
        return estimate  # the updater refuses channels that the layout does not have
    measured = replace(layout, channels=tuple(by_name[name] for name in estimate.channels))
    turn = turning_matrix(measured, estimate.yaw)
    return replace(estimate, modes=tuple(_turned(mode, turn) for mode in estimate.modes))


def turning_matrix(layout: SensorLayout, yaw: float) -> FloatArray:
    """(n_channels, n_channels): readings along tower axes → along nacelle axes, yaw [deg].

    Raises InputError for a height with one axis alone, whose motion across is not known.
    """
    angle = np.radians(yaw)
    to_nacelle = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turn = np.zeros((len(layout.channels), len(layout.channels)))
    for elevation in np.unique(layout.elevations):
        own = np.flatnonzero(layout.elevations == elevation)
        axes = layout.directions[own, :2]
        if np.linalg.matrix_rank(axes, tol=0.1) < 2:
            raise InputError(
                f"layout {layout.layout_id} has one direction only at {elevation:g} m; a nacelle "
                f"yawed by {yaw:g} deg needs two"
            )
        turn[np.ix_(own, own)] = axes @ to_nacelle @ np.linalg.pinv(axes)
    return turn


def _turned(mode: Mode, turn: FloatArray) -> Mode:
    shape = turn @ mode.shape
    unit = int(np.argmax(np.abs(shape)))
    factor = mode.covariance_factor.copy()
    factor[2:] = renormalised_factor(shape, turn @ mode.covariance_factor[2:], unit)
    return replace(mode, shape=normalised_to(shape, unit), covariance_factor=factor)
