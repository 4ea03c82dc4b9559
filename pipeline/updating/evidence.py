"""What the windows have said so far, mode by mode, without any model of the structure.

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

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_shapes import normalised_to, renormalised_factor
from pipeline.updating.forward_model import FloatArray

FOLLOWING_FREQUENCY_STD = 0.003  # relative scatter of one mode's f between windows [-]
WIDEST_FREQUENCY_STD = 0.01  # however uncertain both are [-]
FOLLOWING_MAC_SCALE = 0.15  # of 1 − MAC between windows [-]
FOLLOWING_REJECTION = 9.0  # three standard deviations: beyond, it is another mode

JUMP = 0.05  # largest relative change of f by which a mode may be the same after a jump [-]
JUMP_MAC = 0.9  # least MAC for that
ESTABLISHED = 3  # windows from which a mode can be missed
PATIENCE = 144  # windows without a mode for each window with it, after which it is forgotten
LONGEST_PATIENCE = 4320  # windows, a month of ten minutes each
MOST_MODES = 150  # remembered; those seen most rarely are forgotten first

SMALLEST_UNIT_COMPONENT = 0.05  # of a largest component of 1: below, a shape cannot be rescaled


class EstimateRefused(Exception):  # noqa: N818  # a verdict on the estimate, no fault of ours
    """An estimate that cannot be used; the node turns it into a WindowRejected.

    Internal to the updating: an expected outcome that ends the work on one window.
    """

    def __init__(self, code: str, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


@dataclass(frozen=True, slots=True, eq=False)
class Sighting:
    """One mode as one window saw it, on all channels of the layout.

    Rows are f [Hz], then φ [-] of every channel; those of absent channels, and all of φ for a
    close pair, are NaN in `values` and zero in `factor`.
    """

    name: str
    values: FloatArray  # (1 + n_channels,)
    factor: FloatArray  # F, (1 + n_channels, n_columns), F Fᵀ the covariance
    n_blocks: int  # time blocks from which the covariance was estimated
    close_pair: bool = False  # the mean frequency of two modes that could not be separated

    @property
    def frequency(self) -> float:
        """[Hz]"""
        return float(self.values[0])

    @property
    def shape(self) -> FloatArray:
        """(n_channels,) [-]"""
        return self.values[1:]

    @property
    def unit_component(self) -> int:
        """Channel with the shape's largest component; 0 for a close pair."""
        return int(np.argmax(np.abs(np.nan_to_num(self.shape))))

    def normalised_to(self, component: int) -> "Sighting":
        """The same with another unit component; frequency only where that channel is absent or
        moves too little to be divided by."""
        scale = self.shape[component]
        values, factor = self.values.copy(), self.factor.copy()
        if not abs(scale) > SMALLEST_UNIT_COMPONENT:
            values[1:], factor[1:] = np.nan, 0.0
        else:
            factor[1:] = renormalised_factor(np.nan_to_num(self.shape), self.factor[1:], component)
            factor[1:][np.isnan(self.shape)] = 0.0
            values[1:] = normalised_to(self.shape, component)
        return replace(self, values=values, factor=factor)


def sightings(estimate: ModalEstimate, channels: Sequence[str]) -> list[Sighting]:
    """Every mode of an estimate on the layout's channels, the members of a close pair as one.

    Raises EstimateRefused for no mode at all, for a channel the layout doesn't have, and for a
    covariance that is not finite or not positive.
    """
    if not estimate.modes:
        raise EstimateRefused("no-modes", "no mode was identified")
    for name in estimate.channels:
        if name not in channels:
            raise EstimateRefused(
                "channels",
                f"the estimate has a channel {name!r}; the layout has {', '.join(channels)}",
            )
    rows = 1 + np.array([list(channels).index(name) for name in estimate.channels], dtype=np.intp)
    groups: dict[str, list[Mode]] = {}
    for number, mode in enumerate(estimate.modes):
        _check(mode)
        groups.setdefault(mode.pair_id or f"single {number}", []).append(mode)
    return [_sighting(group, rows, 1 + len(channels)) for group in groups.values()]


def diagonal(sighting: Sighting) -> Sighting:
    """The same with the variances alone of its covariance."""
    return replace(sighting, factor=np.linalg.norm(sighting.factor, axis=1)[:, None])


def _check(mode: Mode) -> None:
    deviations = np.linalg.norm(mode.covariance_factor, axis=1)
    shape_deviations = np.delete(deviations[2:], mode.unit_component)
    if not np.all(np.isfinite(mode.covariance_factor)):
        problem = "is not finite"
    elif not deviations[0] > 0 or not np.all(shape_deviations > 0):
        problem = "is not positive"
    else:
        return
    raise EstimateRefused(
        "covariance", f"the covariance of the mode at {mode.frequency:.4g} Hz {problem}"
    )


def _sighting(group: list[Mode], rows: NDArray[np.intp], n_rows: int) -> Sighting:
    mode = group[0]
    if len(group) > 1:
        return _pair_sighting(group, n_rows)
    values = np.full(n_rows, np.nan)
    factor = np.zeros((n_rows, mode.covariance_factor.shape[1]))
    values[0], factor[0] = mode.frequency, mode.covariance_factor[0]
    values[rows], factor[rows] = mode.shape, mode.covariance_factor[2:]
    return Sighting(mode.name, values, factor, mode.n_block_columns)


def _pair_sighting(group: list[Mode], n_rows: int) -> Sighting:
    """The mean frequency of a close pair: what can be said of two modes nearer than their own
    standard deviation. Block columns are common to both, the others are each mode's own."""
    n_blocks = group[0].n_block_columns
    common = np.mean([mode.covariance_factor[0, :n_blocks] for mode in group], axis=0)
    own = [mode.covariance_factor[0, n_blocks:] / len(group) for mode in group]
    row = np.concatenate([common, *own])
    values = np.full(n_rows, np.nan)
    values[0] = np.mean([mode.frequency for mode in group])
    factor = np.zeros((n_rows, len(row)))
    factor[0] = row
    name = "+".join(mode.name for mode in group if mode.name)
    return Sighting(name, values, factor, n_blocks, close_pair=True)


@dataclass(frozen=True, slots=True, eq=False)
class PartnerInWater:
    """A mode of the model with the water one metre lower, as it is, one metre higher."""

    log_frequencies: FloatArray  # ln f, (3,)
    shapes: FloatArray  # (3, n_channels) [-], scale arbitrary

    @property
    def curve(self) -> FloatArray:
        """∂ ln f / ∂ level and ½ ∂² ln f / ∂ level², (2,) [1/m, 1/m²]"""
        return _parabola(self.log_frequencies)

    def parabola(self, frequency: float, unit_component: int) -> tuple[FloatArray, FloatArray]:
        """v₁ and v₂, (1 + n_channels,) each, of f [Hz] and of φ [-] normalised to that channel."""
        units = self.shapes[:, [unit_component]]
        shapes = np.divide(self.shapes, units, out=np.zeros_like(self.shapes), where=units != 0)
        ratios = np.exp(self.log_frequencies - self.log_frequencies[1])
        slope, curvature = _parabola(np.column_stack([frequency * ratios, shapes]))
        return slope, curvature


def _parabola(values: FloatArray) -> FloatArray:
    """(2, …) slope and curvature through values at −1, 0 and 1, (3, …)."""
    low, middle, high = values
    return np.array([(high - low) / 2, (high + low) / 2 - middle])


@dataclass(frozen=True, slots=True, eq=False)
class ModeEvidence:
    """One mode's sightings combined. Vectors have the rows f [Hz], then φ [-] of every channel.

    The shape's component `unit_component` is 1 by normalisation in every window (Eq. 11) and
    carries no information: left in Eq. 9, its zero variance makes the posterior improper at
    σ → 0. Its index is frozen when the mode is first seen, from the identified shape; the
    model's largest component may sit elsewhere.
    """

    name: str
    unit_component: int  # channel index
    information: FloatArray  # Σ w Σ_t⁻¹, (1 + n_channels, 1 + n_channels)
    information_mean: FloatArray  # Σ w Σ_t⁻¹ d_t, (1 + n_channels,)
    level_information: (
        FloatArray  # Σ w l Σ_t⁻¹ and Σ w l² Σ_t⁻¹, their row of f, (2, 1 + n_channels)
    )
    track: int  # stays with the mode, also through a jump of its frequency
    n_windows: int  # windows that saw this mode
    last_window: int  # the accepted window that saw it last, counted from 1
    last_frequency: float = np.nan  # as that window saw it [Hz]
    last_frequency_std: float = np.nan  # [Hz]
    close_pair: bool = False

    @classmethod
    def empty(cls, sighting: Sighting, track: int = 0) -> "ModeEvidence":
        """No information yet; identity and unit component of the first sighting."""
        n_rows = len(sighting.values)
        return cls(
            name=sighting.name,
            unit_component=sighting.unit_component,
            information=np.zeros((n_rows, n_rows)),
            information_mean=np.zeros(n_rows),
            level_information=np.zeros((2, n_rows, n_rows)),
            track=track,
            n_windows=0,
            last_window=0,
            close_pair=sighting.close_pair,
        )

    def with_sighting(
        self,
        sighting: Sighting,
        *,
        window: int,
        weight: float,
        joint_covariance: bool,
        rise: float = 0.0,
    ) -> "ModeEvidence":
        """Evidence after one more window, its information multiplied by weight.

        rise   of the water above the model's level [m]
        """
        sighting = sighting.normalised_to(self.unit_component)
        known = np.flatnonzero(np.linalg.norm(sighting.factor, axis=1) > 0)
        precision = weight * _precision(sighting.factor[known], sighting.n_blocks, joint_covariance)
        information = self.information.copy()
        information[np.ix_(known, known)] += precision
        information_mean = self.information_mean.copy()
        information_mean[known] += precision @ sighting.values[known]
        level_information = self.level_information.copy()
        level_information[0][np.ix_(known, known)] += rise * precision
        level_information[1][np.ix_(known, known)] += rise**2 * precision
        return replace(
            self,
            name=sighting.name or self.name,
            information=information,
            information_mean=information_mean,
            level_information=level_information,
            n_windows=self.n_windows + 1,
            last_window=window,
            last_frequency=sighting.frequency,
            last_frequency_std=float(np.linalg.norm(sighting.factor[0])),
        )

    def at_model_level(self, partner: "PartnerInWater") -> "ModeEvidence":
        """The evidence as if every window had had the model's water level."""
        slope, curvature = partner.parabola(self.frequency, self.unit_component)
        moved = self.level_information[0] @ slope + self.level_information[1] @ curvature
        return replace(self, information_mean=self.information_mean - moved)

    def forgotten(self, n_windows: int) -> bool:
        """Whether it has not been seen for so long, after n_windows in all, that it was a mistake
        or has gone for good."""
        patience = min(PATIENCE * self.n_windows, LONGEST_PATIENCE)
        return n_windows - self.last_window > patience

    @property
    def known(self) -> NDArray[np.bool_]:
        """(1 + n_channels,) components about which there is information."""
        return np.diag(self.information) > 0

    @property
    def covariance(self) -> FloatArray:
        """S, (1 + n_channels, 1 + n_channels), of the combined estimate; NaN where unknown."""
        known = np.flatnonzero(self.known)
        block = np.linalg.inv(self.information[np.ix_(known, known)])
        covariance = np.full_like(self.information, np.nan)
        covariance[np.ix_(known, known)] = (block + block.T) / 2
        return covariance

    @property
    def mean(self) -> FloatArray:
        """d̄, (1 + n_channels,): f [Hz] and φ [-]; 1 at the unit component, NaN where unknown."""
        known = np.flatnonzero(self.known)
        mean = np.full(len(self.information), np.nan)
        mean[known] = np.linalg.solve(
            self.information[np.ix_(known, known)], self.information_mean[known]
        )
        if not self.close_pair:
            mean[1 + self.unit_component] = 1.0
        return mean

    @property
    def frequency(self) -> float:
        """Combined estimate of f [Hz]."""
        return float(self.mean[0])

    @property
    def frequency_std(self) -> float:
        """[Hz]"""
        return float(np.sqrt(self.covariance[0, 0]))

    @property
    def shape(self) -> FloatArray:
        """Combined estimate of φ, (n_channels,) [-]; NaN at channels never available."""
        return self.mean[1:]


def _precision(factor: FloatArray, n_blocks: int, joint: bool) -> FloatArray:
    """Σ⁻¹, (p, p), of a covariance that was itself estimated from n_blocks blocks.

    factor     F, (p, n_columns), Σ̂ = F Fᵀ
    n_blocks   0 for a covariance that is known, not estimated
    joint      the whole matrix where there are blocks enough to invert it, else variances only

    E[Σ̂⁻¹] = Σ⁻¹ (n−1)/(n−p−2) for a Wishart Σ̂ of n blocks (p = 1 for a variance alone); without
    the factor the intervals are too narrow. Source: Hartlap et al. (2007), A&A 464.
    """
    p = len(factor)
    if joint and (n_blocks == 0 or n_blocks > p + 3):
        return np.asarray(np.linalg.inv(factor @ factor.T) * _wishart_bias(n_blocks, p))
    return np.diag(_wishart_bias(n_blocks, 1) / (factor**2).sum(axis=1))


def _wishart_bias(n_blocks: int, p: int) -> float:
    return 1.0 if n_blocks == 0 else max(n_blocks - p - 2, 1) / max(n_blocks - 1, 1)


@dataclass(frozen=True, slots=True, eq=False)
class ModalEvidence:
    """All that the accepted windows said: one ModeEvidence a mode, lowest frequency first.

    channels           names in the order of the sensor layout; estimates are mapped by name
    joint_covariance   whether the correlations among one mode's f and φ are kept, or only the
                       variances as in [foundation-updating] §2.3
    """

    channels: tuple[str, ...]
    joint_covariance: bool = False
    modes: tuple[ModeEvidence, ...] = ()
    n_windows: int = 0
    n_tracks: int = 0  # begun so far
    window_duration: float = 0.0  # of the shortest window [s]

    def with_estimate(self, estimate: ModalEstimate, *, rise: float = 0.0) -> "ModalEvidence":
        """The evidence after one more window. Raises EstimateRefused; self never changes.

        rise   of the water above the model's level [m]
        """
        return self.with_sightings(
            sightings(estimate, self.channels), estimate.weight, estimate.duration, rise=rise
        )

    def with_sightings(
        self, seen: Sequence[Sighting], weight: float, duration: float, *, rise: float = 0.0
    ) -> "ModalEvidence":
        """The same from the sightings of a window of that weight and duration [s]."""
        window = self.n_windows + 1
        modes, n_tracks = list(self.modes), self.n_tracks
        followed = _followed(self.modes, seen)
        jumped = _jumped(self.modes, seen, followed)
        for number, jump, sighting in zip(followed, jumped, seen, strict=True):
            if number >= 0:
                known = modes[number]
            elif jump >= 0:
                known = ModeEvidence.empty(sighting, modes[jump].track)
            else:
                known, n_tracks = ModeEvidence.empty(sighting, n_tracks), n_tracks + 1
            updated = known.with_sighting(
                sighting,
                window=window,
                weight=weight,
                joint_covariance=self.joint_covariance,
                rise=rise,
            )
            if number >= 0:
                modes[number] = updated
            else:
                modes.append(updated)
        return replace(
            self,
            modes=_remembered(modes, window),
            n_windows=window,
            n_tracks=n_tracks,
            window_duration=min(self.window_duration or np.inf, duration),
        )

    @property
    def level_varied(self) -> bool:
        """Whether any window had another water level than the model's."""
        return any(mode.level_information.any() for mode in self.modes)

    def at_model_level(self, partners: Sequence["PartnerInWater | None"]) -> "ModalEvidence":
        """The evidence as if every window had had the model's water level.

        partners   of each mode; None for one that has no partner in the model
        """
        modes = [
            mode if partner is None else mode.at_model_level(partner)
            for mode, partner in zip(self.modes, partners, strict=True)
        ]
        return replace(self, modes=tuple(modes))

    def with_tracks_of(self, other: "ModalEvidence") -> "ModalEvidence":
        """The same modes under the tracks that `other`, of the same last window, knows them by."""
        tracks = {mode.last_frequency: mode.track for mode in other.modes}
        modes = [replace(m, track=tracks.get(m.last_frequency, m.track)) for m in self.modes]
        return replace(self, modes=tuple(modes), n_tracks=max(self.n_tracks, other.n_tracks))


def _remembered(modes: Sequence[ModeEvidence], n_windows: int) -> tuple[ModeEvidence, ...]:
    """Those still remembered, lowest frequency first.

    A spurious mode is seen once or twice; a window brings some three in ten. Forgotten after a day
    they stay a few dozen, so that years cost what a day does.
    """
    kept = [mode for mode in modes if not mode.forgotten(n_windows)]
    kept.sort(key=lambda mode: (mode.n_windows, mode.last_window), reverse=True)
    return tuple(sorted(kept[:MOST_MODES], key=lambda mode: mode.frequency))


def _jumped(
    modes: Sequence[ModeEvidence], seen: Sequence[Sighting], followed: Sequence[int]
) -> list[int]:
    """For each sighting that continues no mode, the one of which it may be the continuation after
    a jump of frequency, or −1.

    That is the nearest established mode of like shape that this window did not see. The two stay
    apart as evidence, since a mean over both would be neither's frequency, but share a track: on
    it a change is detected.
    """
    missed = [
        number
        for number, mode in enumerate(modes)
        if number not in followed and mode.n_windows >= ESTABLISHED
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


def _followed(modes: Sequence[ModeEvidence], seen: Sequence[Sighting]) -> list[int]:
    """For each sighting the mode it continues, or −1 where it opens a new one.

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
        [sighting.close_pair for sighting in seen], [mode.close_pair for mode in modes]
    )
    cost = np.where(same_kind, np.minimum(cost, FOLLOWING_REJECTION), FOLLOWING_REJECTION)
    followed = [-1] * len(seen)
    for row, column in zip(*linear_sum_assignment(cost), strict=True):
        if cost[row, column] < FOLLOWING_REJECTION:
            followed[row] = int(column)
    return followed


def _nearest_squares(seen: Sequence[Sighting], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) squared distances of ln f."""
    logs = np.log([sighting.frequency for sighting in seen])
    means = np.log([mode.frequency for mode in modes])
    last = np.log([mode.last_frequency for mode in modes])
    return np.minimum((logs[:, None] - means) ** 2, (logs[:, None] - last) ** 2)


def _following_variance(seen: Sequence[Sighting], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) variance of ln f between two windows of one mode."""
    own = [np.linalg.norm(sighting.factor[0]) / sighting.frequency for sighting in seen]
    known = [mode.frequency_std / mode.frequency for mode in modes]
    variance = np.add.outer(np.square(own), np.square(known)) + FOLLOWING_FREQUENCY_STD**2
    return np.minimum(variance, WIDEST_FREQUENCY_STD**2)


def _macs(seen: Sequence[Sighting], modes: Sequence[ModeEvidence]) -> FloatArray:
    """(n_seen, n_modes) MAC on the channels both have; 1 where there are none."""
    shapes = np.array([sighting.shape for sighting in seen])[:, None]
    known = np.array([mode.shape for mode in modes])[None]
    common = np.isfinite(shapes) & np.isfinite(known)
    shapes, known = np.where(common, shapes, 0.0), np.where(common, known, 0.0)
    products = (shapes * known).sum(axis=2) ** 2
    norms = (shapes**2).sum(axis=2) * (known**2).sum(axis=2)
    macs = np.divide(products, norms, out=np.zeros_like(products), where=norms > 0)
    return np.where(common.any(axis=2), macs, 1.0)
