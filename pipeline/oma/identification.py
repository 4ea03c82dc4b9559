"""Blind identification of one window: samples in, modes with their uncertainty out."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import Mode, Warning  # noqa: A004  # the field's word
from pipeline.modal_shapes import modal_assurance_criterion
from pipeline.oma.bands import Band, plan_bands
from pipeline.oma.close_pairs import UNRESOLVED, with_close_pairs
from pipeline.oma.covariance import ALL, LagCovariances, References, lag_covariances
from pipeline.oma.input_checks import (
    HARMONIC_DAMPING,
    Finding,
    check_samples,
    check_timestamps,
    evenly_sampled,
    is_harmonic,
    mended,
)
from pipeline.oma.mode_shapes import normalised_with_deviations
from pipeline.oma.preprocessing import decimated, without_offset
from pipeline.oma.references import references_among
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi_cov import SignalSubspace, SystemModes, signal_subspace, system_modes
from pipeline.oma.stabilization import (
    PoleCloud,
    PoleCluster,
    clusters,
    pole_cloud,
    recurring,
    unexplained_spread,
)
from pipeline.oma.uncertainty import (
    OrderDeviations,
    frequency_damping_deviations,
    order_deviations,
    pole_deviations,
    projected_deviations,
    shape_deviations,
    state_deviations,
)

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """What one window says: its modes, or why it says nothing."""

    modes: tuple[Mode, ...]  # lowest frequency first
    warnings: tuple[Warning, ...] = ()
    rejection: Warning | None = None  # the window cannot be identified; `modes` is empty then
    diagrams: tuple[PoleCloud, ...] = ()  # stabilisation diagram of each band, slowest first


@dataclass(frozen=True, slots=True, eq=False)
class BandIdentification:
    """What one band of a window says."""

    modes: tuple[Mode, ...]
    poles: PoleCloud  # that came back over the orders: the band's stabilisation diagram
    subspace: SignalSubspace  # for the next window to begin with


def identify(
    samples: NDArray[np.floating],
    sampling_rate: float,
    settings: OmaSettings | None = None,
    *,
    times: FloatArray | None = None,
    channel_names: Sequence[str] | None = None,
) -> Identification:
    """Modes of the structure that a whole array of samples, taken as one window, shows.

    samples         (n, n_channels); any unit, channels may differ in theirs
    sampling_rate   [Hz]
    times           (n,) time stamps of the samples, if there are any [s]
    channel_names   for warnings and the references; "channel 1" and so on by default

    Shapes are in the samples' own units: a channel in g beside one in m/s² reads accordingly.
    A window with a gap, NaN or a dead channel is rejected, which is a value and no exception.
    Raises OmaSettingsError when the sampling rate is too low for the frequencies asked for, or a
    reference channel is unknown.
    """
    settings = settings or OmaSettings()
    names = channel_names or default_names(samples.shape[1])
    references = references_among(names, settings)
    findings = check_window(samples, sampling_rate, channel_names=names, times=times)
    if rejection_in(findings) is not None:
        return Identification((), (), rejection_in(findings))
    clean = mended(np.asarray(samples, dtype=np.float64), findings)
    if times is not None and any(f.code in ("uneven-clock", "sampling-rate") for f in findings):
        clean = evenly_sampled(clean, times)
        sampling_rate = (len(times) - 1) / float(times[-1] - times[0])
    bands = plan_bands(
        n_samples=len(samples),
        n_channels=samples.shape[1],
        sampling_rate=sampling_rate,
        settings=settings,
    )
    steady = without_offset(clean)
    by_band = [
        modes_of_covariances(band_covariances(steady, band, settings, references), band, settings)
        for band in bands
    ]
    return concluded(by_band, steady, sampling_rate, findings, settings)


def concluded(
    by_band: Sequence[BandIdentification],
    steady: FloatArray,
    sampling_rate: float,
    findings: Sequence[Finding],
    settings: OmaSettings,
) -> Identification:
    """All bands' modes as one list: each once, close pairs joined; harmonics and what is known
    too vaguely for a mode left out.

    steady   the window's samples, free of offset, (n, n_channels)
    """
    modes, harmonics = [], []
    for mode in merged([band.modes for band in by_band]):
        doubtful = mode.damping_ratio < HARMONIC_DAMPING
        if doubtful and is_harmonic(steady, sampling_rate, mode.frequency):
            harmonics.append(mode)
        elif known_as_modes_are(mode, len(steady) / sampling_rate, settings):
            modes.append(mode)
    warnings = [finding.warning for finding in findings]
    warnings += [
        Warning(
            "harmonic",
            f"what shakes at {mode.frequency:.4g} Hz keeps its amplitude: a machine's harmonic, "
            "not taken for a mode",
        )
        for mode in harmonics
    ]
    return Identification(
        with_close_pairs(modes, steady, sampling_rate),
        tuple(warnings),
        diagrams=tuple(band.poles for band in by_band),
    )


def known_as_modes_are(mode: Mode, duration: float, settings: OmaSettings) -> bool:
    """Whether a frequency is known as well as that of a mode is.

    duration   T of the window [s]

    No unbiased estimate of a mode's frequency is sharper than about std(f)/f = √(ζ/(2π f T)). On
    random systems of 1 to 8 channels over 1 to 60 min, nine of ten estimates of modes lay below ten
    times this bound, with f and ζ known to .6 of the half bandwidth ζ f and ζ, or at the bound
    where the window holds few of the mode's periods; most of what only fitted noise or a
    neighbour's skirt did not. White noise alone still passes now and then: 7 modes in 100 windows
    of 1 to 4 channels.
    """
    relative_std = mode.frequency_std / mode.frequency
    resolved = mode.damping_ratio * mode.frequency * duration >= UNRESOLVED
    if resolved and mode.shape_std.max() > settings.maximum_shape_std:
        return False  # a mixture of neighbours, as which it would pass for a mode
    bound = float(np.sqrt(mode.damping_ratio / (2 * np.pi * mode.frequency * duration)))
    if relative_std <= AT_BOUND * bound:
        return True
    share = max(relative_std, mode.damping_ratio_std) / mode.damping_ratio
    return (
        relative_std <= settings.maximum_bound_ratio * bound
        and share <= settings.maximum_bandwidth_share
    )


def check_window(
    samples: NDArray[np.floating],
    sampling_rate: float,
    *,
    channel_names: Sequence[str] | None = None,
    times: FloatArray | None = None,
) -> tuple[Finding, ...]:
    """Everything that is doubtful about a window's samples and time stamps."""
    names = channel_names or default_names(samples.shape[1])
    findings = check_samples(samples, sampling_rate, names)
    return findings if times is None else findings + check_timestamps(times, sampling_rate)


def default_names(n_channels: int) -> tuple[str, ...]:
    """What channels without a name are called."""
    return tuple(f"channel {i + 1}" for i in range(n_channels))


def rejection_in(findings: Sequence[Finding]) -> Warning | None:
    """Why a window is not identified; None when it may be."""
    return next((f.warning for f in findings if f.action == "reject"), None)


def band_covariances(
    samples: FloatArray, band: Band, settings: OmaSettings, references: References = ALL
) -> LagCovariances:
    """Lag covariances of a window in a band. samples: (n, n_channels) at the full rate."""
    return lag_covariances(
        decimated(samples, band.decimation),
        n_lags=2 * band.block_rows,
        block_length=block_length(len(samples), band, settings),
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
    start: SignalSubspace | None = None,
) -> BandIdentification:
    """Modes of one band from its lag covariances.

    start   the subspace of an earlier, overlapping window: saves work, changes nothing
    """
    subspace = signal_subspace(
        covariances.mean,
        block_rows=band.block_rows,
        highest_order=max(band.orders),
        start=start,
    )
    dt = 1 / band.sampling_rate
    systems = list(system_modes(subspace, orders=band.orders, sampling_interval=dt))
    cloud, moved = _sharp_cloud(systems, subspace, covariances, band, settings)
    found = clusters(cloud, n_orders=len(systems), minimum_presence=settings.minimum_presence)
    modes = _represented(found, cloud, moved, covariances.scales)
    return BandIdentification(tuple(modes), cloud, subspace)


def _sharp_cloud(
    systems: Sequence[SystemModes],
    subspace: SignalSubspace,
    covariances: LagCovariances,
    band: Band,
    settings: OmaSettings,
) -> tuple[PoleCloud, list[OrderDeviations]]:
    """Plausible poles that come back over the orders and whose frequency is known well enough;
    and how the time blocks move each order's system."""
    cloud = pole_cloud(systems, band, settings)
    cloud = cloud.only(
        recurring(cloud, n_orders=len(systems), minimum_presence=settings.minimum_presence)
    )
    if not len(cloud):
        return cloud, []
    projected = projected_deviations(subspace, covariances.deviations)
    frequency = np.empty((len(cloud), projected.n_blocks))
    damping = np.empty_like(frequency)
    by_order = []
    for system in systems:
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
    channel_scales: FloatArray,
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
                system.shapes[:, chosen[place]] * channel_scales,
                shapes[place] * channel_scales[:, None],
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


AT_BOUND = 2.0  # a frequency std of less, over the attainable bound, could hardly be smaller [-]
MUCH_SHARPER = 2.0  # a faster band's frequency std must be this many times smaller to be taken


def merged(by_band: Sequence[Sequence[Mode]]) -> tuple[Mode, ...]:
    """The modes of all bands (slowest band first), each once, lowest frequency first.

    Two estimates are one mode when their frequencies agree within three joint std or half a
    percent and their MAC is 0.8 or more. The slower band's stays, since the faster ones are
    biased where their lags are short for the mode, unless the faster one's is much sharper. What
    the bands differ by, beyond their std, is added to the covariance of the one that stays.
    """
    ranked = sorted(
        (
            (mode.frequency_std * MUCH_SHARPER**place / mode.frequency, place, mode)
            for place, modes in enumerate(by_band)
            for mode in modes
        ),
        key=lambda entry: entry[:2],
    )
    kept: list[list[Mode]] = []  # the one that stays, then the others of the same mode
    for _, _, mode in ranked:
        group = next((group for group in kept if _same(mode, group[0])), None)
        if group is None:
            kept.append([mode])
        else:
            group.append(mode)
    joined = [_with_spread_over_bands(first, others) for first, *others in kept]
    return tuple(sorted(joined, key=lambda m: m.frequency))


def _with_spread_over_bands(mode: Mode, others: Sequence[Mode]) -> Mode:
    """The mode with one more column of its factor for what the other bands' estimates say."""
    if not others:
        return mode
    weights = np.array([m.frequency_std**-2 for m in (mode, *others)])
    column = np.zeros((len(mode.covariance_factor), 2))
    for row, own in enumerate((mode.frequency, mode.damping_ratio)):
        theirs = [(m.frequency, m.damping_ratio)[row] for m in others]
        deviations = _differences_by_block(mode, others, row)
        column[row, row] = unexplained_spread(
            np.array([0.0, *theirs]) - np.array([0.0] + [own] * len(others)),
            np.vstack([np.zeros_like(deviations[:1]), deviations]),
            weights=weights,
        )
    factor = np.hstack([mode.covariance_factor, column])
    frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
    return replace(
        mode,
        covariance_factor=factor,
        frequency_std=float(frequency_std),
        damping_ratio_std=float(damping_std),
    )


def _differences_by_block(mode: Mode, others: Sequence[Mode], row: int) -> FloatArray:
    """Deviations of f (row 0) or ζ (row 1) of other bands' estimates less the mode's own,
    (n_others, n_blocks).

    The bands' blocks cover the same times but for the filters' delay; a slower band may lack the
    last blocks.
    """
    everything = (mode, *others)
    padded = np.zeros((len(everything), max(m.n_block_columns for m in everything)))
    for place, each in enumerate(everything):
        padded[place, : each.n_block_columns] = each.covariance_factor[row, : each.n_block_columns]
    return np.asarray(padded[1:] - padded[0])


def _same(mode: Mode, other: Mode) -> bool:
    joint_std = float(np.hypot(mode.frequency_std, other.frequency_std))
    if abs(mode.frequency - other.frequency) > max(3 * joint_std, 0.005 * other.frequency):
        return False
    mac = modal_assurance_criterion(mode.shape[None], other.shape[None])[0, 0]
    return bool(mac >= 0.8)


def renamed(mode: Mode, name: str) -> Mode:
    """The same mode under its track's name."""
    return replace(mode, name=name)
