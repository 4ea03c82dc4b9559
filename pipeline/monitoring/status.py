"""What `pilewatch status` asks and what a running session answers.

every message ──► [status node] ◄── query on pilewatch/@status/* ── pilewatch status
                   health of nodes and streams, latest gaps, last posterior of every turbine
"""

import json
import time
from collections.abc import Callable
from pathlib import Path

from pipeline.messages import FoundationPosterior, StreamGap
from pipeline.monitoring.state_sink import StateSink
from pipeline.state.health import NodeHealth, StreamHealth
from pipeline.state.posterior_json import posterior_summary
from pipeline.state.run_state import RunState
from sensors.errors import InputError
from sensors.json_values import Json, fields_of, known, with_nulls

API = 1  # of the answer: a field may come, none goes or changes its meaning under one number
STATUS_KEY = "pilewatch/@status"  # no stream's key expression matches what begins with @
ENDPOINT_FILE = "endpoint"  # in a session's folder while it runs
GAPS_LISTED = 20


class StatusNode(StateSink):
    """A sink that reports at any moment how the session does. Any thread may ask.

    Parameters
    ----------
    source : str
        What the session listens to, for people.
    clock : callable, optional
        → [ns since 1970-01-01 UTC].
    """

    name = "status"

    def __init__(self, source: str, clock: Callable[[], int] = time.time_ns) -> None:
        self.connections: Callable[[], Json] = dict  # → certificate's name or address → links
        self._source = source
        super().__init__(GAPS_LISTED, clock)

    def as_json(self) -> Json:
        """Return everything known now; names are stable."""
        with self._asked() as (run, now_ns):
            about = {"api": API, "source": self._source, "connections": self.connections()}
            return about | status_figures(run, now_ns)

    def answer(self, _asked: bytes = b"") -> bytes:
        """`as_json` as it travels: JSON knows no NaN and no ∞, which any sender may send."""
        return json.dumps(with_nulls(self.as_json()), allow_nan=False).encode()


def status_figures(run: RunState, now_ns: int) -> Json:
    """Return how a run does at a moment of the listener's clock [ns]."""
    turbines = run.turbines.values()
    gaps = sorted((gap for each in turbines for gap in each.gaps), key=lambda gap: gap.end_ns)
    return {
        "time_ns": now_ns,
        "nodes": [_node(run, each) for each in run.health.nodes(now_ns)],
        "streams": [_stream(each) for each in run.health.streams(now_ns)],
        "gaps": [_gap(each) for each in gaps[-GAPS_LISTED:]],
        "books": run.books.as_json(),
        "posteriors": [_posterior(each.posterior) for each in turbines if each.posterior],
    }


def _node(run: RunState, health: NodeHealth) -> Json:
    status = health.status
    newest = run.turbine(status.turbine).sequence
    behind = None
    if newest is not None and status.last_sequence >= 0:
        behind = max(0, newest - status.last_sequence)
    return {
        "node": status.node,
        "turbine": status.turbine,
        "condition": health.condition,
        "silence_s": health.silence,
        "behind_blocks": behind,
        "received": sum(each.count for each in status.received),
        **fields_of(status, "lost", "recovered", "late", "duplicate", "malformed", "busy_s"),
        "warnings": [each.text for each in status.warnings],
    }


def _stream(health: StreamHealth) -> Json:
    return fields_of(health, "key", "condition") | {
        "silence_s": health.silence,
        "messages": health.messages,
        "rate_hz": known(health.rate),
    }


def _gap(gap: StreamGap) -> Json:
    return fields_of(gap, "turbine", "unit", "start_ns") | {
        "duration_s": gap.duration,
        "blocks": gap.n_blocks,
    }


def _posterior(posterior: FoundationPosterior) -> Json:
    return posterior_summary(posterior) | {
        "turbine": posterior.turbine,
        "time_ns": posterior.time_ns,
        "windows": posterior.n_windows,
        "trusted": posterior.trusted,
        "sampler": posterior.sampler,
    }


def endpoint_of(out: Path) -> str:
    """Return where the session that runs in this folder can be asked.

    Raises InputError where none runs.
    """
    try:
        return (out / ENDPOINT_FILE).read_text(encoding="utf-8").strip()
    except OSError:
        raise InputError(
            f"no session runs in {out}: there is no {out / ENDPOINT_FILE}; name its folder with "
            "--out or its endpoint with --connect"
        ) from None
