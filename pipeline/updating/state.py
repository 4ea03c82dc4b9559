"""What the updating remembers between windows.

Random state needs no place in it: each window's generator is seeded by the scenario's seed and the
window's number.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

from pipeline.messages import ModalEstimate
from pipeline.updating.change.detector import ChangeState
from pipeline.updating.change.event_message import TrackSensitivity
from pipeline.updating.change.revised_size import BeforeEvent
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import ModeObservation, SeenWindow, condensed
from pipeline.updating.structural.alternatives import WarmStart
from pipeline.updating.structural.joint_model import FINEST_TOLERANCE
from sensors.arrays import FloatArray

RECENT_WINDOWS = 36  # that are kept one by one: six hours of ten minutes


@dataclass(frozen=True, slots=True, eq=False)
class UpdatingState:
    """All that is remembered between windows; its size doesn't grow with their number."""

    evidence: ModalEvidence
    ensemble: FloatArray | None = None
    """(n, 3) ratios drawn from the last posterior; what else is uncertain beside it."""
    median: FloatArray | None = None
    """(3,) ratios, of the last posterior."""
    change: ChangeState = field(default_factory=ChangeState)
    recent: tuple[SeenWindow, ...] = ()
    """From which the evidence starts again after a change."""
    sensitivities: tuple[TrackSensitivity, ...] = ()
    """Of the last posterior's pairs."""
    joint: tuple[WarmStart, ...] = ()
    """Of each alternative of an uncertain structure, best first."""
    sensor_fault: str = ""
    """Name of the one that the last posterior found."""
    searched_windows: int = 0
    """In the evidence when faults were last looked for in vain."""
    reference: ModalEvidence | None = None
    """Of the windows before the last event; None: none of them is known one by one."""
    reference_ns: int = 0
    """Start of the last of them."""
    before_event: BeforeEvent | None = None
    """By which the last event's size is revised."""

    @property
    def is_rough(self) -> bool:
        """Whether the last posterior found that the description does not hold."""
        return bool(self.joint) and self.joint[0].tolerance > FINEST_TOLERANCE

    def with_window(
        self, estimate: ModalEstimate, seen: Sequence[ModeObservation], rise: float
    ) -> "UpdatingState":
        """One more window's modes in the evidence, and among the recent windows."""
        latest = SeenWindow.of(estimate, seen, rise)
        evidence = self.evidence.with_window(latest)
        latest = replace(latest, observations=tuple(map(condensed, seen)))
        return replace(self, evidence=evidence, recent=(*self.recent, latest)[-RECENT_WINDOWS:])

    def restarted(self, start_ns: int, nothing: ModalEvidence) -> "UpdatingState":
        """With the evidence of the recent windows alone that began at that time or later.

        Parameters
        ----------
        start_ns : int
            That time [ns].
        nothing : ModalEvidence
            Evidence without a window.

        Notes
        -----
        Their modes keep the tracks they had. Where the structure is uncertain, the recent windows
        before that time become the reference that later posteriors are compared with; where there
        is none, they are compared with nothing: an earlier reference is of the time before another
        event.
        """
        evidence = replace(nothing, n_tracks=self.evidence.n_tracks)
        recent = tuple(each for each in self.recent if each.start_ns >= start_ns)
        before = tuple(each for each in self.recent if each.start_ns < start_ns)
        reference = None
        if before and self.joint:
            reference = _summed(before, replace(nothing, n_tracks=self.evidence.n_tracks))
        return replace(
            self,
            evidence=_summed(recent, evidence).continuing(self.evidence),
            recent=recent,
            reference=reference,
            reference_ns=before[-1].start_ns if before else 0,
        )


def _summed(windows: Sequence[SeenWindow], evidence: ModalEvidence) -> ModalEvidence:
    return reduce(ModalEvidence.with_window, windows, evidence)
