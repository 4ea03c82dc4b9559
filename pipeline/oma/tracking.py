"""Modes keep their names from window to window, and channels their places.

A mode of a new window belongs to the track that expects it: by the distance of the frequencies in
units of what they may differ by (Mahalanobis), and by the MAC with the track's mean shape. All
modes are assigned at once, at the least total cost, so that two tracks that come near each other
cannot both take the same mode, and a mode that no track expects begins one of its own.

A cable plugged in wrongly shows in the shapes alone: `ChannelSwapMonitor`.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Literal

import numpy as np

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import modal_assurance_criterion
from sensors.arrays import FloatArray

DRIFT_PER_WINDOW = 0.001  # std of a frequency's own random walk, relative, a window
SHAPE_SCATTER = 0.15  # scale of 1 − MAC between an estimate and its track [-]
REJECTION_COST = 30.0  # of a mode that no track expects: what stands close to another mode errs by
# more than its std has it. Of 40 days of five modes, three crossing (`tracking`, seeds 142001 to
# 142040), with this, the two constants below and a mean shape, .32 % of the estimates had a wrong
# name and a mode 1.16 names; with 16, no cost of a young track and a memory of .2, .38 % and 1.42
UNESTABLISHED_COST = 8.0  # added for a track that few windows have seen: a mixture's, or of noise
SHAPE_MEMORY = 0.05  # least weight of a new shape in the track's mean
ESTABLISHED_TRACK = 5  # windows in which a track was seen before its loss or drift is worth a word
DIES_AFTER = 24  # windows without the mode
NOTABLE_DRIFT = 0.01  # of a frequency since the track's birth, relative

SAME_MODE = 0.01  # relative distance of frequencies of one mode in two windows [-]
CLEAR_SHAPE = 0.05  # largest std of a component that can show a swap [-]
FEWEST_SWAPPED_MODES = 3  # whose shapes a swap changes
CHANGED_MAC = 0.05  # of a MAC by the exchange of two channels [-]
BAD, GOOD = 0.9, 0.95  # mean MAC of those modes below which a swap is sought, and with it [-]


@dataclass(frozen=True, slots=True)
class TrackEvent:
    """Something worth a word about a track."""

    kind: Literal["birth", "death", "drift"]
    name: str
    frequency: float
    """Of the track now [Hz]."""
    text: str


@dataclass(frozen=True, slots=True)
class ChannelPlaces:
    """Where the channels of a window that lacks some are among all."""

    columns: tuple[int, ...]
    n_channels: int
    """In all."""

    def spread(self, shape: FloatArray) -> FloatArray:
        """(n_channels,) with NaN at the channels that the window lacks."""
        everywhere = np.full(self.n_channels, np.nan)
        everywhere[list(self.columns)] = shape
        return everywhere


@dataclass(slots=True)
class Track:
    """What is expected of a mode: a random walk in frequency, a mean shape."""

    name: str
    frequency: float
    """Filtered [Hz]."""
    variance: float
    """Of it [Hz²]."""
    shape: FloatArray
    """Mean of its estimates, (n_channels,); NaN where never seen."""
    reference: float
    """Frequency that drift is counted from [Hz]."""
    seen: int = 1
    """Windows with the mode."""
    unseen: int = 0
    """Windows since."""

    def predict(self) -> None:
        """One window later: the frequency may have walked."""
        self.unseen += 1
        self.variance += (DRIFT_PER_WINDOW * self.frequency) ** 2

    def update(self, mode: Mode, shape: FloatArray) -> None:
        """Kalman filter of the frequency; the shape's mean with the sign that fits."""
        gain = self.variance / (self.variance + mode.frequency_std**2)
        self.frequency += gain * (mode.frequency - self.frequency)
        self.variance *= 1 - gain
        sign = 1.0 if float(np.nansum(self.shape * shape)) >= 0 else -1.0
        weight = max(SHAPE_MEMORY, 1 / (self.seen + 1))
        mean = (1 - weight) * self.shape + weight * sign * shape
        either = np.where(np.isnan(self.shape), sign * shape, self.shape)
        self.shape = np.where(np.isnan(mean), either, mean)
        self.seen += 1
        self.unseen = 0


@dataclass(frozen=True, slots=True, eq=False)
class TrackerState:
    """What a tracker remembers between windows."""

    tracks: tuple[Track, ...] = ()
    """In order of birth."""
    born: int = 0
    """Tracks in all."""
    windows: int = 0
    """Named in all."""


class ModeTracker:
    """Names the modes of successive windows: "m1", "m2", … in order of first appearance."""

    def __init__(self) -> None:
        self._tracks: list[Track] = []
        self._born = 0
        self._windows = 0
        self.events: tuple[TrackEvent, ...] = ()  # of the last window

    @property
    def state(self) -> TrackerState:
        """All that the names of later windows depend on."""
        tracks = tuple(replace(track, shape=track.shape.copy()) for track in self._tracks)
        return TrackerState(tracks, self._born, self._windows)

    @classmethod
    def continued(cls, state: TrackerState) -> "ModeTracker":
        """The tracker that had this state."""
        tracker = cls()
        tracker._tracks = [replace(each, shape=each.shape.copy()) for each in state.tracks]
        tracker._born, tracker._windows = state.born, state.windows
        return tracker

    def named(self, modes: Sequence[Mode], *, on: ChannelPlaces | None = None) -> tuple[Mode, ...]:
        """The modes of the next window, each under its track's name; new ones start a track.

        Parameters
        ----------
        modes : sequence of Mode
            Of the window.
        on : ChannelPlaces or None, optional
            Where the shapes' channels are among all, where a window lacks some; None: it has all.
        """
        shapes = [mode.shape if on is None else on.spread(mode.shape) for mode in modes]
        for track in self._tracks:
            track.predict()
        assigned = self._assigned(modes, shapes)
        events: list[TrackEvent] = []
        named = []
        for index, mode in enumerate(modes):
            known = assigned.get(index)
            if known is not None:
                known.update(mode, shapes[index])
                events += _drift_event(known)
            track = known or self._birth(mode, shapes[index])
            if known is None:
                events += self._birth_event(track)
            named.append(replace(mode, name=track.name))
        events += self._bury()
        self.events = tuple(events)
        self._windows += 1
        return tuple(named)

    def recall(self, modes: Sequence[Mode], *, on: ChannelPlaces | None = None) -> None:
        """Take up a window that was named before this tracker began: its modes keep their names.

        Of all windows of a session in order, this leaves the tracker that named them.
        """
        for track in self._tracks:
            track.predict()
        known = {track.name: track for track in self._tracks}
        for mode in modes:
            shape = mode.shape if on is None else on.spread(mode.shape)
            if mode.name in known:
                known[mode.name].update(mode, shape)
                _drift_event(known[mode.name])  # moves the reference that drift is counted from
            else:
                self._birth(mode, shape, mode.name)
        self._bury()
        self._windows += 1

    def missed(self) -> None:
        """A window without an estimate: what may have changed since has grown."""
        for track in self._tracks:
            track.predict()
        self.events = tuple(self._bury())

    def _assigned(self, modes: Sequence[Mode], shapes: Sequence[FloatArray]) -> dict[int, Track]:
        """Index of a mode → its track, by least total cost."""
        if not modes or not self._tracks:
            return {}
        from scipy.optimize import linear_sum_assignment  # slow to load; a first window has no need

        cost = _association_costs(self._tracks, modes, shapes)
        rows, columns = linear_sum_assignment(np.minimum(cost, REJECTION_COST))
        return {
            int(row): self._tracks[column]
            for row, column in zip(rows, columns, strict=True)
            if cost[row, column] < REJECTION_COST
        }

    def _birth(self, mode: Mode, shape: FloatArray, name: str | None = None) -> Track:
        """name   as a mode was called before; None: the next that is free"""
        self._born = self._born + 1 if name is None else max(self._born, _number(name))
        track = Track(
            name=name or f"m{self._born}",
            frequency=mode.frequency,
            variance=mode.frequency_std**2,
            shape=shape.copy(),
            reference=mode.frequency,
        )
        self._tracks.append(track)
        return track

    def _birth_event(self, track: Track) -> list[TrackEvent]:
        """While the first windows gather the modes, a birth is no news."""
        if self._windows < ESTABLISHED_TRACK:
            return []
        text = f"a mode that was not seen before at {track.frequency:.4g} Hz: {track.name}"
        return [TrackEvent("birth", track.name, track.frequency, text)]

    def _bury(self) -> list[TrackEvent]:
        """Forgets tracks not seen for long; says so of those that were established."""
        dead = [track for track in self._tracks if track.unseen > DIES_AFTER]
        self._tracks = [track for track in self._tracks if track.unseen <= DIES_AFTER]
        return [
            TrackEvent(
                "death",
                track.name,
                track.frequency,
                f"{track.name} ({track.frequency:.4g} Hz) has not been seen for "
                f"{DIES_AFTER} windows",
            )
            for track in dead
            if track.seen >= ESTABLISHED_TRACK
        ]


def _association_costs(
    tracks: Sequence[Track], modes: Sequence[Mode], shapes: Sequence[FloatArray]
) -> FloatArray:
    """(n_modes, n_tracks), (Δf)² / var(Δf) + (1 − MAC)² / scatter², more for a track that is not
    established [-].

    The MAC is over the channels that both have, 1 where there is none.
    """
    frequencies = np.array([[mode.frequency] for mode in modes])
    variances = np.array([[mode.frequency_std**2] for mode in modes])
    expected = np.array([track.frequency for track in tracks])
    distance = (frequencies - expected) ** 2 / (
        np.array([track.variance for track in tracks]) + variances
    )
    mac = _common_mac(np.array(shapes), np.array([track.shape for track in tracks]))
    young = np.array([track.seen < ESTABLISHED_TRACK for track in tracks])
    return np.asarray(distance + (1 - mac) ** 2 / SHAPE_SCATTER**2 + UNESTABLISHED_COST * young)


def _common_mac(ones: FloatArray, others: FloatArray) -> FloatArray:
    """(n, m) MAC of each of (n, n_channels) with each of (m, n_channels), NaN where not measured.

    The sums of |φᵀψ|² / (φᵀφ · ψᵀψ) are over the channels that both shapes have; 1 where these are
    none.
    """
    a, b = np.nan_to_num(ones), np.nan_to_num(others)
    in_a, in_b = np.isfinite(ones).astype(float), np.isfinite(others).astype(float)
    energies = (a**2 @ in_b.T) * (in_a @ (b**2).T)
    products = (a @ b.T) ** 2
    mac = np.divide(products, energies, out=np.zeros_like(products), where=energies > 0)
    return np.where(in_a @ in_b.T > 0, mac, 1.0)


def _number(name: str) -> int:
    """7 of "m7"; 0 of a name that no tracker gave."""
    digits = name.removeprefix("m")
    return int(digits) if digits.isdecimal() else 0


def _drift_event(track: Track) -> list[TrackEvent]:
    """A frequency that has left its reference by a notable and a significant amount."""
    change = track.frequency / track.reference - 1
    std = np.sqrt(track.variance) / track.reference
    if track.seen == ESTABLISHED_TRACK:
        track.reference = track.frequency  # the first estimate alone is a poor one
    if track.seen <= ESTABLISHED_TRACK or abs(change) < max(NOTABLE_DRIFT, 4 * std):
        return []
    track.reference = track.frequency
    text = f"{track.name} has drifted by {100 * change:+.2g} % to {track.frequency:.4g} Hz"
    return [TrackEvent("drift", track.name, track.frequency, text)]


class ChannelSwapMonitor:
    """Remembers the shapes of a turbine's last good window.

    Parameters
    ----------
    reference : ModalEstimate, optional
        That window; None: there was none yet.
    """

    def __init__(self, reference: ModalEstimate | None = None) -> None:
        self.reference = reference

    def swap_in(self, estimate: ModalEstimate) -> str | None:
        """Which two channels have changed place since the last good window, in words, or None.

        A pair is named where exchanging it brings the shapes of the modes found again, at their
        frequencies, back to what they were.
        """
        reference = self.reference
        if reference is None or reference.channels != estimate.channels:
            self.reference = estimate
            return None
        now, before = _shapes_of_same_modes(estimate, reference)
        if len(now) < FEWEST_SWAPPED_MODES:
            return None
        as_it_is = _mac(now, before)
        found = []
        for i, j in combinations(range(now.shape[1]), 2):
            exchanged = _mac(_exchanged(now, i, j), before)
            changed = np.abs(exchanged - as_it_is) > CHANGED_MAC
            if changed.sum() >= FEWEST_SWAPPED_MODES:
                gain = float((exchanged - as_it_is).mean())
                before_it, with_it = as_it_is[changed].mean(), exchanged[changed].mean()
                found.append((gain, int(changed.sum()), before_it, with_it, (i, j)))
        _, count, bad, good, pair = max(found, default=(0.0, 0, 1.0, 0.0, (0, 0)))
        if bad > BAD or good < GOOD:
            self.reference = estimate
            return None
        first, second = (estimate.channels[index] for index in pair)
        return (
            f"{first} and {second} have changed place: exchanging them raises the mean MAC of "
            f"{count} modes with the last good window from {bad:.2f} to {good:.2f}"
        )


def _shapes_of_same_modes(
    estimate: ModalEstimate, reference: ModalEstimate
) -> tuple[FloatArray, FloatArray]:
    """Shapes of the modes that both windows see clearly at one frequency, (n, n_channels) each."""
    pairs = []
    clear = list(filter(_is_clear, reference.modes))
    for mode in filter(_is_clear, estimate.modes):
        near = [other for other in clear if abs(mode.frequency / other.frequency - 1.0) < SAME_MODE]
        if len(near) == 1:
            pairs.append((mode.shape, near[0].shape))
    shapes = np.array(pairs).reshape(len(pairs), 2, len(estimate.channels))
    return shapes[:, 0], shapes[:, 1]


def _is_clear(mode: Mode) -> bool:
    return not mode.pair_id and float(mode.shape_std.max()) < CLEAR_SHAPE


def _exchanged(shapes: FloatArray, i: int, j: int) -> FloatArray:
    order = np.arange(shapes.shape[1])
    order[[i, j]] = order[[j, i]]
    return shapes[:, order]


def _mac(ones: FloatArray, others: FloatArray) -> FloatArray:
    """Of each shape with the one in the same row, (n,)."""
    return modal_assurance_criterion(ones[:, None], others[:, None])[:, 0, 0]
