"""An MCAP file of ROS 2 messages sensor_msgs/Imu, one topic an instrument."""

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import LIBRARY_IDENTIFIER, Writer
from numpy.typing import NDArray

from pipeline.recording.ros import DEFINITION, TYPE
from sensors.errors import InputError


class ImuFile:
    """Messages to `path`, compressed chunk by chunk; finished when the context ends, and
    removed where that is an error before the first message.

    Raises InputError where the file exists or cannot be made.
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
