"""Modes of one band of a window, from its lag covariances: one decomposition, every order."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import normalised_with_deviations
from pipeline.oma.preprocessing import above
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.bands import Band
from pipeline.oma.ssi.coincident_modes import CoincidentModes, twins_in
from pipeline.oma.ssi.ssi_cov import (
    ALL,
    LagCovariances,
    References,
    SignalSubspace,
    SystemModes,
    lag_covariances,
    signal_subspace,
    system_modes,
)
from pipeline.oma.ssi.stabilization import (
    PoleCloud,
    PoleCluster,
    clusters,
    pole_cloud,
    recurring,
    to_acceleration,
    with_phases,
)
from pipeline.oma.ssi.uncertainty import (
    OrderDeviations,
    frequency_damping_deviations,
    order_deviations,
    pole_deviations,
    projected_deviations,
    shape_deviations,
    state_deviations,
)
from pipeline.oma.work_limit import checkpoint
from sensors.arrays import ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class BandIdentification:
    """What one band of a window says."""

    band: Band
    modes: tuple[Mode, ...]
    poles: PoleCloud
    """That came back over the orders: the band's stabilisation diagram."""
    twins: tuple[CoincidentModes, ...] = ()
    """Where two modes are too alike to be resolved."""


def band_covariances(
    samples: FloatArray,
    band: Band,
    settings: OmaSettings,
    references: References = ALL,
    *,
    n_samples: int,
) -> LagCovariances:
    """Lag covariances of a window in a band.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Decimated to the band's rate, before its high pass; each channel in its own unit.
    band : Band
        Its block rows are half the number of lags.
    settings : OmaSettings
        For the length of the time blocks.
    references : References, optional
        Channels that y_t runs over; all by default.
    n_samples : int
        Of the window at the full rate.
    """
    return lag_covariances(
        above(samples) if band.high_passed else samples,
        n_lags=2 * band.block_rows,
        block_length=block_length(n_samples, band, settings),
        references=references,
    )


def block_length(n_samples: int, band: Band, settings: OmaSettings) -> int:
    """Length of a time block of a window of n_samples at the full rate [samples of the band].

    The window holds n_blocks of them; the last few lack their lags and are not used.
    """
    return max(1, n_samples // (settings.n_blocks * band.decimation))


def modes_of_covariances(
    covariances: LagCovariances,
    band: Band,
    settings: OmaSettings,
    *,
    integrations: IntArray | None = None,
) -> BandIdentification:
    """Modes of one band from its lag covariances.

    Parameters
    ----------
    covariances : LagCovariances
        Of the window in the band.
    band : Band
        With the orders and block rows.
    settings : OmaSettings
        Limits of plausible poles and of their presence over the orders.
    integrations : ndarray of int, shape (n_channels,), optional
        Of channels that measure different quantities (`quantities.py`).

    Raises
    ------
    LinAlgError
        If the covariances hold no system, as of one pure tone.
    """
    subspace = signal_subspace(
        covariances.mean, block_rows=band.block_rows, highest_order=max(band.orders)
    )
    dt = 1 / band.sampling_rate
    systems = list(system_modes(subspace, orders=band.orders, sampling_interval=dt))
    if not systems:
        raise np.linalg.LinAlgError("a signal subspace that holds no system of any order")
    cloud, moved = _sharp_cloud(systems, subspace, covariances, band, settings, integrations)
    found = clusters(cloud, n_orders=len(systems), minimum_presence=settings.confirmed_presence)
    scales = ChannelScales(covariances.scales, integrations, dt)
    modes = _represented(found, cloud, moved, scales)
    in_phase = [with_phases(system, band, integrations) for system in systems]
    twins = twins_in(in_phase, band, settings)
    return BandIdentification(band, tuple(modes), cloud, twins)


def _sharp_cloud(
    systems: Sequence[SystemModes],
    subspace: SignalSubspace,
    covariances: LagCovariances,
    band: Band,
    settings: OmaSettings,
    integrations: IntArray | None,
) -> tuple[PoleCloud, list[OrderDeviations]]:
    """Plausible poles that come back over the orders and whose frequency is known well enough;
    and how the time blocks move each order's system."""
    cloud = pole_cloud(systems, band, settings, integrations)
    cloud = cloud.only(
        recurring(cloud, n_orders=len(systems), minimum_presence=settings.confirmed_presence)
    )
    if not len(cloud):
        return cloud, []
    projected = projected_deviations(subspace, covariances.deviations)
    frequency = np.empty((len(cloud), projected.n_blocks))
    damping = np.empty_like(frequency)
    by_order = []
    for system in systems:
        checkpoint()
        here = cloud.orders == system.order
        if not here.any():
            continue
        order = order_deviations(projected, system)
        chosen = cloud.indices[here]
        poles = frequency_damping_deviations(
            system.poles[chosen],
            pole_deviations(state_deviations(order, chosen)),
            1 / band.sampling_rate,
        )
        frequency[here], damping[here] = poles.frequency, poles.damping_ratio
        by_order.append(order)
    cloud = replace(cloud, frequency_deviations=frequency, damping_deviations=damping)
    sharp = cloud.frequency_stds <= settings.maximum_frequency_std * cloud.frequencies
    return cloud.only(sharp), by_order


def _represented(
    found: Sequence[PoleCluster],
    cloud: PoleCloud,
    by_order: Sequence[OrderDeviations],
    scales: "ChannelScales",
) -> list[Mode]:
    """Every cluster's representative with its joint uncertainty and the cluster's own spread."""
    modes = []
    for order in by_order:
        system = order.modes
        here = [c for c in found if cloud.orders[c.representative] == system.order]
        if not here:
            continue
        chosen = np.array([cloud.indices[c.representative] for c in here])
        shapes = shape_deviations(state_deviations(order, chosen))
        for place, cluster in enumerate(here):
            pole = cluster.representative
            shape, shape_factor = normalised_with_deviations(
                *scales.applied(
                    system.poles[chosen[place]],
                    system.shapes[:, chosen[place]],
                    shapes[place],
                    cloud.frequency_deviations[pole] / cloud.frequencies[pole],
                )
            )
            modes.append(
                mode_from_factor(
                    frequency=float(cloud.frequencies[pole]),
                    damping_ratio=float(cloud.damping_ratios[pole]),
                    shape=shape,
                    block_factor=np.vstack(
                        [
                            cloud.frequency_deviations[pole],
                            cloud.damping_deviations[pole],
                            shape_factor,
                        ]
                    ),
                    own_factor=_spread_factor(cluster, len(shape)),
                    phase_collinearity=float(cloud.collinearities[pole]),
                    presence=cluster.presence,
                )
            )
    return modes


@dataclass(frozen=True, slots=True, eq=False)
class ChannelScales:
    """From the shapes of scaled channels to those of accelerations in the channels' units."""

    rms: FloatArray
    """What each channel was divided by, (n_channels,)."""
    integrations: IntArray | None
    """Where channels measure different quantities, (n_channels,)."""
    sampling_interval: float
    """Time between two samples [s]."""

    def applied(
        self,
        pole: complex,
        shape: ComplexArray,
        deviations: ComplexArray,
        frequency_deviations: FloatArray,
    ) -> tuple[ComplexArray, ComplexArray]:
        """A shape, (n_channels,), and its deviations by block, (n_channels, n_blocks), both scaled.

        Parameters
        ----------
        pole : complex
            λ of the discrete-time system [-].
        shape : ndarray of complex, shape (n_channels,)
            Of the scaled channels [-].
        deviations : ndarray of complex, shape (n_channels, n_blocks)
            Δφ by block [-].
        frequency_deviations : ndarray, shape (n_blocks,)
            Δf/f by block [-].

        Notes
        -----
        Δ(μ^d φ) = μ^d (Δφ + d φ Δμ/μ), and Δμ/μ is Δf/f but for the damping's share.
        """
        factors: ComplexArray = self.rms.astype(complex)
        if self.integrations is not None and self.integrations.any():
            to = to_acceleration(np.array([pole]), self.sampling_interval, self.integrations)
            factors = factors * to[0]
            deviations = deviations + np.outer(self.integrations * shape, frequency_deviations)
        return shape * factors, deviations * factors[:, None]


def _spread_factor(cluster: PoleCluster, n_channels: int) -> FloatArray:
    """Columns that add the cluster's own spread of f and ζ over the orders."""
    factor = np.zeros((2 + n_channels, 2))
    factor[0, 0], factor[1, 1] = cluster.frequency_spread, cluster.damping_spread
    return factor


def mode_from_factor(
    *,
    frequency: float,
    damping_ratio: float,
    shape: FloatArray,
    block_factor: FloatArray,
    own_factor: FloatArray,
    phase_collinearity: float,
    presence: float,
) -> Mode:
    """A Mode whose stds follow from its covariance factors (rows f, ζ, φ)."""
    factor = np.hstack([block_factor, own_factor])
    frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
    return Mode(
        name="",
        frequency=frequency,
        frequency_std=float(frequency_std),
        damping_ratio=damping_ratio,
        damping_ratio_std=float(damping_std),
        shape=shape,
        covariance_factor=factor,
        n_block_columns=block_factor.shape[1],
        phase_collinearity=phase_collinearity,
        presence=presence,
        quality=presence * phase_collinearity,
    )
