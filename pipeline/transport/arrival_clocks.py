"""Stamps of a live unit's blocks against the clock of the machine that they arrive at.

lead = stamp of the block's end − time of arrival
    lead > 0    the unit's clock is ahead: no block arrives before it is measured
    lead < 0    its clock is behind, or its blocks travel long; a backlog that is sent
                again after a cut arrives faster than it was measured, and is neither
"""

from collections import deque
from statistics import median

from pipeline.messages import QualityWarning
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.bounded_dict import BoundedDict

MOST_OFF = 5.0  # of a unit's clock from this machine's, without a warning [s]
JUDGED_BLOCKS = 20  # of a unit, the latest
FEWEST_BLOCKS = 5  # that a clock is judged by
OWN_PACE = 0.5  # time of arrival over time measured, below which blocks are a backlog [-]
MOST_UNITS = 2000  # that are remembered; of more the silent ones go
MOST_WARNINGS = 8  # units that are named, those furthest off

UnitKey = tuple[str, str]  # turbine, unit


class ArrivalClocks:
    """Watches the blocks of live units arrive; judges each unit's clock by its latest blocks."""

    def __init__(self) -> None:
        self._seen = BoundedDict[UnitKey, deque[tuple[int, int]]](MOST_UNITS)
        """End of block, arrival [ns]."""

    def note(self, block: AccelerationBlock, now_ns: int) -> None:
        """Take note of a block.

        Parameters
        ----------
        now_ns : int
            Clock of this machine when it arrived [ns since 1970-01-01 UTC].
        """
        key = block.turbine, block.unit
        seen = self._seen.pop(key, None) or deque(maxlen=JUDGED_BLOCKS)
        seen.append((block.end_ns, now_ns))
        self._seen[key] = seen

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """One for each of the units whose clocks are furthest off."""
        leads = {key: lead_of(list(seen)) for key, seen in self._seen.items()}
        off = sorted((key for key in leads if leads[key]), key=lambda key: -abs(leads[key]))
        return tuple(
            _warning(turbine, unit, leads[turbine, unit]) for turbine, unit in off[:MOST_WARNINGS]
        )


def lead_of(seen: list[tuple[int, int]]) -> float:
    """Return how far a unit's clock is ahead of this machine's [s]; 0 where unknown.

    Parameters
    ----------
    seen : list of (int, int)
        Stamp of each block's end and time of its arrival [ns], in order of arrival.
    """
    if len(seen) < FEWEST_BLOCKS:
        return 0.0
    lead = median((end - arrival) / NANOSECONDS for end, arrival in seen)
    if abs(lead) <= MOST_OFF:
        return 0.0
    (first_end, first_arrival), (last_end, last_arrival) = seen[0], seen[-1]
    at_own_pace = last_arrival - first_arrival >= OWN_PACE * (last_end - first_end)
    return lead if lead > 0 or at_own_pace else 0.0


def _warning(turbine: str, unit: str, lead: float) -> QualityWarning:
    if lead > 0:
        text = f"is {lead:.0f} s ahead of this machine's: one of them is wrong"
    else:
        text = (
            f"is {-lead:.0f} s behind this machine's: one of them is wrong, or its blocks take so "
            "long to arrive"
        )
    return QualityWarning("clock-off", f"the clock of unit {unit} of {turbine} {text}")
