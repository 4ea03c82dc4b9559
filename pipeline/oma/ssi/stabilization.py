"""Which poles are modes: hard criteria, clusters over the model orders, one representative each.

Poles are not picked by hand, and nothing is known of the structure: a pole is a mode when it comes
back with the same frequency and shape in most model orders.

Channels of one motion may measure different quantities. A mode of continuous-time pole μ moves as
exp(μt): its acceleration is μ times its velocity and μ² times its displacement. A state-space model
holds for any mixture of outputs, so nothing is differentiated; only the identified shapes are
brought to accelerations, by their own poles.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, RefusedMode, StabilisationDiagram
from pipeline.modal_assurance import modal_assurance_criterion, modal_phase_collinearity
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.bands import Band
from pipeline.oma.ssi.ssi_cov import SystemModes
from sensors.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from sensors.files.table import Quantity

LEAST_TOLERANCE = 0.002  # two poles this close in frequency (relative) may be one mode, whatever
LARGEST_TOLERANCE = 0.02  # their std says; further apart than this they never are
LEAST_MAC = 0.9  # between poles of one mode in different orders
INTEGRATIONS: dict[Quantity, int] = {"acceleration": 0, "velocity": 1, "displacement": 2}
REPRESENTATIVE = 4  # a mode is represented by the pole at this part of its poles, by std


@dataclass(frozen=True, slots=True, eq=False)
class PoleCloud:
    """Poles of all orders of a band that may belong to modes: the stabilisation diagram."""

    orders: IntArray
    """Model order of each pole, (n_poles,)."""
    indices: IntArray
    """The pole's place among the modes of its order, (n_poles,)."""
    frequencies: FloatArray
    """(n_poles,) [Hz]."""
    damping_ratios: FloatArray
    """(n_poles,) [-]."""
    shapes: ComplexArray
    """(n_poles, n_channels) [-] first-order deviations by time block, (n_poles, n_blocks); no
    columns until computed.
    """
    frequency_deviations: FloatArray
    """Δf [Hz]."""
    damping_deviations: FloatArray
    """Δζ [-]."""

    def __len__(self) -> int:
        return len(self.frequencies)

    @property
    def frequency_stds(self) -> FloatArray:
        """(n_poles,) [Hz]"""
        return np.linalg.norm(self.frequency_deviations, axis=1)

    @property
    def collinearities(self) -> FloatArray:
        """MPC, (n_poles,) [-]"""
        return modal_phase_collinearity(self.shapes)

    def only(self, chosen: BoolArray) -> "PoleCloud":
        """The cloud of the chosen poles."""
        return PoleCloud(*(getattr(self, field.name)[chosen] for field in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class PoleCluster:
    """Poles of different orders taken for one mode."""

    members: IntArray
    """Indices into the cloud, at most one of each order."""
    representative: int
    """Index into the cloud."""
    presence: float
    """Share of the orders [-]."""
    frequency_spread: float
    """Of the members about the representative, beyond their std [Hz]."""
    damping_spread: float
    """The same of the damping ratios [-]."""


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
    band: Band,
    settings: OmaSettings,
    integrations: IntArray | None = None,
) -> PoleCloud:
    """The plausible poles of all orders side by side; their std is not known yet.

    Parameters
    ----------
    systems : sequence of SystemModes
        Of all orders of the band.
    band : Band
        Its range of frequencies is where poles are plausible.
    settings : OmaSettings
        Limits of a plausible pole.
    integrations : ndarray of int, shape (n_channels,), optional
        Of channels that measure different quantities (`quantities.py`).
    """
    systems = [with_phases(system, band, integrations) for system in systems]
    kept = [np.flatnonzero(plausible(system, band, settings)) for system in systems]
    pairs = list(zip(systems, kept, strict=True))
    frequencies = np.concatenate([s.frequencies[index] for s, index in pairs])
    return PoleCloud(
        orders=np.repeat([s.order for s in systems], [len(index) for index in kept]),
        indices=np.concatenate(kept),
        frequencies=frequencies,
        damping_ratios=np.concatenate([s.damping_ratios[index] for s, index in pairs]),
        shapes=np.concatenate([s.shapes.T[index] for s, index in pairs]),
        frequency_deviations=np.empty((len(frequencies), 0)),
        damping_deviations=np.empty((len(frequencies), 0)),
    )


def integrations_of(quantities: Sequence[Quantity] | None, n_channels: int) -> IntArray:
    """How many times each channel's acceleration is integrated, (n_channels,).

    Parameters
    ----------
    quantities : sequence of Quantity or None
        What each channel measures; None: not known.
    n_channels : int
        Length of the result.

    Notes
    -----
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

    Parameters
    ----------
    poles : ndarray of complex, shape (n_modes,)
        Discrete-time ones λ: μ = ln λ / Δt [rad/s].
    sampling_interval : float
        Δt [s].
    integrations : ndarray of int, shape (n_channels,)
        d of each channel.
    """
    continuous = np.log(poles) / sampling_interval
    return np.asarray(continuous[:, None] ** integrations[None, :])


def with_phases(system: SystemModes, band: Band, integrations: IntArray | None) -> SystemModes:
    """Shapes with the phases of accelerations; each channel keeps its own scale."""
    if integrations is None or not integrations.any():
        return system
    factors = to_acceleration(system.poles, 1 / band.sampling_rate, integrations)
    return replace(system, shapes=system.shapes * (factors / np.abs(factors)).T)


def recurring(cloud: PoleCloud, *, n_orders: int, minimum_presence: float) -> BoolArray:
    """Poles with enough like ones in other orders to be in a cluster, whatever their std.

    Only these are worth the cost of an uncertainty.
    """
    f = cloud.frequencies
    near = np.abs(f[:, None] - f[None, :]) <= LARGEST_TOLERANCE * f[:, None]
    alike = near & (modal_assurance_criterion(cloud.shapes, cloud.shapes) >= LEAST_MAC)
    in_order = cloud.orders[:, None] == np.unique(cloud.orders)[None, :]
    present = (alike.astype(np.float32) @ in_order.astype(np.float32)) > 0
    return np.asarray(present.sum(axis=1) >= _least_members(n_orders, minimum_presence))


def _least_members(n_orders: int, minimum_presence: float) -> float:
    return max(2.0, minimum_presence * n_orders)


def clusters(cloud: PoleCloud, *, n_orders: int, minimum_presence: float) -> list[PoleCluster]:
    """Groups of poles that come back over the orders, lowest frequency first.

    Parameters
    ----------
    cloud : PoleCloud
        Poles of all orders with their std.
    n_orders : int
        Model orders behind the cloud.
    minimum_presence : float
        Share of the orders that a group needs [-].

    Notes
    -----
    Two poles are alike when their frequencies agree within three of their joint std (no less than
    0.2 %, no more than 2 %) and their MAC is 0.9 or more. The pole with the most likenesses in
    other orders gathers them, one of each order; then the next, until no group is large enough.
    """
    if not len(cloud):
        return []
    alike = _alikeness(cloud)
    free = np.ones(len(cloud), dtype=bool)
    least = _least_members(n_orders, minimum_presence)
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
    f, std = cloud.frequencies, cloud.frequency_stds
    joint_std = np.hypot(std[:, None], std[None, :])
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
    std = cloud.frequency_stds[members]
    by_std = members[np.argsort(std, kind="stable")]
    representative = int(by_std[(len(by_std) - 1) // REPRESENTATIVE])
    return PoleCluster(
        members=members,
        representative=representative,
        presence=len(members) / n_orders,
        frequency_spread=unexplained_spread(
            cloud.frequencies[members] - cloud.frequencies[representative],
            cloud.frequency_deviations[members] - cloud.frequency_deviations[representative],
            weights=std**-2,
        ),
        damping_spread=unexplained_spread(
            cloud.damping_ratios[members] - cloud.damping_ratios[representative],
            cloud.damping_deviations[members] - cloud.damping_deviations[representative],
            weights=std**-2,
        ),
    )


def unexplained_spread(
    differences: FloatArray, deviations: FloatArray, *, weights: FloatArray
) -> float:
    """Rms difference between estimates of one quantity that their own uncertainty leaves open.

    Parameters
    ----------
    differences : ndarray, shape (n,)
        d of each estimate from the one that is kept, in the quantity's unit.
    deviations : ndarray, shape (n, n_blocks)
        Δd by time block: var(d) = Σ_b Δd².
    weights : ndarray, shape (n,)
        w [-].

    Notes
    -----
        spread² = max(0, Σ w (d² − var(d)) / Σ w)
    """
    excess = differences**2 - np.sum(deviations**2, axis=1)
    return float(np.sqrt(max(0.0, np.average(excess, weights=weights))))


def stabilisation_diagram(
    estimate: ModalEstimate, bands: Sequence[PoleCloud], refused: Sequence[RefusedMode] = ()
) -> StabilisationDiagram:
    """Poles of all bands side by side, in single precision: nothing is computed with them.

    Parameters
    ----------
    estimate : ModalEstimate
        Whose turbine, window and modes the diagram has.
    bands : sequence of PoleCloud
        The poles behind the estimate by frequency band, slowest first.
    refused : sequence of RefusedMode, optional
        What looked like a mode among them and is not reported.
    """
    poles = {
        "orders": [band.orders for band in bands],
        "bands": [np.full(len(band), index) for index, band in enumerate(bands)],
        "frequencies": [band.frequencies for band in bands],
        "frequency_stds": [band.frequency_stds for band in bands],
        "damping_ratios": [band.damping_ratios for band in bands],
    }
    return StabilisationDiagram(
        estimate.turbine,
        estimate.window,
        estimate.start_ns,
        estimate.end_ns,
        **{name: np.concatenate([*parts, []]).astype(np.float32) for name, parts in poles.items()},
        refused=tuple(refused),
    )
