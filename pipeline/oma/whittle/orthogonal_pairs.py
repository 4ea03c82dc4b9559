"""Two close modes along perpendicular axes, under forces that are not correlated.

Of two modes less than a few lines 1/T apart the lines know the plane and the power in it, and
hardly which two axes of it are the modes: a turn of the axes, a correlation of the forces and
unlike frequencies explain nearly the same lines. Left free, they spoil each other: the frequencies
of both fall near their mean. A tower has one bending mode fore-aft and one side-side, which are
perpendicular; unless wind and sea come from between the two, their forces are not correlated, and
then the modes are the axes along which the plane shakes most and least. This is taken unless the
evidence for free axes and correlated forces is strong.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.oma.whittle.fit import WhittleFit, every_parameter, fitted
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.pair_axes import modal_powers, principal_axes
from pipeline.oma.whittle.spectral_model import CloseModes, force_parameters, n_inner
from sensors.arrays import ComplexArray, FloatArray

EVIDENCE_OF_FREE_AXES = 3.0  # for free axes, ln of the Bayes factor [nats]
PARAMETERS_SAVED = 3  # two of the forces' correlation, one of the angle between the axes


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
