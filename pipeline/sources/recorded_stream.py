"""Messages of sensors and controller as recorded: one file, or a folder as one stream."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from pipeline.sources.playback import SensorMessage, each_block_once
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.replayed import ReplayedTower
from sensors.acquisition.scada import ScadaSample
from sensors.errors import InputError


class SourceError(InputError):
    """A source that does not exist or cannot be understood."""


def recordings_in(path: Path) -> list[Path]:
    """Return the file itself, or every closed recording in a folder that has samples, oldest first.

    Returns
    -------
    list[Path]

    Raises
    ------
    SourceError
        For a folder without one, or a name that no file can have.
    """
    try:
        if not path.is_dir():
            return [path]
    except OSError as error:
        raise SourceError(f"cannot read the recording {path}: {error.strerror}") from error
    order = {}
    for file in path.glob("*.mcap"):
        units = recording_info(file).units
        if units:
            order[file] = (
                min(unit.start_ns for unit in units),
                file.stat().st_mtime_ns,
                file.name,
            )
    if not order:
        raise SourceError(f"the folder {path} holds no recording with acceleration blocks")
    return sorted(order, key=lambda file: order[file])


def recorded_stream(path: Path) -> Iterator[SensorMessage]:
    """Yield everything measured in a file, or in all files of a folder as one stream.

    The messages come in order of time.
    """
    files = recordings_in(path)
    if len(files) == 1:
        return iter(ReplayedTower(sensor_messages(files[0])))
    joined = (message for file in files for message in sensor_messages(file))
    return each_block_once(ReplayedTower(joined))


def sensor_messages(path: Path) -> Iterator[SensorMessage]:
    """Yield the messages of sensors and controller in the order of recording."""
    for message in read_messages(path, (SensorLayout, AccelerationBlock, ScadaSample)):
        if isinstance(message, AccelerationBlock | SensorLayout | ScadaSample):
            yield message
