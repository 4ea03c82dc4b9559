"""How often pictures are handed over: seldom to a file, promptly to a viewer."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Pace:
    """How often things are handed over; session time unless said otherwise."""

    signals: float  # accelerations gathered in one chunk [s]
    swing: float  # one swing of a mode shape, T [s]
    swing_chunk: float  # frames gathered in one chunk [s]
    nodes: float  # between two rows of a node whose losses do not grow [s]
    settling: float  # from a change of the layout to its views: others may follow it [s]
    rest: float = 0.0  # between two hand-overs, by the machine's clock [s]

    @property
    def playback_speed(self) -> float:
        """Session seconds a second of playing at which a shape swings every two seconds [-]."""
        return max(1.0, self.swing / 2.0)


# Large chunks: a small file.
TO_FILE = Pace(signals=60.0, swing=60.0, swing_chunk=600.0, nodes=60.0, settling=30.0)
# Small ones for a prompt picture, but four a second at most, however fast a replay is.
TO_VIEWER = Pace(signals=1.0, swing=18.0, swing_chunk=1.0, nodes=5.0, settling=1.0, rest=0.25)
