"""Two modes nearer than the window can resolve: a joint estimate instead of two wrong ones.

A round tower has a fore-aft and a side-side bending mode of almost one frequency. When they lie
within the window's resolution 1/T, the order of the two in frequency and their axes in the plane
that they span cannot be known. What the window does know is the plane, the pair's mean frequency
and, when the axes shake unequally, roughly the axes. Such a pair becomes two entries with one
`pair_id`, whose covariance says so.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class Partner:
    """The second direction that shakes at a mode's frequency."""

    shape: FloatArray
    """(n_channels,), any scale, in the samples' units [-]."""
    power_share: float
    """Of the mode's own power [-]."""
    noise_share: float
    """Power of the background over the partner's [-]."""
    turn: float | None = None
    """Std of the angle between the true axes and these, where something but their power tells
    them apart [rad]."""

    @property
    def turns(self) -> tuple[float, float]:
        """Share of the other one's shape that each may hold, of the stronger one and of this one,
        std [-]."""
        ratio = float(np.sqrt(self.power_share))
        if self.turn is None:
            return min(1.0, ratio), min(1.0, ratio)
        return min(1.0, self.turn * ratio), min(1.0, self.turn / ratio)


def joint_pair(
    leader: Mode, frequencies: FloatArray, spreads: FloatArray, partner: Partner
) -> tuple[Mode, Mode]:
    """Two entries that hold what is known of a pair: frequencies, plane, rough axes.

    Parameters
    ----------
    leader : Mode
        With the shape that most of the power belongs to.
    frequencies : ndarray, shape (2,)
        Mean ones of the power along the two axes [Hz].
    spreads : ndarray, shape (2,)
        Added in quadrature to their std [Hz].
    partner : Partner
        The other shape and how far the two may turn towards each other.

    Notes
    -----
    Each shape may be turned in the plane towards the other. Of axes that only their power
    distinguishes the angle is small only when the partner's power is: its std is sqrt(power share).
    It enters as one more column of the factor.
    """
    of_leader, of_second = partner.turns
    second = partner.shape / partner.shape[np.argmax(np.abs(partner.shape))]
    shapes = (leader.shape, second)
    towards = (of_leader * second, of_second * leader.shape)
    noises = (0.0, float(np.sqrt(partner.noise_share)))
    pair_id = f"{frequencies.mean():.4f} Hz"
    first_entry, second_entry = (
        _entry(
            leader,
            float(frequencies[place]),
            shapes[place],
            towards=towards[place],
            noise=noises[place],
            frequency_spread=float(spreads[place]),
            pair_id=pair_id,
        )
        for place in (0, 1)
    )
    return first_entry, second_entry


def _entry(
    leader: Mode,
    frequency: float,
    shape: FloatArray,
    *,
    towards: FloatArray,
    noise: float,
    frequency_spread: float,
    pair_id: str,
) -> Mode:
    """One of the two: the leader's pole with another shape and what is not known of it."""
    n_channels = len(shape)
    unit = int(np.argmax(np.abs(shape)))
    factor = np.zeros((2 + n_channels, leader.covariance_factor.shape[1] + 2 + n_channels))
    n_known = leader.covariance_factor.shape[1]
    factor[:2, :n_known] = leader.covariance_factor[:2]
    if shape is leader.shape:
        factor[2:, :n_known] = leader.covariance_factor[2:]
    factor[0, n_known] = frequency_spread
    factor[2:, n_known + 1] = towards - shape * towards[unit]  # the unit component stays 1
    factor[2:, n_known + 2 :] = noise * (
        np.eye(n_channels) - np.outer(shape, np.eye(n_channels)[unit])
    )
    return replace(
        leader,
        frequency=frequency,
        frequency_std=float(np.linalg.norm(factor[0])),
        shape=shape,
        covariance_factor=factor,
        pair_id=pair_id,
    )
