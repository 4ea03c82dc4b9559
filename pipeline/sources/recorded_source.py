"""A recording as a source that needs no structure: what a tower unit replays and publishes."""

import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from pipeline.messages import FoundationTruth, Message
from pipeline.recording.info import RecordingInfo, recording_info
from pipeline.sources.ground_truth import (
    later_truths,
    recorded_truths,
    stored_truth,
    with_truths,
)
from pipeline.sources.recorded_stream import Playback, SourceError, recorded_stream, recordings_in
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.acquisition.pacing import Pace, paced
from sensors.acquisition.replayed import due_time
from sensors.acquisition.scada import ScadaSample


class MonotonicClock:
    """The machine's own clock, for pacing; a wait ends early when the session is to end."""

    def __init__(self, stopping: threading.Event) -> None:
        self._stopping = stopping

    def now(self) -> float:
        """[s]"""
        return time.monotonic()

    def wait(self, seconds: float) -> None:
        """Return after that time, or when the session is to end."""
        self._stopping.wait(seconds)


def due_of(message: Message) -> int | None:
    """Return when a message is given [ns]; None: at once."""
    if isinstance(message, AccelerationBlock | SensorLayout | ScadaSample):
        return due_time(message)
    return None


@dataclass(frozen=True, slots=True)
class RecordedSource:
    """What a recording holds of sensors and controller, without a scenario."""

    recording: Path
    """A file, or a folder of files."""

    layout: SensorLayout
    """Of the first turbine, its units joined."""

    layouts: Mapping[str, SensorLayout]
    """Turbine → its layout."""

    truth: FoundationTruth | None
    """True stiffness of a simulated turbine; None: unknown."""

    duration: float
    """[s]"""

    playback: Playback = field(default_factory=Playback)
    """Which part of it."""

    is_live: bool = False

    @property
    def text(self) -> str:
        """The source as `--source` names it."""
        return f"replay:{self.recording}"

    @property
    def turbines(self) -> tuple[str, ...]:
        """Turbines in the recording, in its order."""
        return tuple(self.layouts)

    def messages(
        self, speed: float = float("inf"), stopping: threading.Event | None = None
    ) -> Iterator[Message]:
        """Layout, truth where known, then blocks and SCADA samples, each when it is due."""
        pace = Pace(speed, MonotonicClock(stopping or threading.Event()))
        if self.truth is not None:
            yield self.truth
        recorded = recorded_with_truths(self.recording, self.playback, self.truth)
        yield from paced(recorded, pace=pace, time_of=due_of)


def recorded_with_truths(
    recording: Path, playback: Playback, first: FoundationTruth | None
) -> Iterator[Message]:
    """Yield what was measured in a part of a recording, and truths that differ from the first."""
    measured = playback.of(partial(recorded_stream, recording))
    return with_truths(measured, later_truths(recorded_truths(recording), first))


def recorded_source(path: Path) -> RecordedSource:
    """Return a recording, or all of a folder as one.

    Raises
    ------
    SourceError
    RecordingError
    """
    return source_of(path, [recording_info(file) for file in recordings_in(path)])


def source_of(path: Path, infos: Sequence[RecordingInfo]) -> RecordedSource:
    """Return the same from what is known of its files, oldest first; the newest has the layouts."""
    info = infos[-1]
    if not info.units or not info.layouts:
        raise SourceError(f"{path} holds no acceleration blocks with their layout")
    turbines = dict.fromkeys(layout.turbine for layout in info.layouts)
    layouts = {each: joined_layout(_units_of(info.layouts, each)) for each in turbines}
    layout = layouts[info.layouts[0].turbine]
    return RecordedSource(
        recording=path,
        layout=layout,
        layouts=layouts,
        truth=stored_truth(info.metadata, layout.turbine),
        duration=_duration(infos),
    )


def _duration(infos: Sequence[RecordingInfo]) -> float:
    units = [unit for info in infos for unit in info.units]
    span_ns = max(unit.end_ns for unit in units) - min(unit.start_ns for unit in units)
    return span_ns / NANOSECONDS


def _units_of(layouts: Sequence[SensorLayout], turbine: str) -> list[SensorLayout]:
    """Return the newest layout of each of the turbine's units, in their order."""
    newest = {layout.unit: layout for layout in layouts if layout.turbine == turbine}
    return [newest[unit] for unit in sorted(newest)]
