"""What single windows saw, kept to be summed again by another rule."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.messages import ModalEstimate
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import ModeObservation


@dataclass(frozen=True, slots=True, eq=False)
class SeenWindow:
    """What one window saw, small enough to be kept."""

    start_ns: int
    duration: float
    """[s]"""
    weight: float
    """hop / window duration [-]"""
    rise: float
    """Of the water above the model's level [m]; 0 where nothing reported it"""
    sightings: tuple[ModeObservation, ...]
    level_known: bool = True
    """Whether anything reported the water's level"""

    @classmethod
    def of(
        cls, estimate: ModalEstimate, sightings: Sequence[ModeObservation], rise: float
    ) -> "SeenWindow":
        """The window of an estimate, with its modes as observations."""
        return cls(
            start_ns=estimate.start_ns,
            duration=estimate.duration,
            weight=estimate.weight,
            rise=rise,
            sightings=tuple(sightings),
            level_known=bool(np.isfinite(estimate.water_level)),
        )


def with_window(evidence: ModalEvidence, window: SeenWindow) -> ModalEvidence:
    """The evidence after one more window."""
    return evidence.with_sightings(
        window.sightings,
        window.weight,
        window.duration,
        rise=window.rise,
        level_known=window.level_known,
    )
