"""Modes keep their names from window to window.

A mode of a new window belongs to the track whose last state explains it best: by the distance of
the frequencies in units of what they may differ by, and by the MAC. All modes are assigned at
once, so two tracks that come near each other cannot both take the same mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.messages import Mode
from pipeline.modal_shapes import modal_assurance_criterion

DRIFT_PER_WINDOW = 0.002  # std of a frequency's own change from window to window, relative
SHAPE_SCATTER = 0.15  # scale of 1 − MAC between two estimates of one mode [-]
REJECTION_COST = 12.0  # about χ² of two degrees of freedom at 99.75 %
FORGOTTEN_AFTER = 24  # windows without the mode


@dataclass(slots=True)
class _Track:
    name: str
    mode: Mode  # as last seen
    unseen: int = 0  # windows since


class ModeTracker:
    """Names the modes of successive windows: "m1", "m2", … in order of first appearance."""

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._born = 0

    def named(self, modes: Sequence[Mode]) -> tuple[Mode, ...]:
        """The modes of the next window, each under its track's name; new ones start a track."""
        assigned = self._assign(modes)
        for track in self._tracks:
            track.unseen += 1
        named = []
        for index, mode in enumerate(modes):
            track = assigned.get(index) or self._birth(mode)
            track.mode, track.unseen = mode, 0
            named.append(replace(mode, name=track.name))
        self._tracks = [track for track in self._tracks if track.unseen <= FORGOTTEN_AFTER]
        return tuple(named)

    def _birth(self, mode: Mode) -> _Track:
        self._born += 1
        track = _Track(f"m{self._born}", mode)
        self._tracks.append(track)
        return track

    def _assign(self, modes: Sequence[Mode]) -> dict[int, _Track]:
        """Index of a mode → its track, by least total cost."""
        if not modes or not self._tracks:
            return {}
        cost = np.array([[_cost(track, mode) for track in self._tracks] for mode in modes])
        rows, columns = linear_sum_assignment(np.minimum(cost, REJECTION_COST))
        return {
            int(row): self._tracks[column]
            for row, column in zip(rows, columns, strict=True)
            if cost[row, column] < REJECTION_COST
        }


def _cost(track: _Track, mode: Mode) -> float:
    """(Δf)² / var(Δf) + (1 − MAC)² / scatter²."""
    known = track.mode
    drift = DRIFT_PER_WINDOW * known.frequency * np.sqrt(1 + track.unseen)
    variance = known.frequency_std**2 + mode.frequency_std**2 + drift**2
    mac = modal_assurance_criterion(known.shape[None], mode.shape[None])[0, 0]
    return float(
        (mode.frequency - known.frequency) ** 2 / variance + (1 - mac) ** 2 / SHAPE_SCATTER**2
    )
