"""Messages of sensors and controller as recorded: one file, or a folder as one stream."""

from collections.abc import Iterator
from pathlib import Path

from pipeline.recording.file_order import logical_starts, stretch_of
from pipeline.recording.info import UnitInfo, recording_info
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

    Files of one boot of a unit follow its count of samples, whatever its clock says.

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
    found = [(file, unit) for file in sorted(path.glob("*.mcap")) for unit in _units(file)]
    if not found:
        raise SourceError(f"the folder {path} holds no recording with acceleration blocks")
    starts = logical_starts([stretch_of(file, unit) for file, unit in found])
    first: dict[Path, int] = {}
    for (file, _), start in zip(found, starts, strict=True):
        first[file] = min(start, first.get(file, start))
    return sorted(first, key=lambda file: (first[file], file.stat().st_mtime_ns, file.name))


def _units(file: Path) -> tuple[UnitInfo, ...]:
    return recording_info(file).units


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
