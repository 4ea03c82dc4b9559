"""Which poles are modes: hard criteria, clusters over the model orders, one representative each.

Nobody picks poles, and nothing is known of the structure: a pole is a mode when it comes back
with the same frequency and shape in most model orders.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.modal_shapes import modal_assurance_criterion
from pipeline.oma.bands import Band
from pipeline.oma.mode_shapes import modal_phase_collinearity
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi_cov import SystemModes

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
BoolArray = NDArray[np.bool_]
IntArray = NDArray[np.int64]

LEAST_TOLERANCE = 0.002  # two poles this close in frequency (relative) may be one mode, whatever
LARGEST_TOLERANCE = 0.02  # their std says; further apart than this they never are
LEAST_MAC = 0.9  # between poles of one mode in different orders


@dataclass(frozen=True, slots=True, eq=False)
class PoleCloud:
    """All poles of a band that may belong to modes: the stabilisation diagram."""

    orders: IntArray  # model order of each pole, (n_poles,)
    indices: IntArray  # the pole's place among the modes of its order, (n_poles,)
    frequencies: FloatArray  # (n_poles,) [Hz]
    frequency_stds: FloatArray  # (n_poles,) [Hz]
    damping_ratios: FloatArray  # (n_poles,) [-]
    shapes: ComplexArray  # (n_poles, n_channels) [-]
    collinearities: FloatArray  # MPC, (n_poles,) [-]

    def __len__(self) -> int:
        return len(self.frequencies)


@dataclass(frozen=True, slots=True, eq=False)
class PoleCluster:
    """Poles of different orders taken for one mode."""

    members: IntArray  # indices into the cloud, at most one of each order
    representative: int  # index into the cloud
    presence: float  # share of the orders [-]
    frequency_spread: float  # std of the members' frequencies [Hz]
    damping_spread: float  # std of the members' damping ratios [-]


def plausible(modes: SystemModes, band: Band, settings: OmaSettings) -> BoolArray:
    """Hard criteria that need no uncertainty: inside the band, damped as structures are."""
    return np.asarray(
        (modes.frequencies >= band.lowest)
        & (modes.frequencies <= band.highest)
        & (modes.damping_ratios > 0)
        & (modes.damping_ratios < settings.maximum_damping)
        & (modal_phase_collinearity(modes.shapes.T) >= settings.minimum_collinearity)
    )


def pole_cloud(
    systems: Sequence[SystemModes],
    kept: Sequence[BoolArray],
    frequency_stds: Sequence[FloatArray],
) -> PoleCloud:
    """The kept poles of all orders side by side; frequency_stds are those of the kept ones."""
    indices = [np.flatnonzero(mask) for mask in kept]
    shapes = np.concatenate(
        [system.shapes.T[index] for system, index in zip(systems, indices, strict=True)]
    )
    return PoleCloud(
        orders=np.repeat([s.order for s in systems], [len(index) for index in indices]),
        indices=np.concatenate(indices),
        frequencies=np.concatenate(
            [s.frequencies[index] for s, index in zip(systems, indices, strict=True)]
        ),
        frequency_stds=np.concatenate(list(frequency_stds)),
        damping_ratios=np.concatenate(
            [s.damping_ratios[index] for s, index in zip(systems, indices, strict=True)]
        ),
        shapes=shapes,
        collinearities=modal_phase_collinearity(shapes),
    )


def clusters(cloud: PoleCloud, *, n_orders: int, minimum_presence: float) -> list[PoleCluster]:
    """Groups of poles that come back over the orders, lowest frequency first.

    Two poles are alike when their frequencies agree within three of their joint std (no less than
    0.2 %, no more than 2 %) and their MAC is 0.9 or more. The pole with the most likenesses in
    other orders gathers them, one of each order; then the next, until no group is large enough.
    """
    if not len(cloud):
        return []
    alike = _alikeness(cloud)
    free = np.ones(len(cloud), dtype=bool)
    least = max(2.0, minimum_presence * n_orders)
    found = []
    while free.any():
        degree = np.where(free, (alike & free).sum(axis=1), 0)
        centre = int(np.argmax(degree))
        if degree[centre] < least:
            break
        members = _one_of_each_order(cloud, np.flatnonzero(alike[centre] & free), centre)
        free[alike[centre] & free] = False
        if len(members) >= least:
            found.append(_cluster(cloud, members, n_orders))
    return sorted(found, key=lambda cluster: float(cloud.frequencies[cluster.representative]))


def _alikeness(cloud: PoleCloud) -> BoolArray:
    f = cloud.frequencies
    joint_std = np.hypot(cloud.frequency_stds[:, None], cloud.frequency_stds[None, :])
    tolerance = np.clip(3 * joint_std / f[:, None], LEAST_TOLERANCE, LARGEST_TOLERANCE) * f[:, None]
    near = np.abs(f[:, None] - f[None, :]) <= tolerance
    return near & (modal_assurance_criterion(cloud.shapes, cloud.shapes) >= LEAST_MAC)


def _one_of_each_order(cloud: PoleCloud, candidates: IntArray, centre: int) -> IntArray:
    """Of several candidates of one order, the one nearest in frequency to the centre."""
    distance = np.abs(cloud.frequencies[candidates] - cloud.frequencies[centre])
    nearest_first = candidates[np.argsort(distance, kind="stable")]
    _, first = np.unique(cloud.orders[nearest_first], return_index=True)
    return np.asarray(nearest_first[first])


def _cluster(cloud: PoleCloud, members: IntArray, n_orders: int) -> PoleCluster:
    """Why the lower quartile of the std: choosing the smallest is a little lucky (its std is too
    small), the median is spoilt by orders in which a noise pole sits beside the mode."""
    by_std = members[np.argsort(cloud.frequency_stds[members], kind="stable")]
    return PoleCluster(
        members=members,
        representative=int(by_std[(len(by_std) - 1) // 4]),
        presence=len(members) / n_orders,
        frequency_spread=float(np.std(cloud.frequencies[members])),
        damping_spread=float(np.std(cloud.damping_ratios[members])),
    )
