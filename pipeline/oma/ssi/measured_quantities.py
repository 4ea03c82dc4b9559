"""Channels of one motion that measure different quantities: acceleration, velocity, displacement.

A mode of continuous-time pole μ moves as exp(μt): its acceleration is μ times its velocity and
μ² times its displacement. A state-space model holds for any mixture of outputs, so nothing is
differentiated; only the identified shapes are brought to accelerations, by their own poles.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import IntArray
from sensors.files.table import Quantity

INTEGRATIONS: dict[Quantity, int] = {"acceleration": 0, "velocity": 1, "displacement": 2}


def integrations_of(quantities: Sequence[Quantity] | None, n_channels: int) -> IntArray:
    """How many times each channel's acceleration is integrated, (n_channels,).

    Zero throughout where nothing is known or all measure the same: their shapes agree up to a
    factor, which a shape does not have.
    """
    if quantities is None or len(set(quantities)) < 2:
        return np.zeros(n_channels, dtype=np.int64)
    return np.array([INTEGRATIONS[quantity] for quantity in quantities])


def to_acceleration(
    poles: NDArray[np.complexfloating], sampling_interval: float, integrations: IntArray
) -> NDArray[np.complexfloating]:
    """μ^d: factors from identified shapes to those of accelerations, (n_modes, n_channels).

    poles               discrete-time ones λ, (n_modes,): μ = ln λ / Δt [rad/s]
    sampling_interval   Δt [s]
    integrations        d of each channel, (n_channels,)
    """
    continuous = np.log(poles) / sampling_interval
    return np.asarray(continuous[:, None] ** integrations[None, :])
