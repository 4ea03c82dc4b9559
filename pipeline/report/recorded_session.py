"""Read what a session recorded, turbine by turbine, without its samples.

    session.mcap ─► session.part2.mcap ─► …  ─► RecordedSession ─► [TurbineRecord, …]

Memory grows with the windows, not with the samples: blocks are counted and dropped.
"""

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.messages import (
    ModalEstimate,
    WindowRejected,
)
from pipeline.monitoring.summary import turbine_figures
from pipeline.recording.errors import RecordingError
from pipeline.recording.reader import read_metadata
from pipeline.recording.writer import Metadata
from pipeline.report.pictures.samples import SignalRecord
from pipeline.scenario import Scenario, scenario_from_metadata
from pipeline.sources.session_files import (
    earlier_sessions,
    session_files,
    session_messages,
    unfinished_files,
)
from pipeline.state.run_state import RunState
from pipeline.state.turbine_state import TurbineState
from pipeline.updating.prior import PriorSettings
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.errors import InputError
from sensors.json_values import Json


@dataclass(frozen=True, slots=True)
class TurbineRecord:
    """Everything of one turbine that a report contains."""

    turbine: str
    run: RunState = field(default_factory=RunState)
    """State of the recorded run after its last message."""
    has_structure: bool = True
    """Whether the scenario has a structural model; without one there are modes only."""
    signals: SignalRecord = field(default_factory=SignalRecord)
    """Spectra and statistics of the samples, and the last stabilisation diagram."""

    @property
    def state(self) -> TurbineState:
        """State of the turbine after the last message."""
        return self.run.reported(self.turbine)

    @property
    def figures(self) -> Json:
        """The turbine's part of `summary.json`."""
        return turbine_figures(self.run, self.turbine)

    def true_stiffness(self, name: str, time_ns: int) -> float | None:
        """Return the simulated truth at that time in the spring's unit; None if unknown."""
        truths = self.state.truths
        starts = [each for each in truths if each <= time_ns] or list(truths)[:1]
        return getattr(truths[max(starts)], name) if starts else None

    @property
    def has_results(self) -> bool:
        """Whether the recording holds results, if only a rejected window."""
        return bool(self.state.estimates or self.state.rejected or self.state.posteriors)

    @property
    def layout(self) -> SensorLayout | None:
        """The channels of all units; None where no layout was recorded."""
        layouts = self.state.layouts
        units = [layouts[unit] for unit in sorted(layouts)]
        return joined_layout(units) if units else None

    @property
    def span_ns(self) -> tuple[int, int]:
        """First to last sample, or of the windows without samples [ns since 1970-01-01 UTC]."""
        state = self.state
        windows: list[ModalEstimate | WindowRejected] = [*state.estimates, *state.rejected]
        starts = [each.start_ns for each in windows]
        ends = [each.end_ns for each in windows] + list(state.posteriors)
        if state.first_ns is not None:
            starts.append(state.first_ns)
            ends.append(state.last_ns or state.first_ns)
        return min(starts, default=0), max(ends, default=0)


@dataclass(frozen=True, slots=True)
class RecordedSession:
    """A session as read from its files."""

    name: str
    files: tuple[Path, ...]
    unread: tuple[Path, ...]
    """Parts that are still being written."""
    metadata: Metadata
    """Metadata of the last part."""
    prior: PriorSettings | None
    """Prior of its scenario; None where it is not known."""
    turbines: tuple[TurbineRecord, ...]
    others: tuple[Path, ...] = ()
    """Recordings of other sessions in its folder."""


def read_session(path: Path) -> RecordedSession:
    """Return a recorded session: a file, or a folder with its parts and earlier starts.

    Raises
    ------
    RecordingError
        If a file cannot be read or holds no results.
    SourceError
        For a folder without recordings.
    """
    files = session_files(path)
    run = RunState(once=True)  # a start records again what publishers send again
    signals: defaultdict[str, SignalRecord] = defaultdict(SignalRecord)
    for message in session_messages(files):
        run.fold(message)
        signals[message.turbine].fold(message)
    metadata = read_metadata(files[-1])
    scenario = _scenario(metadata)
    has_structure = scenario is None or scenario.has_structure
    turbines = [
        TurbineRecord(name, run, has_structure=has_structure, signals=signals[name])
        for name in sorted(run.measured)
    ]
    if not any(record.has_results for record in turbines):
        raise RecordingError(
            f"{path} holds measurements but no results; `pilewatch run --source replay:{path}` "
            "makes a session of it that can be reported"
        )
    return RecordedSession(
        name=path.resolve().name,
        files=tuple(files),
        unread=tuple(unfinished_files(path)),
        metadata=metadata,
        prior=None if scenario is None else scenario.updating.prior,
        turbines=tuple(turbines),
        others=tuple(earlier_sessions(path)),
    )


def _scenario(metadata: Metadata) -> Scenario | None:
    """Return the recorded scenario; None for one that this version cannot read."""
    try:
        return scenario_from_metadata(metadata["scenario"], "scenario")
    except (KeyError, InputError):
        return None
