"""The evidence of all windows on one mode: sums that give its mean and information at any time."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.updating.evidence.observations import ModeObservation
from sensors.arrays import FloatArray

MISSED_WINDOWS = 144  # windows without a mode for each window with it, after which it is forgotten
ESTABLISHED = 1  # windows that have seen a mode before its absence means anything
SEEN_MOSTLY = 0.5  # of the windows since the first see it where its absence is an exception [-]
SOLVED = 400  # modes whose mean and covariance are remembered: of some evidences of one window
LONGEST_PATIENCE = 4320  # windows, a month of ten minutes each


@dataclass(frozen=True, slots=True, eq=False)
class PartnerInWater:
    """A mode of the model with the water one metre lower, as it is, one metre higher."""

    log_frequencies: FloatArray
    """Ln f, (3,)."""
    shapes: FloatArray
    """(3, n_channels) [-], scale arbitrary."""

    @property
    def curve(self) -> FloatArray:
        """∂ ln f / ∂ level and ½ ∂² ln f / ∂ level², (2,) [1/m, 1/m²]"""
        return _parabola(self.log_frequencies)

    def curve_about(self, rise: float) -> FloatArray:
        """`curve` of the same parabola about a level above this one, (2,) [1/m, 1/m²]"""
        slope, curvature = self.curve
        return np.array([slope + 2 * curvature * rise, curvature])

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
    """One mode's observations combined. Vectors have the rows f [Hz], then φ [-] of every channel.

    The shape's component `unit_component` is 1 by normalisation in every window (Eq. 11) and
    carries no information: left in Eq. 9, its zero variance makes the posterior improper at
    σ → 0. Its index is frozen when the mode is first seen, from the identified shape; the
    model's largest component may sit elsewhere.
    """

    name: str
    unit_component: int
    """Channel index."""
    information: FloatArray
    """Σ w Σ_t⁻¹, (1 + n_channels, 1 + n_channels)."""
    information_mean: FloatArray
    """Σ w Σ_t⁻¹ d_t, (1 + n_channels,)."""
    level_information: FloatArray
    """Σ w l Σ_t⁻¹ and Σ w l² Σ_t⁻¹, (2, 1 + n_channels, 1 + n_channels)."""
    track: int
    """Stays with the mode, also through a jump of its frequency."""
    n_windows: int
    """Windows that saw this mode."""
    last_window: int
    """The accepted window that saw it last, counted from 1."""
    last_frequency: float = np.nan
    """As that window saw it [Hz]."""
    last_frequency_std: float = np.nan
    """Standard deviation of the last frequency [Hz]."""
    close_pair: bool = False
    first_window: int = 1
    """That saw it, counted as the last one."""
    damping_ratio: float = np.nan
    """ζ, mean of these windows; NaN where unknown [-]."""

    @classmethod
    def empty(cls, observation: ModeObservation, track: int = 0) -> "ModeEvidence":
        """No information yet; identity and unit component of the first observation."""
        n_rows = len(observation.values)
        return cls(
            name=observation.name,
            unit_component=observation.unit_component,
            information=np.zeros((n_rows, n_rows)),
            information_mean=np.zeros(n_rows),
            level_information=np.zeros((2, n_rows, n_rows)),
            track=track,
            n_windows=0,
            last_window=0,
            close_pair=observation.close_pair,
        )

    def with_observation(
        self,
        observation: ModeObservation,
        *,
        window: int,
        weight: float,
        joint_covariance: bool,
        rise: float = 0.0,
    ) -> "ModeEvidence":
        """Evidence after one more window, its information multiplied by weight.

        Parameters
        ----------
        observation : ModeObservation
            What the window saw of the mode.
        window : int
            Number of the window.
        weight : float
            On the window's information [-].
        joint_covariance : bool
            The whole covariance counts where there are blocks enough to invert it; else variances
            only.
        rise : float, optional
            Of the water above the model's level [m].
        """
        observation = observation.normalised_to(self.unit_component)
        known = np.flatnonzero(np.linalg.norm(observation.factor, axis=1) > 0)
        precision = weight * _precision(
            observation.factor[known], observation.n_blocks, joint_covariance
        )
        information = self.information.copy()
        information[np.ix_(known, known)] += precision
        information_mean = self.information_mean.copy()
        information_mean[known] += precision @ observation.values[known]
        level_information = self.level_information.copy()
        level_information[0][np.ix_(known, known)] += rise * precision
        level_information[1][np.ix_(known, known)] += rise**2 * precision
        return replace(
            self,
            name=observation.name or self.name,
            information=information,
            information_mean=information_mean,
            level_information=level_information,
            n_windows=self.n_windows + 1,
            first_window=self.first_window if self.n_windows else window,
            last_window=window,
            last_frequency=observation.frequency,
            last_frequency_std=float(np.linalg.norm(observation.factor[0])),
            damping_ratio=self._damping_with(observation),
        )

    def _damping_with(self, observation: ModeObservation) -> float:
        """Mean of ζ with one window more."""
        if self.n_windows == 0:
            return observation.damping_ratio
        return self.damping_ratio + (observation.damping_ratio - self.damping_ratio) / (
            self.n_windows + 1
        )

    def at_model_level(self, partner: "PartnerInWater") -> "ModeEvidence":
        """The evidence as if every window had had the model's water level."""
        slope, curvature = partner.parabola(self.frequency, self.unit_component)
        moved = self.level_information[0] @ slope + self.level_information[1] @ curvature
        return replace(self, information_mean=self.information_mean - moved)

    def with_levels_above(self, rise: float) -> "ModeEvidence":
        """The evidence with levels that count from one above the model's by so much [m]."""
        first, second = self.level_information
        moved = [
            first - rise * self.information,
            second - 2 * rise * first + rise**2 * self.information,
        ]
        return replace(self, level_information=np.array(moved))

    def with_channels(self, order: Sequence[int], signs: Sequence[float]) -> "ModeEvidence":
        """The same with every channel's values those of another, times a sign."""
        rows = np.concatenate([[0], 1 + np.asarray(order)])
        unit = list(order).index(self.unit_component)
        turned = np.concatenate([[1.0], np.asarray(signs) * signs[unit]])  # the unit stays 1
        both = np.outer(turned, turned)
        return replace(
            self,
            unit_component=unit,
            information=self.information[np.ix_(rows, rows)] * both,
            information_mean=self.information_mean[rows] * turned,
            level_information=self.level_information[:, rows][:, :, rows] * both,
        )

    def without_channels(self, channels: Collection[int]) -> "ModeEvidence":
        """The mode as if these channels had not measured; correlations among f and φ are left out.

        Where the unit component is one of them, the best known of the others, φ_v, becomes 1:

            φ'_i = φ_i / φ_v,   var φ'_i = (var φ_i + φ'_i² var φ_v) / φ_v²
        """
        kept = np.flatnonzero(self.known)
        kept = kept[~np.isin(kept - 1, list(channels))]
        mean, variances = self.mean.copy(), np.diag(self.covariance).copy()
        shape, unit = kept[kept > 0], self.unit_component
        if unit in channels and shape.size:
            best = shape[np.argmax(mean[shape] ** 2 / variances[shape])]
            by, its_variance, unit = mean[best], variances[best], int(best) - 1
            mean[shape] /= by
            variances[shape] = (variances[shape] + mean[shape] ** 2 * its_variance) / by**2
            kept = kept[kept != best]
        information, level = np.zeros_like(self.information), np.zeros_like(self.level_information)
        information[kept, kept] = 1 / variances[kept]
        of_level = self.level_information[:, kept, kept] / self.information[kept, kept]
        level[:, kept, kept] = of_level * information[kept, kept]
        return replace(
            self,
            unit_component=unit,
            information=information,
            information_mean=information.diagonal() * np.nan_to_num(mean),
            level_information=level,
        )

    def missed_by_chance(self, window: int) -> bool:
        """Whether a window, counted as the last one, that doesn't see the mode is the exception."""
        return self.n_windows > max(ESTABLISHED, SEEN_MOSTLY * (window - self.first_window))

    def forgotten(self, n_windows: int) -> bool:
        """Whether it has not been seen for so long, after n_windows in all, that it was a mistake
        or has gone for good."""
        patience = min(MISSED_WINDOWS * self.n_windows, LONGEST_PATIENCE)
        return n_windows - self.last_window > patience

    @property
    def known(self) -> NDArray[np.bool_]:
        """(1 + n_channels,) components about which there is information."""
        return np.diag(self.information) > 0

    @property
    def covariance(self) -> FloatArray:
        """S, (1 + n_channels, 1 + n_channels), of the combined estimate; NaN where unknown."""
        return _solved(self)[1]

    @property
    def mean(self) -> FloatArray:
        """d̄, (1 + n_channels,): f [Hz] and φ [-]; 1 at the unit component, NaN where unknown."""
        return _solved(self)[0]

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


@lru_cache(maxsize=SOLVED)
def _solved(mode: ModeEvidence) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance, read-only; a fit asks for them at every step."""
    known = np.flatnonzero(mode.known)
    information = mode.information[np.ix_(known, known)]
    mean = np.full(len(mode.information), np.nan)
    mean[known] = np.linalg.solve(information, mode.information_mean[known])
    if not mode.close_pair:
        mean[1 + mode.unit_component] = 1.0
    block = np.linalg.inv(information)
    covariance = np.full_like(mode.information, np.nan)
    covariance[np.ix_(known, known)] = (block + block.T) / 2
    mean.flags.writeable = covariance.flags.writeable = False
    return mean, covariance


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
