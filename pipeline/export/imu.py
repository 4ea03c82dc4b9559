"""Export accelerations as messages of inertial measurement units, one IMU per level.

    FILE.mcap ─► imu.mcap     /TURBINE/UNIT/z145/imu, one sensor_msgs/Imu a sample

A block holds seconds of many channels, which general viewers list but do not draw. Here every
sample is a message of its own, along the tower's axes: x fore-aft, y side-side, z up.

sensor_msgs/Imu of ROS 2 as CDR bytes, which RViz, Foxglove and PlotJuggler read:

    offset  0  00 01 00 00                     CDR, little endian
            4  int32 sec, uint32 nanosec       header.stamp
           12  uint32 length, characters, 0    header.frame_id
            …  to the next multiple of 8, counted from offset 4
            …  37 × float64                    orientation (4), its covariance (9), angular
                                               velocity (3), its covariance (9), linear
                                               acceleration (3) [m/s²], its covariance (9)

A covariance that starts with −1 means that its quantity is not measured (ROS REP 145); zeros mean
that it is unknown. An axis that no sensor measures is NaN.
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
from pipeline.export.samples import sample_times
from pipeline.export.table_file import new_file
from pipeline.sources.session_files import session_files
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError

TYPE = "sensor_msgs/msg/Imu"
ENCAPSULATION = b"\x00\x01\x00\x00"
STAMP = len(ENCAPSULATION)  # offset of the time [bytes]
ALIGNMENT = 8  # of a float64 [bytes]
ORIENTATION_COVARIANCE, ANGULAR_VELOCITY_COVARIANCE, LINEAR_ACCELERATION = 4, 16, 25
N_FIGURES = 37
NOT_MEASURED = -1.0

_PARTS = {  # the message type, then its parts, as rosbag2 writes them
    "": (
        "std_msgs/Header header\n"
        "geometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n"
        "geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n"
        "geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n"
    ),
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
}
DEFINITION = "".join(
    f"{'=' * 80}\nMSG: {name}\n{text}" if name else text for name, text in _PARTS.items()
)


def imu_messages(
    times_ns: NDArray[np.int64], accelerations: NDArray[np.float64], frame: str
) -> list[bytes]:
    """Return one message per sample.

    Parameters
    ----------
    times_ns : ndarray of int, shape (n,)
        Times of the samples [ns since 1970-01-01 UTC].
    accelerations : ndarray of float, shape (n, 3)
        Along x, y, z [m/s²]; NaN where an axis is not measured.
    frame : str
        Name of the frame of the axes.
    """
    head = _head(frame)
    messages = np.zeros((len(times_ns), len(head) + 8 * N_FIGURES), dtype=np.uint8)
    messages[:, : len(head)] = np.frombuffer(head, dtype=np.uint8)
    stamps = np.stack([times_ns // NANOSECONDS, times_ns % NANOSECONDS], axis=1).astype("<u4")
    messages[:, STAMP : STAMP + 8] = stamps.view(np.uint8)
    figures = np.zeros((len(times_ns), N_FIGURES), dtype="<f8")
    figures[:, ORIENTATION_COVARIANCE] = NOT_MEASURED
    figures[:, ANGULAR_VELOCITY_COVARIANCE] = NOT_MEASURED
    figures[:, LINEAR_ACCELERATION : LINEAR_ACCELERATION + 3] = accelerations
    messages[:, len(head) :] = figures.view(np.uint8)
    return [message.tobytes() for message in messages]


def _head(frame: str) -> bytes:
    """Return everything before the figures, at time 0."""
    name = frame.encode() + b"\x00"
    body = bytes(8) + len(name).to_bytes(4, "little") + name
    return ENCAPSULATION + body + bytes(-len(body) % ALIGNMENT)


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
        self._file = new_file(path)
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

    Parameters
    ----------
    recording : Path
        File or folder.
    folder : Path
        Where `imu.mcap` is written.
    report : callable, optional
        Called with each block that is written.

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
