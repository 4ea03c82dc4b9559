"""[recording]: how a session's recording is cut into files and how long they are kept."""

import math
from dataclasses import dataclass, fields

from pipeline.recording.errors import RecordingError


@dataclass(frozen=True, slots=True)
class RecordingSettings:
    """Sizes and ages. Without `keep_days` or `keep_gigabytes` nothing is ever deleted.

    Pictures of past days (.rrd) go by age, too, and first where the disk is short of room.
    """

    rotate_after: float = 3600.0
    """Age at which a file is closed and the next one begins [s]."""
    rotate_megabytes: float = 256.0
    """Size at which a file is closed and the next one begins [10⁶ bytes]."""
    keep_days: float = math.inf
    """Age from which samples are deleted; results stay [days]."""
    keep_gigabytes: float = math.inf
    """Size of all parts with samples, of earlier sessions in the folder too, above which the
    oldest samples are deleted [10⁹ bytes].
    """
    free_megabytes: float = 100.0
    """Space that stays free on the disk [10⁶ bytes]."""

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
