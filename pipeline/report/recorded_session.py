"""Read what a session recorded, turbine by turbine, without its samples.

    session.mcap ─► session.part2.mcap ─► …  ─► RecordedSession ─► [TurbineRecord, …]

Memory grows with the windows, not with the samples: blocks are counted and dropped.
"""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipeline.messages import (
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    ParameterSummary,
    StabilisationDiagram,
    WindowRejected,
)
from pipeline.monitoring.summary import SessionSummary
from pipeline.recording.errors import RecordingError
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.writer import Metadata
from pipeline.report.pictures.samples import ChannelRecord
from pipeline.scenario import Scenario, scenario_from_metadata
from pipeline.sources.session_files import session_files, unfinished_files
from pipeline.updating.prior import PriorSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.errors import InputError

NO_FACTOR = np.empty((0, 0))


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

    def parameter(self, name: str) -> ParameterSummary:
        """Return the parameter of that name; KeyError where there is none."""
        for summary in self.parameters:
            if summary.name == name:
                return summary
        raise KeyError(name)


@dataclass(slots=True)
class TurbineRecord:
    """Everything of one turbine that a report contains; grows while the recording is read."""

    turbine: str
    summary: SessionSummary
    posteriors: dict[int, PosteriorAtWindow] = field(default_factory=dict)
    """Posteriors by the end of their window [ns]."""
    truths: dict[int, FoundationTruth] = field(default_factory=dict)
    """True stiffnesses by the time from which they hold [ns]."""
    layouts: dict[str, SensorLayout] = field(default_factory=dict)
    """Sensor layouts by acquisition unit."""
    sampling_rate: float = float("nan")
    """Sampling rate of the latest block [Hz]."""
    samples: dict[str, ChannelRecord] = field(default_factory=dict)
    """Spectra and statistics of the samples by acquisition unit."""
    stabilisation: StabilisationDiagram | None = None
    """Of the last identified window."""
    has_structure: bool = True
    """Whether the scenario has a structural model; without one there are modes only."""

    def take(self, message: Message) -> None:
        """Take one message of this turbine into account."""
        match message:
            case AccelerationBlock():
                self.summary.count(message)
                self.sampling_rate = message.sampling_rate
                if message.unit not in self.samples:
                    self.samples[message.unit] = ChannelRecord(message.sampling_rate)
                self.samples[message.unit].push(message)
            case StabilisationDiagram():
                if self.stabilisation is None or message.end_ns >= self.stabilisation.end_ns:
                    self.stabilisation = message
            case SensorLayout():
                self.layouts[message.unit] = message
            case ModalEstimate():
                self.summary.handle(without_factors(message))
            case FoundationPosterior():
                self._take_posterior(message)
            case FoundationTruth():
                self.truths[message.time_ns] = message
                self.summary.handle(message)
            case _:
                self.summary.handle(message)

    def _take_posterior(self, posterior: FoundationPosterior) -> None:
        self.summary.handle(posterior)
        self.posteriors[posterior.time_ns] = PosteriorAtWindow(
            posterior.time_ns,
            posterior.window,
            posterior.parameters,
            posterior.trusted,
            posterior.change_probability,
        )

    def true_stiffness(self, name: str, time_ns: int) -> float | None:
        """Return the simulated truth at that time in the spring's unit; None if unknown."""
        starts = [each for each in self.truths if each <= time_ns] or list(self.truths)[:1]
        return getattr(self.truths[max(starts)], name) if starts else None

    @property
    def has_results(self) -> bool:
        """Whether the recording holds results, if only a rejected window."""
        return bool(self.summary.estimates or self.summary.rejected or self.posteriors)

    @property
    def layout(self) -> SensorLayout | None:
        """The channels of all units; None where no layout was recorded."""
        units = [self.layouts[unit] for unit in sorted(self.layouts)]
        return joined_layout(units) if units else None

    @property
    def span_ns(self) -> tuple[int, int]:
        """First to last sample, or of the windows without samples [ns since 1970-01-01 UTC]."""
        summary = self.summary
        windows: list[ModalEstimate | WindowRejected] = [*summary.estimates, *summary.rejected]
        starts = [each.start_ns for each in windows]
        ends = [each.end_ns for each in windows] + list(self.posteriors)
        if summary.first_ns is not None:
            starts.append(summary.first_ns)
            ends.append(summary.last_ns or summary.first_ns)
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


def read_session(path: Path) -> RecordedSession:
    """Return a recorded session: a file, or a folder with its parts.

    Raises
    ------
    RecordingError
        If a file cannot be read or holds no results.
    SourceError
        For a folder without recordings.
    """
    files = session_files(path)
    turbines: dict[str, TurbineRecord] = {}
    for message in (message for file in files for message in read_messages(file)):
        turbine = message.turbine
        if turbine not in turbines:
            turbines[turbine] = TurbineRecord(turbine, SessionSummary(path.name, turbine))
        turbines[turbine].take(message)
    if not any(record.has_results for record in turbines.values()):
        raise RecordingError(
            f"{path} holds measurements but no results; `pilewatch run --source replay:{path}` "
            "makes a session of it that can be reported"
        )
    metadata = read_metadata(files[-1])
    scenario = _scenario(metadata)
    if scenario is not None:
        for record in turbines.values():
            record.has_structure = scenario.has_structure
    return RecordedSession(
        name=path.resolve().name,
        files=tuple(files),
        unread=tuple(unfinished_files(path)),
        metadata=metadata,
        prior=None if scenario is None else scenario.updating.prior,
        turbines=tuple(turbines[name] for name in sorted(turbines)),
    )


def _scenario(metadata: Metadata) -> Scenario | None:
    """Return the recorded scenario; None for one that this version cannot read."""
    try:
        return scenario_from_metadata(metadata["scenario"], "scenario")
    except (KeyError, InputError):
        return None


def without_factors(estimate: ModalEstimate) -> ModalEstimate:
    """Return the estimate without its covariance factors, by far its largest part."""
    modes = tuple(
        replace(mode, covariance_factor=NO_FACTOR, n_block_columns=0) for mode in estimate.modes
    )
    return replace(estimate, modes=modes)
