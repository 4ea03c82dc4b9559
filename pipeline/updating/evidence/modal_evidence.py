"""The evidence of all windows so far, mode by mode, without any model of the structure.

Windows are combined before a model is asked: each mode keeps the precision-weighted mean of its
estimates and their summed information, so the state stays the same size for years, and a pairing
that was wrong after the first window does no harm after the second.

Why summed information is enough: with the model's discrepancy b one vector shared by all windows,
    d_t = m(θ) + b + e_t,   e_t ~ N(0, Σ_t),   b ~ N(0, Σ_G(σ)),
the likelihood of all windows in θ and σ is exactly, up to a constant,
    N(d̄; m(θ), Σ_G(σ) + S),   S = (Σ_t w_t Σ_t⁻¹)⁻¹,   d̄ = S Σ_t w_t Σ_t⁻¹ d_t.
w_t = hop / window duration counts samples shared by overlapping windows once.

The same holds for what is known to differ between windows. With the water l_t above the model's
level, frequency and shape of a mode are m_t(θ) = m(θ) + v₁ l_t + v₂ l_t²; then
    d̄ = m(θ) + b + S (Σ_t w_t l_t Σ_t⁻¹ v₁ + Σ_t w_t l_t² Σ_t⁻¹ v₂) + ē,
so that two more sums for each mode bring the combined estimate to the model's level, whichever mode
of the model turns out to be its partner.
"""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.messages import ModalEstimate
from pipeline.updating.evidence.mode_evidence import ModeEvidence, PartnerInWater
from pipeline.updating.evidence.observations import ModeObservation, SeenWindow, mode_observations
from sensors.arrays import FloatArray

FOLLOWING_FREQUENCY_STD = 0.003  # relative scatter of one mode's f between windows [-]
WIDEST_FREQUENCY_STD = 0.01  # however uncertain both are [-]
FOLLOWING_MAC_SCALE = 0.15  # of 1 − MAC between windows [-]
FOLLOWING_REJECTION = 9.0  # three standard deviations: beyond, it is another mode

JUMP = 0.1  # largest relative change of f by which a mode may be the same after a jump: a fifth of
# the springs lost moves the second bending modes by 8 % [-]
JUMP_MAC = 0.9  # least MAC for that


def jumped_from(
    modes: Sequence[ModeEvidence],
    seen: Sequence[ModeObservation],
    followed: Sequence[int],
    window: int,
) -> list[int]:
    """For each observation the mode that it may continue after a jump of frequency, or −1.

    Parameters
    ----------
    modes : sequence of ModeEvidence
        Of the evidence so far.
    seen : sequence of ModeObservation
        Of the window.
    followed : sequence of int
        For each observation the mode it continues, or −1 (`followed_by`).
    window : int
        Number of the window.

    Notes
    -----
    For an observation that continues no mode, that is the nearest mode of like shape that most
    windows saw and this one did not. The two stay apart as evidence, since a mean over both would
    be neither's frequency, but share a track: on it a change is detected.
    """
    missed = [
        number
        for number, mode in enumerate(modes)
        if number not in followed and mode.missed_by_chance(window)
    ]
    found = [-1] * len(seen)
    waiting = [row for row, number in enumerate(followed) if number < 0]
    if not missed or not waiting:
        return found
    macs = _macs([seen[row] for row in waiting], [modes[number] for number in missed])
    distance = np.abs(
        np.subtract.outer(
            np.log([seen[row].frequency for row in waiting]),
            np.log([modes[number].frequency for number in missed]),
        )
    )
    alike = [
        [seen[row].close_pair == modes[number].close_pair for number in missed] for row in waiting
    ]
    cost = np.where((macs >= JUMP_MAC) & (distance <= JUMP) & alike, distance, 1.0)
    for row, column in zip(*linear_sum_assignment(cost), strict=True):
        if cost[row, column] < 1.0:
            found[waiting[row]] = missed[column]
    return found


def followed_by(modes: Sequence[ModeEvidence], seen: Sequence[ModeObservation]) -> list[int]:
    """For each observation the mode it continues, or −1 where it opens a new one.

    Parameters
    ----------
    modes : sequence of ModeEvidence
        Of the evidence so far.
    seen : sequence of ModeObservation
        Of the window.

    Notes
    -----
    Assignment on (Δ ln f / s)² + ((1 − MAC) / .15)², beyond 9 a new mode; s is .3 % and both
    standard deviations together, at most 1 %. Δ is to the mean of all windows or to the last that
    saw the mode, whichever is nearer: a tide moves some modes by 1 % and more. Names given by the
    identification are not asked: a swap of names would mix two modes for good.
    """
    if not modes or not seen:
        return [-1] * len(seen)
    cost = _nearest_squares(seen, modes) / _following_variance(seen, modes)
    cost += ((1 - _macs(seen, modes)) / FOLLOWING_MAC_SCALE) ** 2
    same_kind = np.equal.outer(
        [observation.close_pair for observation in seen], [mode.close_pair for mode in modes]
    )
    cost = np.where(same_kind, np.minimum(cost, FOLLOWING_REJECTION), FOLLOWING_REJECTION)
    followed = [-1] * len(seen)
    for row, column in zip(*linear_sum_assignment(cost), strict=True):
        if cost[row, column] < FOLLOWING_REJECTION:
            followed[row] = int(column)
    return followed


def _nearest_squares(seen: Sequence[ModeObservation], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) squared distances of ln f."""
    logs = np.log([observation.frequency for observation in seen])
    means = np.log([mode.frequency for mode in modes])
    last = np.log([mode.last_frequency for mode in modes])
    return np.minimum((logs[:, None] - means) ** 2, (logs[:, None] - last) ** 2)


def _following_variance(
    seen: Sequence[ModeObservation], modes: Sequence[ModeEvidence]
) -> FloatArray:
    """(n_seen, n_modes) variance of ln f between two windows of one mode."""
    own = [np.linalg.norm(observation.factor[0]) / observation.frequency for observation in seen]
    known = [mode.frequency_std / mode.frequency for mode in modes]
    variance = np.add.outer(np.square(own), np.square(known)) + FOLLOWING_FREQUENCY_STD**2
    return np.minimum(variance, WIDEST_FREQUENCY_STD**2)


def _macs(seen: Sequence[ModeObservation], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) MAC on the channels both have; 1 where there are none."""
    shapes = np.array([observation.shape for observation in seen])[:, None]
    known = np.array([mode.shape for mode in modes])[None]
    common = np.isfinite(shapes) & np.isfinite(known)
    shapes, known = np.where(common, shapes, 0.0), np.where(common, known, 0.0)
    products = (shapes * known).sum(axis=2) ** 2
    norms = (shapes**2).sum(axis=2) * (known**2).sum(axis=2)
    macs = np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)
    return np.where(common.any(axis=2), macs, 1.0)


MOST_MODES = 150  # remembered; those seen most rarely are forgotten first


@dataclass(frozen=True, slots=True, eq=False)
class ModalEvidence:
    """All evidence of the accepted windows: one ModeEvidence a mode, lowest frequency first.

    Attributes
    ----------
    channels : tuple of str
        Names in the order of the sensor layout; estimates are mapped by name.
    joint_covariance : bool
        Whether the correlations among one mode's f and φ are kept, or only the variances as in
        [foundation-updating] §2.3.
    """

    channels: tuple[str, ...]
    joint_covariance: bool = False
    modes: tuple[ModeEvidence, ...] = ()
    n_windows: int = 0
    n_tracks: int = 0
    """Started so far."""
    window_duration: float = 0.0
    """Of the shortest window [s]."""
    n_unknown_levels: int = 0
    """Windows whose water level nothing reported."""
    former: tuple[ModeEvidence, ...] = ()
    """Modes of the evidence before the last event that no window has seen since: one that returns
    has its track again, and is not taken for its neighbour.
    """

    def with_estimate(self, estimate: ModalEstimate, *, rise: float = 0.0) -> "ModalEvidence":
        """The evidence after one more window; self never changes.

        Parameters
        ----------
        estimate : ModalEstimate
            Of the window.
        rise : float, optional
            Of the water above the model's level [m].

        Raises
        ------
        EstimateRefused
            As `mode_observations` does.
        """
        return self.with_window(
            SeenWindow.of(estimate, mode_observations(estimate, self.channels), rise)
        )

    def with_window(self, seen: SeenWindow) -> "ModalEvidence":
        """The same from what one window saw."""
        window = self.n_windows + 1
        modes, n_tracks, known_now = list(self.modes), self.n_tracks, len(self.modes)
        followed = followed_by((*self.modes, *self.former), seen.observations)
        returned = jumped_from(self.modes, seen.observations, followed, window)
        for number, jump, observation in zip(followed, returned, seen.observations, strict=True):
            if 0 <= number < known_now:
                known = modes[number]
            elif number >= known_now:
                known = ModeEvidence.empty(observation, self.former[number - known_now].track)
            elif jump >= 0:
                known = ModeEvidence.empty(observation, modes[jump].track)
            else:
                known, n_tracks = ModeEvidence.empty(observation, n_tracks), n_tracks + 1
            updated = known.with_observation(
                observation,
                window=window,
                weight=seen.weight,
                joint_covariance=self.joint_covariance,
                rise=seen.rise,
            )
            if 0 <= number < known_now:
                modes[number] = updated
            else:
                modes.append(updated)
        modes, n_tracks = _with_own_tracks(modes, self.modes, window, n_tracks)
        return replace(
            self,
            modes=_remembered(modes, window),
            n_windows=window,
            n_tracks=n_tracks,
            window_duration=min(self.window_duration or np.inf, seen.duration),
            n_unknown_levels=self.n_unknown_levels + (not seen.level_known),
            former=tuple(m for n, m in enumerate(self.former, known_now) if n not in followed),
        )

    def with_channels(self, order: Sequence[int], signs: Sequence[float]) -> "ModalEvidence":
        """The evidence as if every channel had read what another one did, times a sign.

        Parameters
        ----------
        order : sequence of int
            (n_channels,) whose values each channel really has.
        signs : sequence of float
            (n_channels,) 1 or −1 of each [-].
        """
        if tuple(order) == tuple(range(len(order))) and all(sign == 1 for sign in signs):
            return self
        modes = tuple(mode.with_channels(order, signs) for mode in self.modes)
        return replace(self, modes=modes)

    def without_channels(self, channels: Collection[int]) -> "ModalEvidence":
        """The evidence as if these channels had not measured."""
        return replace(self, modes=tuple(mode.without_channels(channels) for mode in self.modes))

    def one_a_track(self, places: Iterable[int]) -> set[int]:
        """Of the modes at these places, of every track the one that most windows saw.

        A second one is the track's after a jump that may yet prove to be another mode.
        """
        rising = sorted(places, key=lambda place: self.modes[place].n_windows)
        return set({self.modes[place].track: place for place in rising}.values())

    @property
    def unknown_level_share(self) -> float:
        """Of the windows, those whose water level nothing reported [-]."""
        return self.n_unknown_levels / max(self.n_windows, 1)

    @property
    def level_varied(self) -> bool:
        """Whether any window had another water level than the model's."""
        return any(mode.level_information.any() for mode in self.modes)

    @property
    def mean_rise(self) -> float:
        """Of the water above the model's level, as precisely known frequencies count [m].

        Σ l / var ln f over Σ 1 / var ln f of all windows and modes; 0 without one.
        """
        squares = [mode.frequency**2 for mode in self.modes]
        known = np.dot(squares, [mode.information[0, 0] for mode in self.modes])
        risen = np.dot(squares, [mode.level_information[0, 0, 0] for mode in self.modes])
        return float(risen / known) if known > 0 else 0.0

    def at_model_level(self, partners: Sequence["PartnerInWater | None"]) -> "ModalEvidence":
        """The evidence as if every window had had the model's water level.

        Parameters
        ----------
        partners : sequence of PartnerInWater or None
            Of each mode; None for one that has no partner in the model.
        """
        modes = [
            mode if partner is None else mode.at_model_level(partner)
            for mode, partner in zip(self.modes, partners, strict=True)
        ]
        return replace(self, modes=tuple(modes))

    def with_levels_above(self, rise: float) -> "ModalEvidence":
        """The evidence beside a model whose water stands higher by so much [m]."""
        modes = tuple(mode.with_levels_above(rise) for mode in self.modes)
        return replace(self, modes=modes)

    def continuing(self, earlier: "ModalEvidence") -> "ModalEvidence":
        """The same modes under the tracks that `earlier`, of the same last window, knows them by;
        those of its modes that are not among them are its former ones."""
        tracks = {mode.last_frequency: mode.track for mode in earlier.modes}
        modes = [replace(m, track=tracks.get(m.last_frequency, m.track)) for m in self.modes]
        seen = {mode.track for mode in modes}
        return replace(
            self,
            modes=tuple(modes),
            n_tracks=max(self.n_tracks, earlier.n_tracks),
            former=tuple(mode for mode in earlier.modes if mode.track not in seen),
        )


def _with_own_tracks(
    modes: Sequence[ModeEvidence], before: Sequence[ModeEvidence], window: int, n_tracks: int
) -> tuple[list[ModeEvidence], int]:
    """The modes and the number of tracks, on none of which two modes are seen by turns.

    What seemed to be the continuation of a missed mode was another one if a window sees both, or
    if the missed mode returns: after a jump it would not. The mode of more windows keeps the track.

    before   the first of the modes as they were before this window
    """
    last_seen = [mode.last_window for mode in before]
    now = [number for number, mode in enumerate(modes) if mode.last_window == window]
    returned = {modes[number].track: last_seen[number] for number in now if number < len(before)}
    contested = [
        number
        for number, mode in enumerate(modes)
        if mode.last_window > returned.get(mode.track, window - 1)
    ]
    owners: set[int] = set()
    apart = list(modes)
    for number in sorted(contested, key=lambda number: modes[number].n_windows, reverse=True):
        if modes[number].track in owners:
            apart[number] = replace(modes[number], track=n_tracks)
            n_tracks += 1
        owners.add(apart[number].track)
    return apart, n_tracks


def _remembered(modes: Sequence[ModeEvidence], n_windows: int) -> tuple[ModeEvidence, ...]:
    """Those still remembered, lowest frequency first.

    A spurious mode is seen once or twice; a window brings some three in ten. Forgotten after a day
    they stay a few dozen, so that years cost what a day does.
    """
    kept = [mode for mode in modes if not mode.forgotten(n_windows)]
    kept.sort(key=lambda mode: (mode.n_windows, mode.last_window), reverse=True)
    return tuple(sorted(kept[:MOST_MODES], key=lambda mode: mode.frequency))
