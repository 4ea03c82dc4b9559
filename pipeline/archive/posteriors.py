"""The posterior after every window of an archive: sums in one serial pass, posteriors in parallel.

    windows     0   1   2   3   4   5   6   7   8   9  …      in order of time
    sums        ●───●───●───●───●───●───●───●───●───●──►      serial, O(1) a window, milliseconds
    anchors     ▲   ▲   ▲       ▲           ▲                 serial: a posterior each
    stretches           └─3─┘   └─── 5 6 7 ─┘   └─ 9 …        parallel: posteriors of these windows

What the windows up to one say of the stiffness collapses to sums (`updating.evidence`), so that a
posterior needs its window's sums and nothing of the posteriors before it but where to begin the
search and by which of its springs a frequency is moved. Both come from the last anchor: early on
every few windows, later every six hours, and at once where the structure has changed. Every random
choice is seeded by scenario and window. So where and in what order stretches are done changes no
bit.

Against a session, which refreshes these with every window, only draws differ: each posterior is
drawn again from its sums.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

from pipeline.archive.compact import kept_estimate, restored_estimate
from pipeline.archive.store import StoredFrame, frames_of, key_of_result, messages_in
from pipeline.archive.work import Call
from pipeline.messages import FoundationEvent, Message, ModalEstimate, WindowRejected
from pipeline.nodes.operating_state import OperationSettings, at_its_channels, usable_estimate
from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.state import UpdatingState
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import one_blas_thread
from sensors.bounded_dict import BoundedDict
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import TurbineDescription

ANCHORS_APART = 36  # windows at most: six hours of ten minutes
WINDOWS_OF_CALL = 6  # windows of one call at most
UPDATERS_KEPT = 8  # in one process: a turbine's has some megabytes
STATE_FRAME = "UpdatingState"  # kind of the frame that holds a checkpoint

Memory = Callable[[str, Callable[[], tuple[StoredFrame, ...]]], tuple[StoredFrame, ...]]


@dataclass(frozen=True, slots=True, eq=False)
class UpdatingPlan:
    """What makes the updater of one turbine, wherever it is made."""

    structure: TurbineDescription
    layout: SensorLayout
    settings: UpdatingSettings
    operation: OperationSettings
    seed: int
    population: StiffnessPopulation | None = None
    """The farm's prior; None: the uniform one."""

    def made(self) -> FoundationUpdater:
        """Return the updater."""
        return FoundationUpdater(
            ModalModel(self.structure, self.layout),
            self.layout,
            self.settings,
            seed=self.seed,
            population=self.population,
            joint=joint_inference(
                self.structure,
                self.layout,
                self.settings,
                seed=self.seed,
                population=self.population,
            ),
        )

    @property
    def key(self) -> str:
        """Fingerprint of all of it."""
        parts = (self.structure, self.layout, self.settings, self.operation, self.seed)
        return key_of_result(*map(repr, parts), *_bytes_of(self.population))


def _bytes_of(population: StiffnessPopulation | None) -> Iterator[bytes]:
    if population is not None:
        yield repr((population.turbines, population.outlier_std)).encode()
        arrays = (population.nominal, population.means, population.covariances)
        yield from (each.tobytes() for each in (*arrays, population.outlier_shares))


@dataclass(frozen=True, slots=True, eq=False)
class StretchCall:
    """Windows whose posteriors are wanted, after the sums of those before them."""

    plan: UpdatingPlan
    state: bytes
    """Checkpoint: the sums before the first, and the last anchor."""
    estimates: tuple[bytes, ...]
    """As they are kept, in order."""

    @property
    def key(self) -> str:
        """Fingerprint of all that the posteriors depend on."""
        return key_of_result("posteriors 2", self.plan.key, self.state, *self.estimates)


def posteriors(call: StretchCall) -> tuple[StoredFrame, ...]:
    """Return a FoundationPosterior or a WindowRejected of each window, in order."""
    updater = _updater(call.plan)
    state = updater.restored(call.state, origin="the state of the archive")
    answers: list[Message] = []
    with one_blas_thread():
        for payload in call.estimates:
            estimate = restored_estimate(payload)
            state, _ = updater.accumulated(state, estimate)
            _, answer = updater.refreshed(state, estimate)
            answers.append(at_its_channels(answer, estimate, state.evidence.channels))
    return frames_of(answers)


def anchored(call: StretchCall) -> tuple[StoredFrame, ...]:
    """Return the answers to one window, an event among them, and the state after it."""
    updater = _updater(call.plan)
    state = updater.restored(call.state, origin="the state of the archive")
    estimate = restored_estimate(call.estimates[0])
    with one_blas_thread():
        state, outcome = updater.accumulated(state, estimate)
        state, answer = updater.refreshed(state, estimate)
    posterior = at_its_channels(answer, estimate, state.evidence.channels)
    answers = (outcome, posterior) if isinstance(outcome, FoundationEvent) else (posterior,)
    return (*frames_of(answers), (STATE_FRAME, updater.saved(state)))


_made = BoundedDict[str, FoundationUpdater](UPDATERS_KEPT)  # of this process, by the plan's key


def _updater(plan: UpdatingPlan) -> FoundationUpdater:
    """Return the plan's updater; each process makes it once and keeps the last few."""
    key = plan.key
    if key not in _made:
        _made[key] = plan.made()
    return _made[key]


@dataclass(frozen=True, slots=True)
class SavedPass:
    """What a pass remembers between days."""

    state: bytes
    """Checkpoint of the updating."""
    since_anchor: int | None
    """Windows; None: there was no anchor yet."""


class PosteriorPass:
    """The serial pass over one turbine's estimates.

    Parameters
    ----------
    plan : UpdatingPlan
        Of the turbine.
    remembered : Memory
        Gives the result of a key, by calling what makes it where there is none yet.
    saved : SavedPass, optional
        As `saved` was after the windows before; None: there are none.
    """

    def __init__(
        self, plan: UpdatingPlan, remembered: Memory, saved: SavedPass | None = None
    ) -> None:
        self._plan = plan
        self._remembered = remembered
        self._updater = _updater(plan)
        self._state = self._updater.initial_state()
        self._since_anchor: int | None = None  # windows; None: there was none yet
        if saved is not None:
            self._state = self._updater.restored(saved.state, origin="the state of the archive")
            self._since_anchor = saved.since_anchor
        self._before: UpdatingState = self._state  # of the stretch
        self._stretch: list[bytes] = []

    @property
    def saved(self) -> SavedPass:
        """All that later windows depend on, after `answers` has come to its end."""
        return SavedPass(self._updater.saved(self._state), self._since_anchor)

    def answers(self, messages: Iterable[Message]) -> Iterator[Message | Call]:
        """Every message in order; after an estimate what it says of the foundation, which is a
        message, or a call that gives the posteriors of some windows up to here."""
        for message in messages:
            yield message
            if isinstance(message, ModalEstimate):
                yield from self._taken(message)
        yield from self._stretch_ended()

    def _taken(self, measured: ModalEstimate) -> Iterator[Message | Call]:
        usable = usable_estimate(measured, self._plan.operation, self._plan.layout)
        if isinstance(usable, WindowRejected):
            yield usable
            return
        payload = kept_estimate(usable)
        estimate = restored_estimate(payload)
        with one_blas_thread():
            after, outcome = self._updater.accumulated(self._state, estimate)
        if isinstance(outcome, WindowRejected):
            yield outcome
        elif isinstance(outcome, FoundationEvent) or self._is_anchor(after):
            yield from self._stretch_ended()
            yield from self._anchored(payload)
        else:
            yield from self._stretched(after, payload)

    def _is_anchor(self, after: UpdatingState) -> bool:
        if self._since_anchor is None:
            return True
        return self._since_anchor + 1 >= min(ANCHORS_APART, max(1, after.evidence.n_windows // 2))

    def _anchored(self, payload: bytes) -> Iterator[Message]:
        call = StretchCall(self._plan, self._updater.saved(self._state), (payload,))
        frames = self._remembered(key_of_result("anchor 2", call.key), lambda: anchored(call))
        (state,) = (content for kind, content in frames if kind == STATE_FRAME)
        self._state = self._updater.restored(state, origin="the state of the archive")
        self._since_anchor = 0
        yield from messages_in(frames)

    def _stretched(self, after: UpdatingState, payload: bytes) -> Iterator[Call]:
        assert self._since_anchor is not None
        if not self._stretch:
            self._before = self._state
        self._stretch.append(payload)
        self._state, self._since_anchor = after, self._since_anchor + 1
        if len(self._stretch) == WINDOWS_OF_CALL:
            yield from self._stretch_ended()

    def _stretch_ended(self) -> Iterator[Call]:
        if self._stretch:
            state = self._updater.saved(self._before)
            call = StretchCall(self._plan, state, tuple(self._stretch))
            self._stretch = []
            yield Call(call.key, posteriors, call)
