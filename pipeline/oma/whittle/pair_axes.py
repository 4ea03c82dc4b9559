"""Two modes of a fit that a window hardly resolves: their plane is known, the axes in it hardly.

Of two modes less than a few lines 1/T apart the lines know the plane and the power in it, and
hardly which two axes of it are the modes: a turn of the axes, a correlation of the forces and
unlike frequencies explain nearly the same lines. Left free, they spoil each other: the frequencies
of both fall near their mean. A tower has one bending mode fore-aft and one side-side, which are
perpendicular; unless wind and sea come from between the two, their forces are not correlated, and
then the modes are the axes along which the plane shakes most and least. This is taken unless the
evidence for free axes and correlated forces is strong (`along_perpendicular_axes`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import mac, normalised_with_deviations
from pipeline.oma.whittle.fit import WhittleFit, compact, every_parameter, fitted, mode_of_rows
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import CloseModes, force_parameters, n_inner
from sensors.arrays import ComplexArray, FloatArray, IntArray

HALF_A_LINE = 0.5  # added to the std of a pair's frequencies [lines]
MOST_OF_PARTNER = 0.15  # power of the weaker axis over the stronger's, of which a pole takes no
# notice
SAME_AXIS = 0.9  # MAC of a pole's shape and an axis
EVIDENCE_OF_FREE_AXES = 3.0  # for free axes, ln of the Bayes factor [nats]
PARAMETERS_SAVED = 3  # two of the forces' correlation, one of the angle between the axes


@dataclass(frozen=True, slots=True, eq=False)
class PairAxes:
    """Two entries of a pair, and how much of the power is the weaker one's."""

    stronger: Mode
    """Of the axis with most power."""
    weaker: Mode
    """Of the axis with least."""
    share: float
    """Power along the weaker axis over that along the stronger one [-]."""


def with_leading_pole(
    modes: Sequence[Mode], poles: Sequence[Mode], share: float, duration: float
) -> list[Mode]:
    """The modes; the stronger one of a pair with the frequency and the damping of its pole.

    Parameters
    ----------
    modes : sequence of Mode
        Of the lines.
    poles : sequence of Mode
        Of the same group.
    share : float
        Of the weaker axis in the power of the stronger one [-].
    duration : float
        T of the window [s].

    Notes
    -----
    Where nearly all power is along one axis, the poles see that mode alone, and without a model of
    the background: of 61 windows of a parked tower (seeds 8500 to 8511) the pole's frequency was
    wrong by .39 lines rms, that of the lines by .44.
    """
    if share > MOST_OF_PARTNER:
        return list(modes)
    return [_with_pole(mode, poles, duration) if mode.pair_id else mode for mode in modes]


def _with_pole(mode: Mode, poles: Sequence[Mode], duration: float) -> Mode:
    """A quarter of a line is added to the pole's std for the partner's share in it."""
    alike = [
        pole
        for pole in poles
        if mac(pole.shape, mode.shape) > SAME_AXIS
        and abs(pole.frequency - mode.frequency)
        < 2 * float(np.hypot(pole.frequency_std, mode.frequency_std))
    ]
    if not alike:
        return mode
    pole = min(alike, key=lambda each: each.frequency_std)
    n_pole, n_own = pole.covariance_factor.shape[1], mode.covariance_factor.shape[1]
    factor = np.zeros((len(mode.covariance_factor), n_pole + n_own + 1))
    factor[:2, :n_pole] = pole.covariance_factor[:2]
    factor[2:, n_pole:-1] = mode.covariance_factor[2:]
    factor[0, -1] = 0.5 * HALF_A_LINE / duration
    at_pole = replace(mode, frequency=pole.frequency, damping_ratio=pole.damping_ratio)
    return at_pole.with_factor(compact(factor))


def along_axes(
    fit: WhittleFit, band: NarrowBand, members: Sequence[int], root: FloatArray
) -> PairAxes:
    """Two entries of a pair: the axes along which the two shake most and least.

    Parameters
    ----------
    fit : WhittleFit
        Of the band.
    band : NarrowBand
        Lines of the group.
    members : sequence of int
        Places of the two in the fit.
    root : ndarray, shape (n_parameters, n_columns)
        Of the covariance of all parameters.

    Returns
    -------
    PairAxes
        Each entry with the mean frequency and damping of the power along its axis.

    Notes
    -----
    Of a mode's shape φ_j the share w_j of an axis moves it: Δa = Σ c_j Δφ_j, a = Σ c_j φ_j, of
    which the part in the plane is replaced by a turn, whose std is √(power share of the other).
    """
    chosen = np.array(members)
    centre = float(fit.modes.positions[chosen].mean()) / band.duration
    scales = band.accelerations(centre)[:, None]
    phi = scales * fit.modes.shapes[:, chosen]
    power = modal_powers(fit, chosen)
    share, axes = principal_axes(fit.modes.shapes[:, chosen], power, scales)
    into = np.linalg.pinv(phi)
    weights = (into @ axes).T ** 2 * np.diag(power)  # of the modes in what shakes along each axis
    weights /= weights.sum(axis=1, keepdims=True)
    moved = np.stack([scales * _shape_rows(fit, place, root) for place in members])
    moved -= phi @ (into @ moved)
    turn = float(np.sqrt(share))
    shapes = [
        np.column_stack(
            [np.tensordot((into @ axes)[:, k], moved, axes=1), turn * axes[:, 1 - k], axes[:, k]]
        )
        for k in (0, 1)
    ]
    pair_id = f"{(weights @ fit.modes.positions[chosen]).mean() / band.duration:.4f} Hz"
    first, second = (
        _entry(fit, band.duration, chosen, weights[k], shapes[k], root, pair_id) for k in (0, 1)
    )
    return PairAxes(first, second, share)


def principal_axes(
    shapes: FloatArray, power: FloatArray, scales: FloatArray
) -> tuple[float, FloatArray]:
    """Power of the weaker axis over the stronger one's, and both axes in the samples' units.

    Parameters
    ----------
    shapes : ndarray, shape (n_channels, 2)
        Of scaled channels [-].
    power : ndarray, shape (2, 2)
        Covariance of the two modal coordinates.
    scales : ndarray, shape (n_channels, 1)
        From scaled channels to the samples' units.

    Returns
    -------
    share : float
        [-].
    axes : ndarray, shape (n_channels, 2)
        Of scaled channels or of those in the samples' units, whichever makes their powers differ
        more.
    """
    both = (_principal(shapes, power, scales), _principal(scales * shapes, power, 1.0))
    return min(both, key=lambda found: found[0])


def _principal(
    shapes: FloatArray, power: FloatArray, scales: FloatArray | float
) -> tuple[float, FloatArray]:
    """Power of the weaker axis over the stronger one's, and both, (n_channels, 2), scaled.

    shapes, power   of two modes, (n_channels, 2) and (2, 2)
    """
    values, vectors = np.linalg.eigh(shapes @ power @ shapes.T)
    axes = vectors[:, [-1, -2]] * scales
    share = float(max(values[-2], 0.0) / values[-1])
    return share, axes / np.linalg.norm(axes, axis=0)


def modal_powers(fit: WhittleFit, chosen: IntArray) -> FloatArray:
    """Covariance of the modal coordinates, −S_jl / (λ_j + λ_l*) as in `modal_spectra`, (2, 2).

    Of two modes a few half bandwidths apart it is far less than their forces' correlation.
    """
    forces = (fit.modes.forces @ fit.modes.forces.conj().T)[np.ix_(chosen, chosen)]
    lam = -fit.modes.half_widths[chosen] + 1j * fit.modes.positions[chosen]
    return np.asarray((forces / -(lam[:, None] + lam[None, :].conj())).real)


def _shape_rows(fit: WhittleFit, place: int, root: FloatArray) -> FloatArray:
    """Deviations of a mode's shape of scaled channels, (n_channels, n_columns)."""
    n_channels, m = fit.modes.shapes.shape
    first = len(root) - (m - place) * (n_channels - 1)
    rows = np.zeros((n_channels, root.shape[1]))
    free = np.arange(n_channels) != fit.modes.units[place]
    rows[free] = root[first : first + n_channels - 1]
    return rows


def _entry(
    fit: WhittleFit,
    duration: float,
    chosen: IntArray,
    weights: FloatArray,
    shape_columns: FloatArray,
    root: FloatArray,
    pair_id: str,
) -> Mode:
    """weights: of the two modes;  shape_columns: deviations, the turn, the axis itself."""
    m = fit.modes.n_modes
    positions, widths = fit.modes.positions[chosen], fit.modes.half_widths[chosen]
    damping = widths / np.hypot(positions, widths)
    frequencies = np.hypot(positions, widths) / duration
    frequency = float(weights @ frequencies)
    shape, deviations = normalised_with_deviations(
        shape_columns[:, -1].astype(complex), shape_columns[:, :-1].astype(complex)
    )
    spread = float(
        np.hypot(
            (frequencies[1] - frequencies[0]) * np.sqrt(weights[0] * weights[1]),
            HALF_A_LINE / duration,
        )
    )
    n_columns = root.shape[1]
    rows = np.zeros((2 + len(shape), n_columns + 2))
    rows[0, :n_columns] = weights @ root[chosen] / duration
    relative = root[m + chosen] - root[chosen] / positions[:, None]
    rows[1, :n_columns] = (weights * damping) @ relative
    rows[2:, : n_columns + 1] = deviations
    rows[0, -1] = spread
    return mode_of_rows(frequency, float(weights @ damping), shape, rows, pair_id)


def along_perpendicular_axes(
    fit: WhittleFit, band: NarrowBand, members: Sequence[int]
) -> WhittleFit | None:
    """The fit with two of its modes along perpendicular axes, these two first; None where the
    evidence for free axes is strong.

    Parameters
    ----------
    fit : WhittleFit
        With free axes.
    band : NarrowBand
        Of the fit.
    members : sequence of int
        Places of the two modes in the fit.
    """
    start = _start(fit, band, members)
    if start is None:
        return None
    m, n_channels = start.shapes.shape[1], len(start.shapes)
    everything = every_parameter(m, n_channels, one_colour=False)
    shapes = np.arange(n_inner(m), n_inner(m) + 2 * (n_channels - 1))
    moving = np.delete(everything, [*_correlation(m), *shapes], axis=1)
    found = fitted(start, band, np.column_stack([moving, _turn(start, band)]))
    penalty = 0.5 * PARAMETERS_SAVED * float(np.log(2 * band.n_lines))
    if found.cost > fit.cost + penalty + EVIDENCE_OF_FREE_AXES:
        return None
    return replace(found, directions=np.delete(everything, _correlation(m), axis=1))


def _turn(start: CloseModes, band: NarrowBand) -> FloatArray:
    """A turn of the first two modes' axes in their plane, as a direction of all parameters.

    e_1 + ε e_2 and e_2 − ε e_1 of the unit vectors, in components that keep the largest at 1.
    """
    start = start.normalised()
    m, n_channels = start.n_modes, len(start.shapes)
    first = n_inner(m)
    sizes = np.linalg.norm(start.shapes[:, :2] * band.scales[:, None], axis=0)
    turn = np.zeros(first + m * (n_channels - 1))
    for own, other, sign in ((0, 1, 1.0), (1, 0, -1.0)):
        unit = start.units[own]
        shape = sign * sizes[own] / sizes[other] * start.shapes[:, other]
        moved = np.delete(shape - shape[unit] * start.shapes[:, own], unit)
        turn[first + own * (n_channels - 1) : first + (own + 1) * (n_channels - 1)] = moved
    return turn


def _correlation(m: int) -> list[int]:
    """Places of the correlation of the first two modes' forces among the parameters."""
    return [
        2 * m + place for place, (i, j, _) in enumerate(force_parameters(m)) if (i, j) == (1, 0)
    ]


def _start(fit: WhittleFit, band: NarrowBand, members: Sequence[int]) -> CloseModes | None:
    """The modes with the two first and along their principal axes."""
    modes = fit.modes
    chosen = np.array(members)
    centre = float(modes.positions[chosen].mean()) / band.duration
    scales = band.accelerations(centre)[:, None]
    phi, power = modes.shapes[:, chosen], modal_powers(fit, chosen)
    _, axes = principal_axes(phi, power, scales)
    axes = axes / scales
    axes = axes / axes[np.argmax(np.abs(axes), axis=0), [0, 1]]
    into = np.linalg.pinv(phi) @ axes
    if np.linalg.cond(into) > 1e6:
        return None
    weights = into.T**2 * np.diag(power)
    weights /= weights.sum(axis=1, keepdims=True)
    back = np.linalg.inv(into)
    along = np.maximum(np.diag(back @ power @ back.T), 1e-12 * power.max())
    widths = np.exp(weights @ np.log(modes.half_widths[chosen]))
    others = np.setdiff1d(np.arange(modes.n_modes), chosen)
    return CloseModes(
        np.append(weights @ modes.positions[chosen], modes.positions[others]),
        np.append(widths, modes.half_widths[others]),
        np.column_stack([axes, modes.shapes[:, others]]),
        _forces(modes, 2 * along * widths, others.tolist()),
        np.append(weights @ modes.colours[chosen], modes.colours[others]),
        modes.noise,
    )


def _forces(modes: CloseModes, of_axes: FloatArray, others: Sequence[int]) -> ComplexArray:
    """C of two uncorrelated forces, then of the others as they were, uncorrelated with the two."""
    spectra = modes.forces @ modes.forces.conj().T
    forces = np.zeros((2 + len(others), 2 + len(others)), dtype=complex)
    forces[[0, 1], [0, 1]] = np.sqrt(of_axes)
    if others:
        forces[2:, 2:] = np.linalg.cholesky(spectra[np.ix_(others, others)])
    return forces
