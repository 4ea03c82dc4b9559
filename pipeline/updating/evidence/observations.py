"""An estimate's modes as observations: on all channels of the layout, a close pair as one."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import normalised_to, renormalised_factor
from pipeline.updating.checkpoint import STORED_AS
from sensors.arrays import FloatArray

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
class ModeObservation:
    """One mode as one window saw it, on all channels of the layout.

    Rows are f [Hz], then φ [-] of every channel; those of absent channels, and all of φ for a
    close pair, are NaN in `values` and zero in `factor`.
    """

    name: str
    values: FloatArray
    """(1 + n_channels,)."""
    factor: FloatArray
    """F, (1 + n_channels, n_columns), F Fᵀ the covariance."""
    n_blocks: int
    """Time blocks from which the covariance was estimated."""
    close_pair: bool = False
    """The mean frequency of two modes that could not be separated."""
    damping_ratio: float = np.nan
    """ζ; NaN for a close pair [-]."""

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

    def normalised_to(self, component: int) -> "ModeObservation":
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


@dataclass(frozen=True, slots=True, eq=False)
class SeenWindow:
    """What one window saw, small enough to be kept and summed again by another rule."""

    start_ns: int
    duration: float
    """[s]"""
    weight: float
    """hop / window duration [-]"""
    rise: float
    """Of the water above the model's level [m]; 0 where nothing reported it"""
    observations: tuple[ModeObservation, ...] = field(metadata={STORED_AS: "sightings"})
    level_known: bool = True
    """Whether anything reported the water's level"""

    @classmethod
    def of(
        cls, estimate: ModalEstimate, observations: Sequence[ModeObservation], rise: float
    ) -> "SeenWindow":
        """The window of an estimate, with its modes as observations."""
        return cls(
            start_ns=estimate.start_ns,
            duration=estimate.duration,
            weight=estimate.weight,
            rise=rise,
            observations=tuple(observations),
            level_known=bool(np.isfinite(estimate.water_level)),
        )


def mode_observations(estimate: ModalEstimate, channels: Sequence[str]) -> list[ModeObservation]:
    """Every mode of an estimate on the layout's channels, the members of a close pair as one.

    Parameters
    ----------
    estimate : ModalEstimate
        Of one window.
    channels : sequence of str
        The layout's.

    Raises
    ------
    EstimateRefused
        For no mode at all, for a channel the layout doesn't have, and for a covariance that is not
        finite or not positive.
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
    return [_observation(group, rows, 1 + len(channels)) for group in groups.values()]


def condensed(observation: ModeObservation) -> ModeObservation:
    """The same with as many columns as rows at most: L of F Fᵀ = L Lᵀ.

    Variances alone are not enough: normalised to another component later, a shape needs its
    covariance, or errors that are independent would cancel.
    """
    n_rows, n_columns = observation.factor.shape
    if n_columns <= n_rows:
        return observation
    return replace(observation, factor=np.asarray(np.linalg.qr(observation.factor.T, mode="r")).T)


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


def _observation(group: list[Mode], rows: NDArray[np.intp], n_rows: int) -> ModeObservation:
    mode = group[0]
    if len(group) > 1:
        return _pair_observation(group, n_rows)
    values = np.full(n_rows, np.nan)
    factor = np.zeros((n_rows, mode.covariance_factor.shape[1]))
    values[0], factor[0] = mode.frequency, mode.covariance_factor[0]
    values[rows], factor[rows] = mode.shape, mode.covariance_factor[2:]
    return ModeObservation(
        mode.name, values, factor, mode.n_block_columns, damping_ratio=mode.damping_ratio
    )


def _pair_observation(group: list[Mode], n_rows: int) -> ModeObservation:
    """The mean frequency of a close pair: what is known of two modes nearer than their own
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
    return ModeObservation(name, values, factor, n_blocks, close_pair=True)
