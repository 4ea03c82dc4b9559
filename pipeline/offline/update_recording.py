"""The posterior that a recording gives, in one thread: what `pilewatch update` does."""

from collections.abc import Callable, Iterator
from pathlib import Path

from pipeline.app import Outputs, build
from pipeline.messages import FoundationTruth, Message, ModalEstimate
from pipeline.monitoring.summary import SessionSummary
from pipeline.recording.reader import read_messages
from pipeline.runtime.runner import run_lock_step
from pipeline.sources.sources import Source, replayed
from sensors.acquisition.blocks import AccelerationBlock

Report = Callable[[AccelerationBlock], None]


def recorded_source(path: Path, *, scenario: str | None, sampler: str | None) -> Source:
    """A recording under its own scenario, unless another one or another sampler is named.

    Raises RecordingError, SourceError, ScenarioError, UpdatingError.
    """
    return replayed(path, scenario).with_sampler(sampler)


def holds_estimates(path: Path) -> bool:
    """Whether a recording's windows were identified when it was made."""
    return next(iter(read_messages(path, (ModalEstimate,))), None) is not None


def updated_from(source: Source, *, identify: bool, report: Report | None = None) -> SessionSummary:
    """Every window of a recording through the updating.

    identify   True: from the accelerations; False: from the estimates that were recorded
    report     called with every block of accelerations
    """
    summary = SessionSummary(source=source.text, turbine=source.layout.turbine)
    graph = build(source.scenario, source.layout, Outputs(), source.layouts)
    nodes = [plan.make() for plan in graph]

    def count(block: AccelerationBlock) -> None:
        summary.count(block)
        if report:
            report(block)

    if identify:
        messages, taking = source.messages(), nodes
    else:
        messages, taking = _estimates(source), [n for n in nodes if ModalEstimate in n.inputs]
    run_lock_step(messages, [*taking, summary], turbine=source.layout.turbine, report=count)
    return summary


def _estimates(source: Source) -> Iterator[Message]:
    """What was identified, and the truth where it is known; blocks only for the account of time."""
    assert source.recording is not None
    if source.truth is not None:
        yield source.truth
    wanted = (ModalEstimate, FoundationTruth, AccelerationBlock)
    yield from read_messages(source.recording, wanted)
