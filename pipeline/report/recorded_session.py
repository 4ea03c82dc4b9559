"""What a session recorded, turbine by turbine, without its samples: what a report is made of.

    session.mcap ─► session.part2.mcap ─► …  ─► RecordedSession ─► [TurbineRecord, …]

Memory grows with the windows, not with the samples: blocks are counted and let go.
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
    WindowRejected,
)
from pipeline.monitoring.summary import SessionSummary
from pipeline.recording.errors import RecordingError
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.writer import Metadata
from pipeline.scenario import scenario_from_metadata
from pipeline.sources.session_files import session_files, unfinished_files
from pipeline.updating.prior import PriorSettings
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.errors import InputError

NO_FACTOR = np.empty((0, 0))


@dataclass(frozen=True, slots=True)
class PosteriorAtWindow:
    """The marginals as one window left them."""

    time_ns: int  # end of the window
    window: int
    parameters: tuple[ParameterSummary, ...]
    trusted: bool
    change_probability: float  # that the modes have changed since the last event [-]

    def parameter(self, name: str) -> ParameterSummary:
        """The parameter of that name; KeyError where there is none."""
        for summary in self.parameters:
            if summary.name == name:
                return summary
        raise KeyError(name)


@dataclass(slots=True)
class TurbineRecord:
    """Everything of one turbine that a report tells; grows while the recording is read."""

    turbine: str
    summary: SessionSummary
    posteriors: dict[int, PosteriorAtWindow] = field(default_factory=dict)  # by end [ns]
    truths: dict[int, FoundationTruth] = field(default_factory=dict)  # by when they begin [ns]
    layouts: dict[str, SensorLayout] = field(default_factory=dict)  # by unit
    sampling_rate: float = float("nan")  # [Hz]

    def take(self, message: Message) -> None:
        """Remember one message of this turbine."""
        match message:
            case AccelerationBlock():
                self.summary.count(message)
                self.sampling_rate = message.sampling_rate
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
        """The simulated truth at that time in the spring's unit; None where it is not known."""
        begun = [each for each in self.truths if each <= time_ns] or list(self.truths)[:1]
        return getattr(self.truths[max(begun)], name) if begun else None

    @property
    def has_results(self) -> bool:
        """Whether anything was made of the measurements, if only a rejection."""
        return bool(self.summary.estimates or self.summary.rejected or self.posteriors)

    @property
    def layout(self) -> SensorLayout | None:
        """The channels of all units; None where no layout was recorded."""
        units = [self.layouts[unit] for unit in sorted(self.layouts)]
        return joined_layout(units) if units else None

    @property
    def span_ns(self) -> tuple[int, int]:
        """From the first sample to the last; where the samples have gone, of the windows
        [ns since 1970-01-01 UTC]."""
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
    """A session as its files tell it."""

    name: str
    files: tuple[Path, ...]
    unread: tuple[Path, ...]  # parts that are still being written
    metadata: Metadata  # of the last part
    prior: PriorSettings | None  # of its scenario; None where it is not known
    turbines: tuple[TurbineRecord, ...]


def read_session(path: Path) -> RecordedSession:
    """A recorded session: a file, or a folder with its parts.

    Raises RecordingError where a file cannot be read, and where nothing was made of the
    measurements yet; SourceError for a folder without recordings.
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
    return RecordedSession(
        name=path.resolve().name,
        files=tuple(files),
        unread=tuple(unfinished_files(path)),
        metadata=metadata,
        prior=_prior(metadata),
        turbines=tuple(turbines[name] for name in sorted(turbines)),
    )


def _prior(metadata: Metadata) -> PriorSettings | None:
    """What the updating allowed; a scenario of another version may not be readable any more."""
    try:
        return scenario_from_metadata(metadata["scenario"], "scenario").updating.prior
    except (KeyError, InputError):
        return None


def without_factors(estimate: ModalEstimate) -> ModalEstimate:
    """The estimate without its covariance factors, by far its largest part."""
    modes = tuple(
        replace(mode, covariance_factor=NO_FACTOR, n_block_columns=0) for mode in estimate.modes
    )
    return replace(estimate, modes=modes)
