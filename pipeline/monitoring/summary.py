"""SessionSummary: a sink that keeps what a person wants to know of a session in the end.

`as_json` is the content of `summary.json`; its names are stable: more may come, none changes.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    QualityWarning,
    StreamGap,
    WindowRejected,
    same_window,
)
from pipeline.nodes.by_turbine import of_kind
from pipeline.nodes.node import NodeStatistics
from pipeline.state.books import Books
from pipeline.state.json_values import Json, known, with_nulls
from pipeline.state.posterior_json import empty_summary, posterior_summary
from pipeline.state.run_modes import NO_FACTOR, CombinedMode, combined_modes
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

KEPT_WINDOWS = 5000  # windows, rejections and gaps of a live session, each: a month of ten minutes

_M = TypeVar("_M")
_T = TypeVar("_T", StreamGap, WindowRejected)


@dataclass(slots=True)
class SessionSummary:
    """Collects results and accounts while the session runs; answers with nothing."""

    source: str
    turbine: str
    live: bool = False  # no count of the blocks given is sent: those that are received count
    estimates: list[ModalEstimate] = field(default_factory=list)
    rejected: list[WindowRejected] = field(default_factory=list)
    gaps: list[StreamGap] = field(default_factory=list)
    events: list[FoundationEvent] = field(default_factory=list)
    gone: Counter[str] = field(default_factory=Counter)  # counts of what was let go of all this
    posterior: FoundationPosterior | None = None
    truth: FoundationTruth | None = None
    statuses: dict[str, NodeStatus] = field(default_factory=dict)
    first_ns: int | None = None  # of the first block that the source gave
    last_ns: int | None = None
    published: int = 0  # acceleration blocks
    books: Books = field(default_factory=Books)
    heard: dict[tuple[str, ...], int] = field(default_factory=dict)  # a unit's session → sequence

    others: dict[str, "SessionSummary"] = field(default_factory=dict)  # of a farm, by turbine

    name = "summary"

    @property
    def inputs(self) -> tuple[type, ...]:
        """What it takes: results and accounts, and blocks where these are counted by hearing."""
        results = (ModalEstimate, WindowRejected, FoundationEvent, FoundationPosterior)
        accounts = (StreamGap, FoundationTruth, NodeStatus)
        return (*results, *accounts, *((AccelerationBlock,) if self.live else ()))

    def handle(self, message: Message) -> Iterable[Message]:
        self.books.handle(message)
        if isinstance(message, AccelerationBlock):
            self._hear(message)
        turbine = getattr(message, "turbine", self.turbine)
        if turbine != self.turbine:
            return () if isinstance(message, AccelerationBlock) else self._of(turbine, message)
        match message:
            case ModalEstimate():
                self._add_estimate(message)
            case WindowRejected():
                self._add_rejection(message)
            case StreamGap():
                self._add_gap(message)
            case FoundationEvent():
                self.events.append(message)
                self._let_go(self.events, "events")
            case FoundationPosterior():
                self.posterior = message
            case FoundationTruth():
                self.truth = message
            case NodeStatus():
                self.statuses[message.node] = message
        return ()

    def _of(self, turbine: str, message: Message) -> Iterable[Message]:
        """Another turbine of the farm."""
        return self._other(turbine).handle(message)

    def _other(self, turbine: str) -> "SessionSummary":
        return self.others.setdefault(turbine, SessionSummary(self.source, turbine, live=self.live))

    def _hear(self, block: AccelerationBlock) -> None:
        """A block of a live unit, whichever turbine's; one that comes again is the same one."""
        unit = (block.turbine, block.unit, block.session)
        newest = self.heard.pop(unit, -1)
        self.heard[unit] = max(newest, block.sequence)
        if len(self.heard) > KEPT_WINDOWS:
            del self.heard[next(iter(self.heard))]  # silent for longest
        if block.sequence <= newest:
            return
        if block.turbine == self.turbine:
            self.count(block)
        else:
            self.published += 1
            self._other(block.turbine).count(block)

    def _add_estimate(self, estimate: ModalEstimate) -> None:
        """A window once, even where a restarted identification has seen it again."""
        if all(not same_window(each, estimate) for each in self.estimates):
            modes = tuple(replace(mode, covariance_factor=NO_FACTOR) for mode in estimate.modes)
            self.estimates.append(replace(estimate, modes=modes))
            self._let_go(self.estimates, "windows")

    def _add_gap(self, gap: StreamGap) -> None:
        """One that is reported again is the same one."""
        if gap not in self.gaps:
            self.gaps.append(gap)
            for oldest in self._let_go(self.gaps, "gaps"):
                self.gone["gap_ns"] += oldest.end_ns - oldest.start_ns

    def _let_go(self, told: list[_M], name: str) -> list[_M]:
        """Keep the latest of a live session, which may run for years; what went, counted."""
        gone = told[: max(0, len(told) - KEPT_WINDOWS)] if self.live else []
        del told[: len(gone)]
        self.gone[name] += len(gone)
        return gone

    def _add_rejection(self, rejected: WindowRejected) -> None:
        """A window once; the identification, restarted, also rejects what it has identified
        before, its samples no longer to be had. The updating may reject what was identified."""
        again = any(
            each.code == rejected.code and same_window(each, rejected) for each in self.rejected
        )
        seen = any(same_window(each, rejected) for each in self.estimates)
        if not again and not (seen and rejected.code == "gap"):
            self.rejected.append(rejected)
            self._let_go(self.rejected, "rejected")

    def _in_its_time(self, told: Sequence[_T]) -> list[_T]:
        """Without what lies before the first block that was received of a live session: a
        listener that joins a unit after months has not lost them."""
        if not self.live or self.first_ns is None:
            return list(told)
        return [each for each in told if each.end_ns > self.first_ns]

    @property
    def statistics(self) -> NodeStatistics:
        """It counts nothing of its own."""
        return NodeStatistics()

    def close(self) -> None:
        """Nothing is held."""

    def count(self, block: AccelerationBlock) -> None:
        """A block that the source publishes."""
        if not self.live:
            self.books.handle(block)
        self.published += 1
        self.first_ns = block.start_ns if self.first_ns is None else self.first_ns
        self.last_ns = max(self.last_ns or 0, block.end_ns)
        if block.turbine != self.turbine:
            self._other(block.turbine).count(block)

    @property
    def modes(self) -> list[CombinedMode]:
        return combined_modes(self.estimates, self.posterior)

    @property
    def doubts(self) -> list[QualityWarning]:
        """Every warning once, in order of appearance: the last posterior's, the windows', the
        nodes'. Not the summary's own `warnings`, which it would publish in its status and receive
        again.
        """
        doubts = [*(self.posterior.warnings if self.posterior else ())]
        doubts += [doubt for estimate in self.estimates for doubt in estimate.warnings]
        doubts += [doubt for status in self.statuses.values() for doubt in status.warnings]
        return list(dict.fromkeys(doubts))

    @property
    def duration(self) -> float:
        """Of the measurements [s]."""
        if self.first_ns is None or self.last_ns is None:
            return 0.0
        return (self.last_ns - self.first_ns) / NANOSECONDS

    def as_json(self, wall: float) -> Json:
        """Of the session's first turbine; of a farm also each turbine's own under `turbines`.

        wall: how long the session took [s].
        """
        figures = self._figures(wall)
        if self.others:
            members = {self.turbine: self, **self.others}
            figures["turbines"] = [members[name]._figures(wall) for name in sorted(members)]
        answer: Json = with_nulls(figures)
        return answer

    def _figures(self, wall: float) -> Json:
        return {
            "source": self.source,
            "turbine": self.turbine,
            "duration_s": self.duration,
            "windows": {
                "identified": len(self.estimates) + self.gone["windows"],
                "rejected": [self._rejection(each) for each in self._in_its_time(self.rejected)],
            },
            "modes": [mode.as_json() for mode in self.modes],
            "posterior": self._posterior(),
            "events": [self._event(each) for each in self.events],
            "warnings": [{"code": each.code, "text": each.text} for each in self.doubts],
            "stream": self._stream(),
            "books": self.books.as_json(),
            "timing": {
                "wall_s": wall,
                "realtime_factor": self.duration / wall if wall > 0 else None,
                "identify_s_per_window": self._busy("identification"),
                "update_s_per_window": self._busy("updating"),
            },
        }

    def _since_start(self, time_ns: int) -> float | None:
        return None if self.first_ns is None else (time_ns - self.first_ns) / NANOSECONDS

    def _event(self, event: FoundationEvent) -> Json:
        return {
            "kind": event.kind,
            "probability": known(event.probability),
            "noticed": self._since_start(event.time_ns),
            "since": self._since_start(event.since_ns),
            "text": event.text,
        }

    def _rejection(self, rejected: WindowRejected) -> Json:
        start = self._since_start(rejected.start_ns)
        return {"start": start, "code": rejected.code, "reason": rejected.reason}

    def _posterior(self) -> Json:
        if self.posterior is None:
            return empty_summary()
        last = self.posterior
        return posterior_summary(last, self.truth) | {
            "trusted": last.trusted,
            "windows": last.n_windows,
            "sampler": last.sampler,
            "reduced_chi_square": known(last.reduced_chi_square),
            "paired_share": known(last.paired_share),
            "pairing_cost": known(last.pairing_cost),
        }

    def _stream(self) -> Json:
        recorder = self.statuses.get("recorder")
        gaps = self._in_its_time(self.gaps)
        takers = [status for node, status in self.statuses.items() if node != "source"]
        return {
            "published": self.published,
            "recorded": None if recorder is None else recorder.recorded,
            "lost": max((status.lost for status in takers), default=0),
            "recovered": max((status.recovered for status in takers), default=0),
            "late": max((status.late for status in takers), default=0),
            "duplicate": max((status.duplicate for status in takers), default=0),
            "gaps": len(gaps) + self.gone["gaps"],
            "gap_s": (sum(gap.end_ns - gap.start_ns for gap in gaps) + self.gone["gap_ns"])
            / NANOSECONDS,
        }

    def _busy(self, node: str) -> float | None:
        shares = [each for name, each in self.statuses.items() if of_kind(name, node)]
        windows = len(self.estimates)
        return sum(each.busy_s for each in shares) / windows if shares and windows else None
