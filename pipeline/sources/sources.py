"""What a session listens to: a recording, a simulation, or instruments that publish."""

import heapq
import logging
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.messages import FoundationTruth, Message
from pipeline.recording.info import recording_info
from pipeline.recording.writer import Metadata, RecorderSettings, whole_recording
from pipeline.runtime.source_feed import with_end
from pipeline.scenario import (
    DEFAULT_SCENARIO,
    MODES_ONLY,
    Scenario,
    farm_members,
    load_scenario,
    modes_only,
    require_stated_structure,
    scenario_from_metadata,
    scenario_metadata,
    with_sampler,
)
from pipeline.scenario.differences import other_settings
from pipeline.sources.folder_differences import report_other_layouts, report_shared_times
from pipeline.sources.ground_truth import (
    later_truths,
    simulated_truths,
    with_truths,
)
from pipeline.sources.recorded_source import (
    MonotonicClock,
    due_of,
    recorded_with_truths,
    source_of,
)
from pipeline.sources.recorded_stream import Playback, SourceError, recordings_in
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.acquisition.pacing import Pace, paced
from sensors.acquisition.scada import ScadaSample
from sensors.simulation.tower import CHUNKS_AHEAD, SimulatedTower

if TYPE_CHECKING:
    from sensors.feeds.live import LiveFeed

logger = logging.getLogger(__name__)

DEFAULT_RECORDING = Path("recordings/parked.mcap")
LAYOUT_FILE, SCENARIO_FILE = "layout.toml", "scenario.toml"  # of a folder by `pilewatch new`
SHIPPED_RECORDING = Path(__file__).parents[1] / DEFAULT_RECORDING  # in the wheel
COMPACT = RecorderSettings(chunk_duration=600.0, chunk_bytes=2**22)  # nothing is at risk here


@dataclass(frozen=True, slots=True)
class Source:
    """Where a session's messages come from, and what is known of them beforehand."""

    text: str
    """The source as `--source` names it."""

    scenario: Scenario
    layout: SensorLayout
    truth: FoundationTruth | None
    """True stiffness of a simulated turbine; None: unknown."""

    duration: float | None
    """Duration [s]; None: live, without end."""

    recording: Path | None = None
    """Recording of a replay: a file, or a folder of files."""

    playback: Playback = field(default_factory=Playback)
    """Which part of it."""

    layouts: Mapping[str, SensorLayout] = field(default_factory=dict)
    """Turbine → its layout, of a recording or of layout files."""

    layout_files: tuple[Path, ...] = ()
    """Of a live source: the files of its units' channels."""

    feed: "LiveFeed | None" = None
    """Feed of an instrument that the session listens to itself."""

    @property
    def is_live(self) -> bool:
        """Whether the source goes on without end."""
        return self.duration is None

    @property
    def turbines(self) -> tuple[str, ...]:
        """Turbines that are known beforehand, in order: a recording's, or the scenario's.

        Layout files add none: shards on machines without these files deal alike.
        """
        recorded = () if self.is_live else tuple(self.layouts)
        return recorded or tuple(m.turbine.id for m in farm_members(self.scenario))

    @property
    def metadata(self) -> Metadata:
        """What is stored in a recording, so that it can be run again."""
        truth = (
            {}
            if self.truth is None
            else {
                name: repr(getattr(self.truth, name)) for name in ("k11", "k22", "k12", "time_ns")
            }
        )
        return {
            "pilewatch": {"version": version("pilewatch"), "source": self.text},
            "scenario": scenario_metadata(self.scenario),
        } | ({"truth": truth} if truth else {})

    def messages(
        self, speed: float = float("inf"), stopping: threading.Event | None = None
    ) -> Iterator[Message]:
        """Layout, truth where known, then blocks and SCADA samples, each when it is due.

        Parameters
        ----------
        speed : float, optional
            1 is real time; infinity never waits.
        stopping : threading.Event, optional
            Ends the waiting when set.
        """
        pace = Pace(speed, MonotonicClock(stopping or threading.Event()))
        if self.truth is not None:
            yield self.truth
        yield from paced(self._sensor_messages(), pace=pace, time_of=due_of)

    def with_sampler(self, method: str | None) -> "Source":
        """Return the same under another sampler of the posterior; None: the scenario's.

        Raises
        ------
        UpdatingError
            For a sampler that does not exist.
        """
        return (
            self if method is None else replace(self, scenario=with_sampler(self.scenario, method))
        )

    def with_playback(self, playback: Playback) -> "Source":
        """Return a part of the same replay, or several rounds of it.

        Raises
        ------
        SourceError
            If there is nothing recorded, or nothing in the range.
        """
        if playback == Playback():
            return self
        if self.recording is None or self.duration is None:
            raise SourceError(f"--from, --to and --loop are for replay:FILE, not for {self.text}")
        duration = playback.duration(self.duration)
        if duration <= 0:
            raise SourceError(
                f"--from {playback.start:g} lies behind the end of {self.recording}, which is "
                f"{self.duration:g} s long"
            )
        return replace(self, playback=playback, duration=duration)

    def with_recording(self, path: Path) -> "Source":
        """Return the same replay from a file that was moved."""
        return replace(self, recording=path)

    def _sensor_messages(self) -> Iterator[Message]:
        if self.recording is not None:
            yield from recorded_with_truths(self.recording, self.playback, self.truth)
            return
        members = farm_members(self.scenario)
        ahead = max(1, CHUNKS_AHEAD // len(members))  # of loads in memory, by tower
        towers = [simulated_tower(member, chunks_ahead=ahead) for member in members]
        yield from (layout for tower in towers for layout in tower.layouts)
        yield from heapq.merge(*(self._simulated(tower) for tower in towers), key=_begin)

    def _simulated(self, tower: SimulatedTower) -> Iterator[Message]:
        """Everything of one turbine but its layout and the truth that was published already."""
        return with_truths(tower.messages(), later_truths(simulated_truths(tower), self.truth))


def _begin(message: Message) -> int:
    """Return where a message stands among those of other turbines [ns]."""
    match message:
        case AccelerationBlock():
            return message.start_ns
        case FoundationTruth() | ScadaSample():
            return message.time_ns
        case _:
            return 0


def open_source(
    text: str | None, scenario: str | None = None, layout_files: Sequence[Path] = ()
) -> Source:
    """Return the source that `--source` names: replay:FILE, simulate:SCENARIO or live.

    Parameters
    ----------
    text : str or None
        None: replay the recording that comes with the project.
    scenario : str, optional
        Name or path; None: the recording's own, the simulated one, or modes only.
    layout_files : sequence of Path, optional
        Of a live source: one of each acquisition unit; () takes the scenario's sensors.

    Raises
    ------
    SourceError
    LayoutError
    ScenarioError
    RecordingError
    """
    if layout_files and text != "live":
        raise SourceError(
            f"--layout {layout_files[0]} is for a file of measurements, an instrument or "
            f"--source live, not for {text}"
        )
    if text is None:
        return _default_source(scenario)
    kind, _, name = text.partition(":")
    if kind == "replay" and name:
        return replayed(Path(name), scenario)
    if kind == "simulate":
        if name and scenario is not None and scenario != name:
            raise SourceError(
                f"--scenario {scenario} and --source {text} name two scenarios; leave one out"
            )
        if not (name or scenario):
            raise SourceError(
                f"--source {text}: which scenario? simulate:NAME or simulate:FILE.toml; "
                "`pilewatch simulate --list` names the shipped ones"
            )
        return simulated(load_scenario(name or scenario or ""))
    if text == "live":
        if scenario is None:
            report_modes_only("live")
        chosen = require_stated_structure(load_scenario(scenario or MODES_ONLY))
        return _live(chosen, tuple(layout_files))
    if Path(text).is_file() and text.endswith(".mcap"):
        raise SourceError(f"--source {text} is a recording: --source replay:{text} replays it")
    if Path(text).is_file():
        raise SourceError(
            f"--source {text} is a file of measurements; `pilewatch import` makes a recording of "
            "it, which replay:FILE.mcap names"
        )
    if kind == "replay":
        raise SourceError(f"--source {text}: which recording? replay:FILE.mcap or replay:FOLDER")
    raise SourceError(
        f"--source {text!r} is none of replay:FILE, simulate:SCENARIO, live, the address of an "
        "instrument (mqtt://HOST/TOPIC, …) and a file that exists"
    )


def _live(scenario: Scenario, layout_files: tuple[Path, ...]) -> Source:
    """Return what instruments publish; the model is read at the layout files' channels, where
    there are none at the scenario's sensors."""
    from sensors.feeds.assembly.channel_map import sensor_layout
    from sensors.files.layout_file import load_layout

    by_turbine: dict[str, dict[str, SensorLayout]] = {}
    for path in layout_files:
        layout = sensor_layout(load_layout(path))
        units = by_turbine.setdefault(layout.turbine, {})
        if layout.unit in units:
            raise SourceError(
                f"--layout {path}: unit {layout.unit} of {layout.turbine} has a layout already; "
                "give each acquisition unit a `unit` of its own"
            )
        units[layout.unit] = layout
    layouts = {  # joined in the order in which the identification joins units
        turbine: joined_layout([units[name] for name in sorted(units)])
        for turbine, units in by_turbine.items()
    }
    first = next(iter(layouts.values()), None) or farm_members(scenario)[0].layout
    return Source(
        "live",
        scenario,
        first,
        truth=None,
        duration=None,
        layouts=layouts,
        layout_files=layout_files,
    )


def report_modes_only(source: str) -> None:
    """Report once a run that no structure is known of this source: it is never assumed."""
    logger.warning(
        "%s: no scenario and so no structure is given: modes are tracked, no stiffness is updated "
        "(--scenario NAME or FILE gives one)",
        source,
    )


def _default_source(scenario: str | None) -> Source:
    if DEFAULT_RECORDING.exists():
        return replayed(DEFAULT_RECORDING, scenario)
    own = sorted(DEFAULT_RECORDING.parent.glob("*.mcap"))
    if len(own) == 1:  # a folder that `pilewatch new` made
        return replayed(own[0], scenario)
    if SHIPPED_RECORDING.exists() and not own:
        return replayed(SHIPPED_RECORDING, scenario)
    raise SourceError(
        f"there is no {DEFAULT_RECORDING} in this folder; make one with "
        f"`pilewatch simulate {DEFAULT_SCENARIO} -o {DEFAULT_RECORDING}`, "
        "or choose --source replay:FILE or --source simulate:SCENARIO"
    )


def default_scenario() -> str | None:
    """Return the scenario file of the working folder if `pilewatch new` made the folder, else None.

    The file may have been edited since its copy was stored in the folder's recording.
    """
    files = (LAYOUT_FILE, SCENARIO_FILE)
    if DEFAULT_RECORDING.exists() or not all(Path(file).exists() for file in files):
        return None
    n_recordings = len(list(DEFAULT_RECORDING.parent.glob("*.mcap")))
    return SCENARIO_FILE if n_recordings == 1 else None


def replayed(path: Path, scenario: str | None = None) -> Source:
    """Return a recording, or all of a folder as one, as a source.

    Under its own (the newest's) scenario unless another is named.
    """
    infos = [recording_info(file) for file in recordings_in(path)]
    recorded = source_of(path, infos)
    stored = infos[-1].metadata.get("scenario")
    report_other_layouts(infos)
    report_shared_times(infos)
    if scenario is not None:
        chosen = load_scenario(scenario)
        if recorded.truth is None:  # measured
            require_stated_structure(chosen)
    elif stored:
        chosen = scenario_from_metadata(stored, f"scenario in {path}")
        files = [(str(info.path), info.metadata.get("scenario", {})) for info in reversed(infos)]
        for turbine in recorded.turbines:
            for line in other_settings(files, chosen, turbine):
                logger.warning("%s: %s", turbine, line)
    else:
        report_modes_only(str(path))
        chosen = modes_only(recorded.layout.turbine)
    return Source(
        text=recorded.text,
        scenario=chosen,
        layout=recorded.layout,
        truth=recorded.truth,
        duration=recorded.duration,
        recording=path,
        layouts=recorded.layouts,
    )


def replayed_with_structure(path: Path, scenario: str | None = None) -> Source:
    """Return what `replayed` does, where there is a structure to update.

    Parameters
    ----------
    path : Path
        Of the recording.
    scenario : str, optional
        Name or file; None: the recording's own.

    Raises
    ------
    RecordingError, SourceError, ScenarioError
        Also where there is none.
    """
    source = replayed(path, scenario)
    if not source.scenario.has_structure:
        raise SourceError(
            f"{path}: its scenario ({source.scenario.name}) has no structural model, so there is "
            "no stiffness to update; --scenario NAME or FILE gives one, `pilewatch report` has "
            "the modes"
        )
    return source


def simulated(scenario: Scenario) -> Source:
    """Return the scenario's simulated turbine as a source."""
    first = farm_members(scenario)[0]
    return Source(
        text=f"simulate:{scenario.name}",
        scenario=scenario,
        layout=first.layout,
        truth=next(simulated_truths(simulated_tower(first))),
        duration=scenario.simulation.duration,
    )


def simulated_tower(scenario: Scenario, *, chunks_ahead: int = CHUNKS_AHEAD) -> SimulatedTower:
    """Return the turbine that a scenario simulates, its random numbers from the scenario's seed."""
    settings = replace(scenario.simulation, seed=scenario.seed)
    return SimulatedTower(scenario.structure, scenario.layout, settings, chunks_ahead=chunks_ahead)


def record_simulation(
    source: Source, path: Path, *, report: Callable[[AccelerationBlock], None] | None = None
) -> None:
    """Write a simulated source to an MCAP file; the same scenario gives the same file.

    Parameters
    ----------
    source : Source
        Simulated.
    path : Path
        Of the recording.
    report : callable, optional
        Called with each block that is written.

    Raises
    ------
    RecordingError
        If the file exists or cannot be written.
    """
    with whole_recording(path, metadata=source.metadata, settings=COMPACT) as recorder:
        for message in with_end(source.messages()):
            recorder.handle(message)
            if report and isinstance(message, AccelerationBlock):
                report(message)
