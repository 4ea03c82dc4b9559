"""Two modes of a fit that a window hardly resolves: their plane is known, the axes in it hardly."""

from collections.abc import Sequence

import numpy as np

from pipeline.messages import Mode
from pipeline.oma.ssi.mode_shapes import normalised_with_deviations
from pipeline.oma.whittle.fit import WhittleFit
from pipeline.oma.whittle.narrow_band import NarrowBand
from sensors.arrays import FloatArray, IntArray

HALF_A_LINE = 0.5  # added to the std of a pair's frequencies [lines]


def along_axes(
    fit: WhittleFit, band: NarrowBand, members: Sequence[int], root: FloatArray
) -> tuple[Mode, Mode]:
    """Two entries of a pair: the axes along which the two shake most and least, each with the
    mean frequency and damping of the power along it.

    members   places of the two in the fit
    root      of the covariance of all parameters, (n_parameters, n_columns)

    Of a mode's shape φ_j the share w_j of an axis moves it: Δa = Σ c_j Δφ_j, a = Σ c_j φ_j, of
    which the part in the plane is replaced by a turn, whose std is √(power share of the other).
    """
    chosen = np.array(members)
    centre = float(fit.modes.positions[chosen].mean()) / band.duration
    scales = band.accelerations(centre)[:, None]
    phi = scales * fit.modes.shapes[:, chosen]
    power = _powers(fit, chosen)
    share, axes = min(
        (_principal(fit.modes.shapes[:, chosen], power, scales), _principal(phi, power, 1.0)),
        key=lambda found: found[0],
    )
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
    return first, second


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


def _powers(fit: WhittleFit, chosen: IntArray) -> FloatArray:
    """Covariance of the modal coordinates, (2, 2)."""
    forces = (fit.modes.forces @ fit.modes.forces.conj().T)[np.ix_(chosen, chosen)]
    decay = fit.modes.half_widths[chosen]
    return np.asarray((forces / (decay[:, None] + decay[None, :])).real)


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
    factor = compact(rows)
    frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
    return Mode(
        name="",
        frequency=frequency,
        frequency_std=float(frequency_std),
        damping_ratio=float(weights @ damping),
        damping_ratio_std=float(damping_std),
        shape=shape,
        covariance_factor=factor,
        n_block_columns=0,
        pair_id=pair_id,
    )


def compact(rows: FloatArray) -> FloatArray:
    """A factor of the same covariance with no more columns than rows; zero rows stay zero."""
    left, values, _ = np.linalg.svd(rows, full_matrices=False)
    factor = left * values
    factor[~rows.any(axis=1)] = 0.0
    return np.asarray(factor)
