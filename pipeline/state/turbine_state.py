"""TurbineState: what is known of one turbine of a run."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import TypeVar

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    ParameterSummary,
    QualityWarning,
    RelativeStiffness,
    StreamGap,
    WindowRejected,
    same_window,
    without_covariances,
)
from pipeline.state.repeated_warnings import DistinctWarnings
from pipeline.state.run_modes import CombinedMode, CombinedTracks
from pipeline.state.time_spans import covered
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.bounded_dict import BoundedDict

_T = TypeVar("_T")

MOST_NAMES_KNOWN = 64  # of a live run's turbine: units, nodes, rejections' codes, each
LATEST_ESTIMATES = 8  # of a live run's turbine, of 30 kB each: one that comes again is among them
MOST_TRACKS = 500  # of a live run's turbine
MOST_TRUTHS = 1000  # of a simulated one
MOST_WINDOW_WARNINGS = 1000  # of its windows, that differ


@dataclass(frozen=True, slots=True)
class PosteriorAtWindow:
    """Marginal posteriors after one window."""

    time_ns: int
    """End of the window [ns since 1970-01-01 UTC]."""
    window: int
    parameters: tuple[ParameterSummary, ...]
    trusted: bool
    change_probability: float
    """Probability that the modes have changed since the last event [-]."""
    relative: tuple[RelativeStiffness, ...] = ()
    """Springs over those before the last event."""

    def parameter(self, name: str) -> ParameterSummary:
        """Return the parameter of that name; KeyError where there is none."""
        for summary in self.parameters:
            if summary.name == name:
                return summary
        raise KeyError(name)


@dataclass(slots=True)
class UnitState:
    """What is known of the stream of one acquisition unit."""

    sampling_rate: float = float("nan")
    """Sampling rate of the latest block [Hz]."""
    end_ns: int | None = None
    """End of the latest block [ns since 1970-01-01 UTC]; None before the first."""
    samples: int = 0
    """Samples a channel received."""
    sampled_ns: int = 0
    """Duration of its blocks, each once [ns]."""
    gaps: int = 0
    """Reports of gaps received."""
    missing_ns: int = 0
    """Measured time that these gaps lack [ns]."""


@dataclass(frozen=True, slots=True)
class RevisedSize:
    """The size of a change by all windows since."""

    springs: tuple[RelativeStiffness, ...]
    """Over those before it."""
    n_posteriors: int
    """Since the event."""

    @property
    def text(self) -> str:
        """Return a sentence with the change of each spring."""
        changes = ", ".join(
            f"{each.name} {each.median - 1:+.1%} ({each.p05 - 1:+.1%} to {each.p95 - 1:+.1%})"
            for each in self.springs
        )
        return f"Revised by the windows since (posteriors: {self.n_posteriors}): {changes}."


def missing_ns(gaps: Iterable[StreamGap]) -> int:
    """Return the time in which a gap or several lie, each moment once [ns]."""
    return covered((gap.start_ns, gap.end_ns) for gap in gaps)


@dataclass(slots=True)
class TurbineState:
    """What is known of one turbine after the messages so far."""

    turbine: str
    kept: int | None = None
    """Rejections, gaps, events and posteriors that are kept, each; None: all, and all windows."""
    estimates: list[ModalEstimate] = field(default_factory=list)
    """Identified windows, each once, without covariance factors; of a live run the latest."""
    tracks: CombinedTracks = field(default_factory=CombinedTracks)
    """Modes over all windows."""
    window_warnings: DistinctWarnings = field(default_factory=DistinctWarnings)
    """Warnings of all windows."""
    rejected: list[WindowRejected] = field(default_factory=list)
    gaps: list[StreamGap] = field(default_factory=list)
    """Gaps, each once."""
    events: list[FoundationEvent] = field(default_factory=list)
    gone: Counter[str] = field(default_factory=Counter)
    """Number of each of these that were let go; "gap_ns": the time that is missing in such gaps
    and in no other."""
    received: Counter[str] = field(default_factory=Counter)
    """Messages received, by type; one that comes again counts again."""
    rejections: Counter[str] = field(default_factory=Counter)
    """Rejections received, by code."""
    last_answer: ModalEstimate | WindowRejected | None = None
    """What became of the latest window."""
    estimate: ModalEstimate | None = None
    """The latest identified window."""
    posterior: FoundationPosterior | None = None
    """The latest posterior."""
    posteriors: dict[int, PosteriorAtWindow] = field(default_factory=dict)
    """Posteriors by the end of their window [ns]."""
    let_go_since: BoundedDict[int, int] = field(
        default_factory=lambda: BoundedDict(MOST_NAMES_KNOWN)
    )
    """By the time of an event [ns]: posteriors since it that are no longer kept."""
    truths: dict[int, FoundationTruth] = field(default_factory=dict)
    """True stiffnesses by the time from which they hold [ns], the latest received last."""
    layouts: dict[str, SensorLayout] = field(default_factory=dict)
    """Sensor layouts by acquisition unit."""
    units: dict[str, UnitState] = field(default_factory=dict)
    statuses: dict[str, NodeStatus] = field(default_factory=dict)
    """The latest status of each node."""
    published: int = 0
    """Acceleration blocks; one that a live unit sends again counts once."""
    sequence: int | None = None
    """Number of the latest block; None before the first."""
    sampling_rate: float = float("nan")
    """Sampling rate of the latest block [Hz]."""
    first_ns: int | None = None
    """Start of the first block [ns since 1970-01-01 UTC]."""
    last_ns: int | None = None
    """End of the latest sample [ns since 1970-01-01 UTC]."""
    covered_ns: int = 0
    """Time that blocks and identified windows cover together, as far as they came in order [ns]."""
    covered_until_ns: int = 0
    """Latest end of one [ns since 1970-01-01 UTC]."""

    @classmethod
    def bounded(cls, turbine: str, kept: int) -> "TurbineState":
        """Return the state of a live run's turbine, which holds as much after years as after a
        day."""
        tracks = CombinedTracks(most=MOST_TRACKS)
        warnings = DistinctWarnings(most=MOST_WINDOW_WARNINGS)
        truths = BoundedDict[int, FoundationTruth](MOST_TRUTHS)
        return cls(turbine, kept, tracks=tracks, window_warnings=warnings, truths=truths)

    def fold(self, message: Message, *, counts: bool = True, is_new: bool = True) -> None:
        """Take one message into account.

        Parameters
        ----------
        message : Message
            Of this turbine.
        counts : bool, optional
            False: a block that has been counted before.
        is_new : bool, optional
            False: a block that has come before, whether it counts again or not.
        """
        self.received[type(message).__name__] += 1
        match message:
            case AccelerationBlock():
                self._block(message, counts=counts)
                if is_new:
                    self._measure(message)
            case ModalEstimate():
                self._estimate(message)
            case WindowRejected():
                self._rejection(message)
            case StreamGap():
                self._gap(message)
            case FoundationEvent():
                self.events.append(message)
                self._let_go(self.events, "events")
            case FoundationPosterior():
                self._posterior(message)
            case FoundationTruth():
                self.truths.pop(message.time_ns, None)
                self.truths[message.time_ns] = message
            case SensorLayout():
                self._name(self.layouts, message.unit, message)
            case NodeStatus():
                self._name(self.statuses, message.node, message)

    def _name(self, table: dict[str, _T], name: str, value: _T) -> _T:
        """Enter a value under its name; a live run takes in no more names than it may."""
        if name in table or self.kept is None or len(table) < MOST_NAMES_KNOWN:
            table[name] = value
        else:
            self.gone["names"] += 1
        return value

    def _unit(self, name: str) -> UnitState:
        return self.units.get(name) or self._name(self.units, name, UnitState())

    @property
    def is_measured(self) -> bool:
        """Whether more is known of it than the states of nodes."""
        return self.received.total() > self.received[NodeStatus.__name__]

    @property
    def truth(self) -> FoundationTruth | None:
        """The true stiffnesses of a simulation in the posterior's window; the latest without a
        posterior."""
        if self.posterior is None:
            return next(reversed(self.truths.values()), None)
        return self.truth_until(self.posterior.time_ns)

    def truth_until(self, time_ns: int) -> FoundationTruth | None:
        """Return the true stiffnesses that held in a window that ends then [ns since 1970-01-01
        UTC]; the first where none is so early, None without any.

        A source is ahead of its windows' answers: what has come last may not hold yet. What begins
        where the window ends does not hold in it.
        """
        earlier = [since for since in self.truths if since < time_ns]
        return self.truths.get(max(earlier) if earlier else min(self.truths, default=0))

    @property
    def n_identified(self) -> int:
        """Identified windows, those that were let go as well."""
        return len(self.estimates) + self.gone["windows"]

    def revised_size(self, event: FoundationEvent) -> RevisedSize | None:
        """Return what the windows since an event make of its size; None before the next one."""
        later = [each.time_ns for each in self.events if each.time_ns > event.time_ns]
        end_ns = min(later, default=None)
        since = [
            each
            for time_ns, each in self.posteriors.items()
            if each.relative and time_ns >= event.time_ns and (end_ns is None or time_ns < end_ns)
        ]
        n_posteriors = len(since) + self.let_go_since.get(event.time_ns, 0)
        return RevisedSize(since[-1].relative, n_posteriors) if since else None

    @property
    def duration(self) -> float:
        """From the first sample to the end of the last, gaps and pauses included [s]."""
        if self.first_ns is None or self.last_ns is None:
            return 0.0
        return (self.last_ns - self.first_ns) / NANOSECONDS

    @property
    def measured_time(self) -> float:
        """Time of which there are samples, of several units at once counted once [s].

        Where samples have gone with their age, the windows that they gave stand for them. Blocks
        that came late, or under a clock that was set back, are found in their unit's own sum.
        """
        own_ns = max((unit.sampled_ns for unit in self.units.values()), default=0)
        return max(self.covered_ns, own_ns) / NANOSECONDS

    def _cover(self, start_ns: int, end_ns: int) -> None:
        self.covered_ns += max(0, end_ns - max(start_ns, self.covered_until_ns))
        self.covered_until_ns = max(end_ns, self.covered_until_ns)

    @property
    def n_rejected(self) -> int:
        """Rejections received."""
        return self.rejections.total()

    @property
    def n_gaps(self) -> int:
        """Reports of gaps received."""
        return self.received[StreamGap.__name__]

    @property
    def missing(self) -> float:
        """Time in which a gap of a unit or of several at once lies [s]."""
        return (missing_ns(self.gaps) + self.gone["gap_ns"]) / NANOSECONDS

    @property
    def modes(self) -> list[CombinedMode]:
        """Modes of all windows, one entry a track."""
        return self.tracks.modes(self.posterior)

    @property
    def warnings(self) -> list[QualityWarning]:
        """Every warning once: the last posterior's, the windows', the nodes'."""
        found = [*(self.posterior.warnings if self.posterior else ())]
        found += self.window_warnings
        found += [each for status in self.statuses.values() for each in status.warnings]
        return [*DistinctWarnings(found)]

    def _block(self, block: AccelerationBlock, *, counts: bool) -> None:
        unit = self._unit(block.unit)
        unit.samples += len(block.samples)
        unit.end_ns, unit.sampling_rate = block.end_ns, block.sampling_rate
        self.sequence, self.sampling_rate = block.sequence, block.sampling_rate
        if counts:
            self.published += 1
            self.first_ns = block.start_ns if self.first_ns is None else self.first_ns
            self.last_ns = max(self.last_ns or 0, block.end_ns)

    def _measure(self, block: AccelerationBlock) -> None:
        self._unit(block.unit).sampled_ns += block.end_ns - block.start_ns
        self._cover(block.start_ns, block.end_ns)

    def _estimate(self, estimate: ModalEstimate) -> None:
        """Keep a window once, even where a restarted identification has seen it again."""
        estimate = without_covariances(estimate)
        self.estimate = self.last_answer = estimate
        if all(not same_window(each, estimate) for each in self.estimates):
            self.estimates.append(estimate)
            self._cover(estimate.start_ns, estimate.end_ns)
            self.tracks.add(estimate)
            self.window_warnings.add(estimate.warnings)
            self._let_go(self.estimates, "windows", most=LATEST_ESTIMATES)

    def _rejection(self, rejected: WindowRejected) -> None:
        """Keep a rejection once.

        The identification, restarted, also rejects what it has identified before, whose samples are
        no longer there. The updating may reject what was identified.
        """
        self.last_answer = rejected
        known = rejected.code in self.rejections or len(self.rejections) < MOST_NAMES_KNOWN
        self.rejections[rejected.code if known else "other"] += 1 + rejected.windows_before
        again = any(
            each.code == rejected.code and same_window(each, rejected) for each in self.rejected
        )
        seen = any(same_window(each, rejected) for each in self.estimates)
        if not again and not (seen and rejected.code == "gap"):
            self.rejected.append(rejected)
            self._let_go(self.rejected, "rejected")

    def _gap(self, gap: StreamGap) -> None:
        """Keep a gap once."""
        unit = self._unit(gap.unit)
        unit.gaps += 1
        unit.missing_ns += gap.end_ns - gap.start_ns
        if gap not in self.gaps:
            self.gaps.append(gap)
            gone = self._let_go(self.gaps, "gaps")
            self.gone["gap_ns"] += missing_ns([*gone, *self.gaps]) - missing_ns(self.gaps)

    def _posterior(self, posterior: FoundationPosterior) -> None:
        self.posterior = posterior
        self.posteriors[posterior.time_ns] = PosteriorAtWindow(
            posterior.time_ns,
            posterior.window,
            posterior.parameters,
            posterior.trusted,
            posterior.change_probability,
            posterior.relative,
        )
        if self.kept is not None and len(self.posteriors) > self.kept:
            oldest = self.posteriors.pop(next(iter(self.posteriors)))
            before = [each.time_ns for each in self.events if each.time_ns <= oldest.time_ns]
            if before and oldest.relative:
                self.let_go_since[max(before)] = self.let_go_since.get(max(before), 0) + 1

    def _let_go(self, items: list[_T], name: str, most: int | None = None) -> list[_T]:
        """Keep the latest of a run that may last for years; return what went, counted."""
        if self.kept is None:
            return []
        gone = items[: max(0, len(items) - min(self.kept, most or self.kept))]
        del items[: len(gone)]
        self.gone[name] += len(gone)
        return gone
