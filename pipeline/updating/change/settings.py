"""How much may be missed for how much quiet, and what is expected beforehand."""

from dataclasses import dataclass, field
from typing import ClassVar

from pipeline.updating.prior import UpdatingError
from sensors.settings import NO_KEY


@dataclass(frozen=True, slots=True)
class ChangeSettings:
    """Section [updating.change] of a scenario."""

    years_between_false_alarms: float = 3.0
    """Mean time between two false alarms of any kind [years]."""
    changes_per_year: float = 1.0
    """Number of changes that is expected; it enters the reported probability of a change, not
    the alarm.
    """
    foundation_share: ClassVar[float] = 0.5
    """Of these, changes of the foundation [-]."""
    certainty: float = 0.95
    """Probability from which a change is called `foundation` or `modal-drift` [-]."""
    candidates: int = field(default=32, metadata=NO_KEY)
    """Windows that a change may have started with; older ones are thinned out."""

    def __post_init__(self) -> None:
        smallest = min(self.years_between_false_alarms, self.changes_per_year)
        if not smallest > 0:
            raise UpdatingError(
                "years_between_false_alarms and changes_per_year must be positive; one is "
                f"{smallest}"
            )
        if not 0.5 < self.certainty < 1:
            raise UpdatingError(f"certainty is {self.certainty}; it must lie between 0.5 and 1")
        if self.candidates < 8:
            raise UpdatingError(f"candidates is {self.candidates}; at least 8 are needed")
