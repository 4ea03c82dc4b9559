"""[recording]: how a session's recording is cut into files and how long they are kept."""

import math
from dataclasses import dataclass, fields

from pipeline.recording.errors import RecordingError


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """Sizes and ages. Without `keep_days` or `keep_gigabytes` nothing is ever deleted.

    Pictures of past days (.rrd) go by age, too, and first where the disk is short of room.
    """

    rotate_after: float = 3600.0  # a file is closed, the next started when it is that old [s] …
    rotate_megabytes: float = 256.0  # … or that large [10⁶ bytes]
    keep_days: float = math.inf  # raw samples older than that go, results stay [d]
    keep_gigabytes: float = math.inf  # the oldest raw samples go when all files exceed it [10⁹ B]
    free_megabytes: float = 100.0  # left on the disk for others [10⁶ bytes]

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            least = 0.0 if each.name == "free_megabytes" else 1e-9
            if not value >= least:
                raise RecordingError(
                    f"[recording] {each.name} is {value:g}; a positive number is needed"
                )

    @property
    def may_delete(self) -> bool:
        """Whether the settings allow old samples to go."""
        return math.isfinite(self.keep_days) or math.isfinite(self.keep_gigabytes)
