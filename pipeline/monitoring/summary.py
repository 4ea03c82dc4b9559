"""The summary of a run: what a person wants to know in the end, a pure function of its state.

`run_figures` gives the content of `summary.json`; its names are stable: none changes, more may
come.
"""

from collections.abc import Iterable, Sequence
from typing import TypeVar

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.node import Sink
from pipeline.state.posterior_json import MEDIAN_AND_INTERVAL, empty_summary, posterior_summary
from pipeline.state.run_state import RunState
from pipeline.state.turbine_state import TurbineState, missing_ns
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.json_values import Json, fields_of, known, with_nulls

KEPT_WINDOWS = 5000  # rejections, gaps, posteriors of a live session, each: a month of ten minutes
BLOCK_NODES = ("recorder", "identification", "viewer")  # that take blocks, or shares of them

_T = TypeVar("_T", StreamGap, WindowRejected)


class SessionSummary(Sink):
    """A sink that folds a session into its state and answers with nothing.

    Parameters
    ----------
    source : str
        What the session listens to, for people.
    turbine : str
        The session's first turbine.
    live : bool, optional
        Whether the blocks that are received count, for want of a count of those that are sent.
    """

    name = "summary"

    def __init__(self, source: str, turbine: str, *, live: bool = False) -> None:
        self.source = source
        self.live = live
        self.run = RunState(kept=KEPT_WINDOWS if live else None, once=live)
        self._first = turbine
        results = (ModalEstimate, WindowRejected, FoundationEvent, FoundationPosterior)
        accounts = (StreamGap, FoundationTruth, NodeStatus)
        blocks = (AccelerationBlock,) if live else ()  # else counted where they are published
        self.inputs = (*results, *accounts, *blocks)

    @property
    def main(self) -> TurbineState:
        """The session's first turbine; where it is silent and others are not, the first of them."""
        measured = self.run.measured
        if self._first in measured or not measured:
            return self.run.turbine(self._first)
        return next(iter(measured.values()))

    def handle(self, message: Message) -> Iterable[Message]:
        """Take note of a message. Gives nothing back."""
        self.run.fold(message)
        return ()

    def as_json(self, wall: float) -> Json:
        """Return the content of `summary.json`; wall: how long the session took [s]."""
        return run_figures(
            self.run, self.main.turbine, source=self.source, wall=wall, live=self.live
        )


def run_figures(
    run: RunState, main: str, *, source: str, wall: float = 0.0, live: bool = False
) -> Json:
    """Return the figures of a run: its first turbine's; of a farm also each one's own.

    Parameters
    ----------
    run : RunState
        After the last message.
    main : str
        The first turbine.
    source : str
        What the run listened to, for people.
    wall : float, optional
        How long it took [s].
    live : bool, optional
        Whether it joined units that were running: what lies before its first block is not lost.
    """
    measured = run.measured
    members: dict[str, Json] = {
        name: {"source": source} | turbine_figures(run, name, wall=wall, live=live)
        for name in (main, *measured)
    }
    first = members[main]
    first["stream"] = stream_figures(run.reported(main), published=run.published, live=live)
    first["books"] = run.books.as_json()
    if len(measured) < 2:
        return first
    return first | {"turbines": [members[name] for name in sorted(members)]}


def turbine_figures(run: RunState, turbine: str, *, wall: float = 0.0, live: bool = False) -> Json:
    """Return the figures of one turbine of a run: see `run_figures`."""
    state, books = run.reported(turbine), run.books.as_json(turbine)
    figures: Json = with_nulls(
        {
            "turbine": state.turbine,
            "duration_s": state.duration,  # from the first sample to the last
            "measured_s": state.measured_time,
            "windows": {
                "identified": state.n_identified,
                "rejected": [
                    _rejection(state, each)
                    for each in _in_its_time(state, state.rejected, live=live)
                ],
            },
            "modes": [mode.as_json() for mode in state.modes],
            "posterior": _posterior(state),
            "events": [_event(state, each) for each in state.events],
            "warnings": _warnings(state, books),
            "stream": stream_figures(state, published=state.published, live=live),
            "books": books,
            "timing": {
                "wall_s": wall,
                "realtime_factor": state.measured_time / wall if wall > 0 else None,
                "identify_s_per_window": _busy(state, "identification"),
                "update_s_per_window": _busy(state, "updating"),
            },
        }
    )
    return figures


def _warnings(state: TurbineState, books: Json) -> list[Json]:
    """Return every warning once, then what the books raise an alarm of."""
    found = [(each.code, each.text) for each in state.warnings]
    found += [(e["kind"], e["text"]) for e in books["alarms"] if e["turbine"] == state.turbine]
    return [{"code": code, "text": text} for code, text in dict.fromkeys(found)]


def _in_its_time(state: TurbineState, items: Sequence[_T], *, live: bool) -> list[_T]:
    """Leave out what lies before the first block that was received of a live session.

    A listener that joins a unit after months has not lost them.
    """
    if not live or state.first_ns is None:
        return list(items)
    return [each for each in items if each.end_ns > state.first_ns]


def _since_start(state: TurbineState, time_ns: int) -> float | None:
    return None if state.first_ns is None else (time_ns - state.first_ns) / NANOSECONDS


def _event(state: TurbineState, event: FoundationEvent) -> Json:
    return {
        "kind": event.kind,
        "probability": known(event.probability),
        "noticed": _since_start(state, event.time_ns),
        "since": _since_start(state, event.since_ns),
        "text": event.text,
        "changes": {each.name: fields_of(each, *MEDIAN_AND_INTERVAL) for each in event.changes},
        "revised": _revised(state, event),
    }


def _revised(state: TurbineState, event: FoundationEvent) -> Json | None:
    """Return the size of a change by the windows since, as `changes` has it by the first."""
    found = state.revised_size(event)
    if found is None:
        return None
    springs = {
        each.name: {quantile: getattr(each, quantile) - 1 for quantile in MEDIAN_AND_INTERVAL}
        for each in found.springs
    }
    return {"posteriors": found.n_posteriors, "changes": springs, "text": found.text}


def _rejection(state: TurbineState, rejected: WindowRejected) -> Json:
    start = _since_start(state, rejected.start_ns)
    return {"start": start, "code": rejected.code, "reason": rejected.reason}


def _posterior(state: TurbineState) -> Json:
    if state.posterior is None:
        return empty_summary()
    last = state.posterior
    return posterior_summary(last, state.truth) | {
        "trusted": last.trusted,
        "windows": last.n_windows,
        **fields_of(last, "sampler", "reduced_chi_square", "paired_share", "pairing_cost"),
    }


def stream_figures(state: TurbineState, *, published: int, live: bool) -> Json:
    """Return what became of a turbine's blocks, by the accounts of the nodes."""
    recorder = state.statuses.get("recorder")
    gaps = _in_its_time(state, state.gaps, live=live)
    takers = [status for node, status in state.statuses.items() if node != "source"]
    return {
        "published": published,
        "recorded": None if recorder is None else recorder.recorded,
        "lost": _lost(takers, published),
        "recovered": max((status.recovered for status in takers), default=0),
        "late": max((status.late for status in takers), default=0),
        "duplicate": max((status.duplicate for status in takers), default=0),
        "gaps": len(gaps) + state.gone["gaps"],
        "gap_s": (missing_ns(gaps) + state.gone["gap_ns"]) / NANOSECONDS,
    }


def _lost(takers: Sequence[NodeStatus], published: int) -> int | None:
    """Return how many blocks never came; None instead of 0 while a node has received no block."""
    lost = max((status.lost for status in takers), default=0)
    kinds = [[each for each in takers if each.is_of(kind)] for kind in BLOCK_NODES]
    all_received = all(any(each.has_blocks for each in kind) for kind in kinds if kind)
    if lost or not published or (all_received and any(each.has_blocks for each in takers)):
        return lost
    return None


def _busy(state: TurbineState, node: str) -> float | None:
    shares = [each for each in state.statuses.values() if each.is_of(node)]
    windows = state.n_identified
    return sum(each.busy_s for each in shares) / windows if shares and windows else None
