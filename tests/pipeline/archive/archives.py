"""Archives to reprocess, cut from one recording."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pipeline.messages import FoundationTruth, Message
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.writer import Recorder
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

MEASURED = (SensorLayout, AccelerationBlock, ScadaSample, FoundationTruth)


def cut_into_files(recording: Path, folder: Path, duration: float) -> list[Path]:
    """A recording as files of `duration` seconds, as a recorder that rotates writes them: the
    layout in each, sessions and counts of samples going on."""
    folder.mkdir(parents=True, exist_ok=True)
    metadata = read_metadata(recording)
    layouts: dict[str, Message] = {}
    recorders: dict[int, Recorder] = {}
    begun: int | None = None
    for message in read_messages(recording, MEASURED):
        if isinstance(message, SensorLayout):
            layouts[message.layout_id] = message
            for recorder in list(recorders.values())[-1:]:
                recorder.handle(message)
            continue
        time_ns = message.start_ns if isinstance(message, AccelerationBlock) else message.time_ns
        begun = time_ns if begun is None else begun
        number = int((time_ns - begun) // round(duration * NANOSECONDS))
        if number not in recorders:
            for earlier in recorders.values():
                earlier.close()
            path = folder / f"{number:05d}.mcap"
            recorders[number] = Recorder(path, metadata=metadata, clock=None)
            for layout in layouts.values():
                recorders[number].handle(layout)
        recorders[number].handle(message)
    for recorder in recorders.values():
        recorder.close()
    return [recorder.path for recorder in recorders.values()]


def rewritten(recording: Path, path: Path, change: "Change") -> Path:
    """The recording with every block as `change` makes it; None leaves one out."""
    recorder = Recorder(path, metadata=read_metadata(recording), clock=None)
    for message in _changed(recording, change):
        recorder.handle(message)
    recorder.close()
    return path


def tables_of(results: Path) -> dict[str, bytes]:
    """The bytes of every table's files, by their place in the results."""
    return {
        path.relative_to(results).as_posix(): path.read_bytes()
        for path in sorted(results.rglob("*.parquet"))
    }


class Change:
    """What happens to a recording's messages; as it is here, nothing."""

    def block(self, block: AccelerationBlock) -> AccelerationBlock | None:
        return block


class Renamed(Change):
    """The same measurements of another turbine."""

    def __init__(self, turbine: str) -> None:
        self._turbine = turbine

    def block(self, block: AccelerationBlock) -> AccelerationBlock:
        return replace(block, turbine=self._turbine)


def _changed(recording: Path, change: Change) -> Iterator[Message]:
    for message in read_messages(recording, MEASURED):
        if not isinstance(message, AccelerationBlock):
            turbine = getattr(change, "_turbine", message.turbine)
            yield replace(message, turbine=turbine)
        elif (changed := change.block(message)) is not None:
            yield changed
