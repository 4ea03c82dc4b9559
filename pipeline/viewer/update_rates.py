"""How often drawings are sent: rarely to a file, promptly to a viewer."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class UpdateRates:
    """Intervals between drawings; sensor time unless stated otherwise."""

    signals: float
    """Length of accelerations gathered in one chunk [s]."""
    swing: float
    """Period T of a drawn mode shape's motion [s]."""
    swing_chunk: float
    """Length of frames of the motion gathered in one chunk [s]."""
    nodes: float
    """Interval between two rows of a node whose losses do not grow [s]."""
    settling: float
    """Delay from a change of the layouts to a new blueprint: others may follow it [s]."""
    min_interval: float = 0.0
    """Shortest interval between two chunks, by the machine's clock [s]."""

    @property
    def playback_speed(self) -> float:
        """Sensor seconds per second of playback at which a shape's period is two seconds [-]."""
        return self.swing / 2.0


# Large chunks: a small file.
TO_FILE = UpdateRates(signals=600.0, swing=60.0, swing_chunk=3600.0, nodes=60.0, settling=30.0)
# Small chunks for a prompt picture, but at most four a second at any speed of a replay.
TO_VIEWER = UpdateRates(
    signals=1.0, swing=18.0, swing_chunk=1.0, nodes=5.0, settling=1.0, min_interval=0.25
)
