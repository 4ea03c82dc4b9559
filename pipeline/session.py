"""One session from its source to its summary: what `pilewatch run` does.

Files of an earlier session are set aside under their date, never overwritten. Whatever ends the
session early, what was recorded is closed properly and the summary says what is known.
"""

import json
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pipeline import runner
from pipeline.app import Outputs, build
from pipeline.sources import Source
from pipeline.summary import Json, SessionSummary
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from pipeline.viewer.outputs import RrdFile, ViewerOutput, require_rerun
from sensors.blocks import AccelerationBlock
from sensors.errors import InputError

logger = logging.getLogger(__name__)

RECORDING, PICTURES, SUMMARY = "session.mcap", "session.rrd", "summary.json"
Way = Literal["threads", "processes", "lock-step"]


@dataclass(frozen=True, slots=True)
class SessionOptions:
    """What a person may choose about a session, beside its source."""

    out: Path = Path("out")
    speed: float = float("inf")  # 1: real time; infinity: as fast as the nodes follow
    way: Way = "threads"
    rrd: bool = True  # write out/session.rrd
    view: ViewerOutput | None = None  # a viewer beside it
    zenoh: ZenohSettings = ZenohSettings()


@dataclass(frozen=True, slots=True)
class Session:
    """What came out."""

    summary: SessionSummary
    figures: Json  # the content of summary.json
    files: tuple[Path, ...]


def run_session(
    source: Source,
    options: SessionOptions,
    *,
    report: Callable[[AccelerationBlock], None] | None = None,
    scenario_option: str | None = None,
    stopping: threading.Event | None = None,
) -> Session:
    """Run a source through the whole graph and write recording, pictures and summary.

    report            called with every block that the source gives
    scenario_option   as the person named it, for nodes in other processes
    stopping          ends the session when set (Ctrl-C, SIGTERM)

    Raises InputError for what a person can mend, NodeFailed for what must be looked into.
    """
    started = time.monotonic()
    source = prepare_folder(source, options.out)
    outputs = session_outputs(source, options)
    summary = SessionSummary(source=source.text, turbine=source.layout.turbine)

    def account(block: AccelerationBlock) -> None:
        summary.count(block)
        if report:
            report(block)

    try:
        _run(source, options, outputs, summary, account, scenario_option, stopping)
    finally:
        figures = summary.as_json(wall=time.monotonic() - started)
        written = json.dumps(figures, indent=2, ensure_ascii=False, allow_nan=False)
        (options.out / SUMMARY).write_text(written + "\n", encoding="utf-8")
    files = tuple(options.out / name for name in (RECORDING, PICTURES, SUMMARY))
    return Session(summary, figures, tuple(path for path in files if path.exists()))


def session_outputs(source: Source, options: SessionOptions) -> Outputs:
    """The files and viewers of a session. Raises ViewerError where rerun is missing."""
    views: tuple[ViewerOutput, ...] = (RrdFile(options.out / PICTURES),) if options.rrd else ()
    if options.view is not None:
        views += (options.view,)
    if views:
        require_rerun(views)
    return Outputs(options.out / RECORDING, source.metadata, views)


def _run(
    source: Source,
    options: SessionOptions,
    outputs: Outputs,
    summary: SessionSummary,
    report: Callable[[AccelerationBlock], None],
    scenario_option: str | None,
    stopping: threading.Event | None,
) -> None:
    turbine = source.layout.turbine
    graph = build(source.scenario, source.layout, outputs)
    messages = None if source.is_live else source.messages(options.speed)
    as_fast_as_possible = options.speed == float("inf")
    credit = source.scenario.flow.unacknowledged_blocks if as_fast_as_possible else None
    if options.way == "lock-step":
        if messages is None:
            raise InputError("a live source cannot be run in lock-step: it waits for nobody")
        nodes = [make() for make in graph.values()]
        runner.run_lock_step(messages, [*nodes, summary], turbine=turbine, report=report)
        return
    with runner.hub(options.zenoh, ZenohBus) as hub:
        ...
