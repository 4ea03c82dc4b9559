"""Windows identified one by one become one history: numbers, names of modes, channels compared.

Modes are followed over all files of a turbine, in order of time, by the tracker that a session has:
so a mode keeps its name from the first file to the last, and no name depends on where or in what
order files were identified. This pass is serial, some milliseconds a window, and continues from the
state that it has left.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from pipeline.messages import (
    FoundationTruth,
    Message,
    ModalEstimate,
    QualityWarning,
    WindowRejected,
    rejected_estimate,
)
from pipeline.oma.tracking import ChannelPlaces, ChannelSwapMonitor, ModeTracker, TrackerState
from sensors.acquisition.blocks import NANOSECONDS

FORGETTING = 12  # windows at most by which a gap, however long, widens what is expected of a mode


@dataclass(frozen=True, slots=True, eq=False)
class TrackingState:
    """What is remembered of one turbine's windows; its size does not grow with their number."""

    tracker: TrackerState = field(default_factory=TrackerState)
    reference: ModalEstimate | None = None
    """The last window with its channels in place."""
    next_window: int = 0
    """Its number."""
    expected_ns: int | None = None
    """Start of the next window, were there no gap."""
    truth: FoundationTruth | None = None
    """The last one."""


class ArchiveTracking:
    """What must be remembered of one turbine's windows.

    Parameters
    ----------
    channels : sequence of str
        Names of all channels that any of its layouts has.
    hop : float
        From one window's start to the next one's [s].
    state : TrackingState, optional
        After the windows before; None: there are none.
    """

    def __init__(
        self, channels: Sequence[str], hop: float, state: TrackingState | None = None
    ) -> None:
        state = state or TrackingState()
        self._channels = tuple(channels)
        self._hop_ns = round(hop * NANOSECONDS)
        self._tracker = ModeTracker.continued(state.tracker)
        self._watch = ChannelSwapMonitor(state.reference)
        self._next_window = state.next_window
        self._expected_ns = state.expected_ns
        self._truth = state.truth

    @property
    def state(self) -> TrackingState:
        """All that later windows depend on."""
        return TrackingState(
            tracker=self._tracker.state,
            reference=self._watch.reference,
            next_window=self._next_window,
            expected_ns=self._expected_ns,
            truth=self._truth,
        )

    def followed(self, answers: Iterable[Message]) -> Iterator[Message]:
        """Answers in order of time, each window under its number in the turbine's history, its
        modes named; a window whose channels have changed place is rejected."""
        for answer in answers:
            match answer:
                case ModalEstimate():
                    self._pass_gap_before(answer)
                    yield self._numbered(self._named(answer))
                case WindowRejected():
                    self._pass_gap_before(answer)
                    self._tracker.missed()
                    yield self._numbered(answer)
                case FoundationTruth() if self._is_new(answer):
                    self._truth = answer
                    yield answer

    def _is_new(self, truth: FoundationTruth) -> bool:
        """Tasks that read the same file repeat what stands there."""
        return self._truth is None or truth.time_ns > self._truth.time_ns

    def _named(self, estimate: ModalEstimate) -> ModalEstimate | WindowRejected:
        unknown = [name for name in estimate.channels if name not in self._channels]
        if unknown:
            self._tracker.missed()
            text = f"no layout of the archive has a channel {unknown[0]}"
            return rejected_estimate(estimate, "unknown-channel", text)
        modes = self._tracker.named(estimate.modes, on=self._places(estimate.channels))
        events = tuple(QualityWarning(f"mode-{e.kind}", e.text) for e in self._tracker.events)
        swapped = self._watch.swap_in(estimate)
        if swapped is not None:
            return rejected_estimate(estimate, "swapped-channels", swapped)
        return replace(estimate, modes=modes, warnings=estimate.warnings + events)

    def _places(self, channels: Sequence[str]) -> ChannelPlaces | None:
        """Return where a window's channels are among all that the turbine has ever had."""
        if tuple(channels) == self._channels:
            return None
        columns = tuple(self._channels.index(name) for name in channels)
        return ChannelPlaces(columns, len(self._channels))

    def _pass_gap_before(self, window: ModalEstimate | WindowRejected) -> None:
        """Between files that do not join, modes may have walked; they are not forgotten."""
        if self._expected_ns is not None:
            missing = round((window.start_ns - self._expected_ns) / self._hop_ns)
            for _ in range(min(missing, FORGETTING)):
                self._tracker.missed()
        self._expected_ns = window.start_ns + self._hop_ns

    def _numbered(self, answer: ModalEstimate | WindowRejected) -> ModalEstimate | WindowRejected:
        number, self._next_window = self._next_window, self._next_window + 1
        return replace(answer, window=number)
