"""Encode sensor_msgs/Imu of ROS 2 as CDR bytes, for RViz, Foxglove and PlotJuggler.

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

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS

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
