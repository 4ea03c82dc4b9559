"""Export accelerations as messages of inertial measurement units, one IMU per level.

    FILE.mcap ─► imu.mcap     /TURBINE/UNIT/z145/imu, one sensor_msgs/Imu a sample

A block holds seconds of many channels, which general viewers list but do not draw. Here every
sample is a message of its own, along the tower's axes: x fore-aft, y side-side, z up.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import LIBRARY_IDENTIFIER, Writer
from numpy.typing import NDArray

from pipeline.export.export import Exported, recorded_samples
from pipeline.export.ros_messages import DEFINITION, TYPE, imu_messages
from pipeline.export.samples import sample_times
from pipeline.sources.session_files import session_files
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError


class ImuFile:
    """Write messages to `path`, compressed chunk by chunk.

    The file is finished when the context ends, and removed after an error before the first message.

    Raises
    ------
    InputError
        If the file exists or cannot be created.
    """

    def __init__(self, path: Path) -> None:
        self.count = 0  # messages written
        self._path = path
        self._topics: dict[str, int] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = path.open("xb")
        except FileExistsError:
            raise InputError(f"{path} exists already; name another folder with -o") from None
        except OSError as error:
            raise InputError(f"cannot write {path}: {error.strerror or error}") from error
        self._writer = Writer(self._file)
        self._writer.start(profile=Profile.ROS2, library=f"pilewatch ({LIBRARY_IDENTIFIER})")
        self._schema = self._writer.register_schema(
            TYPE, SchemaEncoding.ROS2, DEFINITION.encode("ascii")
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._writer.finish()
        self._file.close()
        if error is not None and self.count == 0:
            self._path.unlink()

    def write(self, topic: str, times_ns: NDArray[np.int64], messages: Sequence[bytes]) -> None:
        """Consecutive messages of one instrument, each at its own time."""
        if topic not in self._topics:
            self._topics[topic] = self._writer.register_channel(
                topic, MessageEncoding.CDR, self._schema
            )
        channel = self._topics[topic]
        for time_ns, message in zip(times_ns.tolist(), messages, strict=True):
            self._writer.add_message(channel, log_time=time_ns, publish_time=time_ns, data=message)
        self.count += len(messages)


SENSOR_AXES = np.eye(3)
FILE_NAME = "imu.mcap"


@dataclass(frozen=True, slots=True, eq=False)
class Imu:
    """The channels of one place that together measure up to three directions."""

    name: str
    """"z145"; of the second at the same level "z145-2"."""
    columns: tuple[int, ...]
    """Columns of the unit's blocks."""
    axes: NDArray[np.float64]
    """Readings to x, y, z, shape (n_channels, 3) [-]; NaN along an unmeasured axis."""

    def accelerations(self, samples: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return accelerations along x, y, z, shape (n_samples, 3) [m/s²]; NaN if unmeasured."""
        return np.asarray(samples[:, self.columns].astype(float) @ self.axes)


def imus_of(layout: SensorLayout) -> tuple[Imu, ...]:
    """Group channels of one elevation into an IMU while their directions are independent.

    Raises
    ------
    InputError
        If a channel is no accelerometer.
    """
    groups: dict[str, list[int]] = {}
    for column, channel in enumerate(layout.channels):
        if channel.unit not in ("m/s²", ""):
            raise InputError(
                f"--imu: channel {channel.name} of layout {layout.layout_id} is in {channel.unit}; "
                "an IMU's are accelerations in m/s²; export it with --csv or --parquet"
            )
        name, number = f"z{channel.elevation:g}", 1
        while not _independent(layout, [*groups.get(name, []), column]):
            number += 1
            name = f"z{channel.elevation:g}-{number}"
        groups.setdefault(name, []).append(column)
    return tuple(
        Imu(name, tuple(columns), _axes(layout.directions[columns]))
        for name, columns in groups.items()
    )


def _independent(layout: SensorLayout, columns: list[int]) -> bool:
    return int(np.linalg.matrix_rank(layout.directions[columns], tol=1e-3)) == len(columns)


def _axes(directions: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return readings to x, y, z, shape (n_channels, 3): a reading is direction · acceleration."""
    inverse = np.linalg.pinv(directions)  # (3, n_channels)
    measured = np.isclose(inverse @ directions, SENSOR_AXES, atol=1e-6).all(axis=1)
    inverse[~measured] = np.nan
    return np.asarray(inverse.T)


def export_imu(
    recording: Path,
    folder: Path,
    *,
    report: Callable[[AccelerationBlock], None] | None = None,
) -> tuple[Exported, ...]:
    """Write the samples of a recording, or of a session's folder, as `imu.mcap`.

    Raises
    ------
    RecordingError, SourceError, InputError
        If the file exists or cannot be written, or where a block's layout is not known.
    """
    files = session_files(recording)
    path = folder / FILE_NAME
    with ImuFile(path) as out:
        for block, layout in recorded_samples(files):
            for imu, messages in _messages(block, layout):
                topic = "/".join(("", *map(_as_part, (block.turbine, block.unit)), imu.name, "imu"))
                out.write(topic, sample_times(block), messages)
            if report:
                report(block)
    return (Exported(path, out.count),)


def _messages(
    block: AccelerationBlock, layout: SensorLayout | None
) -> Iterator[tuple[Imu, list[bytes]]]:
    if layout is None or len(layout.channels) != block.samples.shape[1]:
        raise InputError(
            f"--imu: the recording has no positions of the {block.samples.shape[1]} channels of "
            f"unit {block.unit} (layout {block.layout_id}); export them with --csv or --parquet"
        )
    times_ns = sample_times(block)
    for imu in imus_of(layout):
        frame = f"{block.turbine}/{block.unit}/{imu.name}"
        yield imu, imu_messages(times_ns, imu.accelerations(block.samples), frame)


def _as_part(text: str) -> str:
    """Part of a ROS topic: letters, digits, underscores."""
    return re.sub(r"\W", "_", text)
