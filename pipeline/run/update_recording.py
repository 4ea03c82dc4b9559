"""Compute the posterior of a recording in one thread: `pilewatch update`."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.app import Outputs, build
from pipeline.messages import FoundationTruth, Message, ModalEstimate
from pipeline.monitoring.summary import SessionSummary
from pipeline.runtime.lock_step import run_lock_step
from pipeline.runtime.source_feed import BlockReport
from pipeline.sources.session_files import files_to_read, session_files, session_messages
from pipeline.sources.sources import Source
from sensors.acquisition.blocks import AccelerationBlock


def holds_estimates(path: Path) -> bool:
    """Return whether a recording, or the session in a folder, holds modal estimates."""
    return next(session_messages(files_to_read(path), (ModalEstimate,)), None) is not None


def update_from(
    source: Source, *, identify: bool, report: BlockReport | None = None
) -> SessionSummary:
    """Return the summary after updating with every window of a recording.

    Parameters
    ----------
    identify : bool
        True: from the accelerations; False: from the estimates that were recorded.
    report : Report | None, optional
        Called with every block of accelerations.
    """
    summary = SessionSummary(source=source.text, turbine=source.layout.turbine)
    graph = build(source.scenario, source.layout, Outputs(), source.layouts)
    nodes = [plan.make() for plan in graph]

    def count(block: AccelerationBlock) -> None:
        summary.run.fold(block)
        if report:
            report(block)

    if identify:
        messages, receiving = source.messages(), nodes
    else:
        messages, receiving = _estimates(source), [n for n in nodes if ModalEstimate in n.inputs]
    run_lock_step(messages, [*receiving, summary], turbine=source.layout.turbine, report=count)
    return summary


def _estimates(source: Source) -> Iterator[Message]:
    """Yield recorded estimates, truths and, to count the time, blocks."""
    assert source.recording is not None
    if source.truth is not None:
        yield source.truth
    wanted = (ModalEstimate, FoundationTruth, AccelerationBlock)
    yield from session_messages(session_files(source.recording), wanted)
