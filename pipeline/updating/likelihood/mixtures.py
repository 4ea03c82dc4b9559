"""What an identified mode has of a neighbour of nearly its shape.

Two modes whose resonances overlap and whose shapes the sensors hardly tell apart come out of an
identification mixed: of mode a, with a share w of its neighbour b,

    ln f = ln f_a + w ρ ln(f_b / f_a),   φ = φ_a + w (φ_b − φ_b,u φ_a),   ρ = φ_aᵀφ_b / φ_aᵀφ_a

(u: the component held at 1; b's shape with its largest component 1). One share moves frequency and
shape, so that the shape tells most of it. The same share stays over all windows: it follows from
loads and damping. With w of mean 0 and standard deviation s beside errors η of covariance D,

    ŵ = kᵀη,   k = D⁻¹e / (s⁻² + eᵀD⁻¹e),   η' = η − e ŵ,
    ηᵀ (D + s² e eᵀ)⁻¹ η = η'ᵀ D⁻¹ η' + ŵ² / s²

so that errors η' and a row ŵ more, of variance s², stand for a covariance that is not diagonal.
e, the column of w, is what a share of 1 makes of η = model − identified. s = c ζ² / ln²(f_b / f_a)
with the identified ζ, which a mixture makes too large.
Source: the matrix inversion lemma; Golub and Van Loan, "Matrix Computations" (2013), section 2.1.4.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.likelihood.mode_errors import ModeErrors
from sensors.arrays import FloatArray, IndexArray

MIXED_REACH = 0.08  # between a mode and a neighbour that it may be mixed with, relative [-]
LEAST_LIKENESS = 0.5  # least MAC of such neighbours [-]
HIDDEN_MIXING = 1.2  # c where the neighbour was not identified beside: of 80 identified towers
# (seeds 17000 to 17223) .3 to 1.8, whatever distance and damping [-]
SEEN_MIXING = 0.4  # c where it was: .3 to .9, more where a mode is damped unlike the others [-]
UNKNOWN_DAMPING = 0.007  # ζ where nothing tells it [-]
WIDEST_SHARE = 0.5  # standard deviation of w: beyond, the mode would be the neighbour [-]


@dataclass(frozen=True, slots=True, eq=False)
class _Neighbours:
    """Modes of the model that identified modes may be mixed with, one row each."""

    observations: IndexArray
    """(q,) number of the identified mode among the compared ones"""
    modes: IndexArray
    """(q,) a, its partner in the model"""
    others: IndexArray
    """(q,) b"""
    distances: FloatArray
    """ln(f_b / f_a), (q,)"""
    stds: FloatArray
    """s, (q,) [-]"""
    units: IndexArray
    """(q,) channel whose component is 1"""
    rows: IndexArray
    """(q,) number of the row: negative, of the neighbour"""


@dataclass(frozen=True, slots=True, eq=False)
class NeighbourShares:
    """What shares of neighbours make of the errors, before any is taken out."""

    alone: ModeErrors
    """The errors as if no mode had a share of another."""
    neighbours: _Neighbours
    columns: FloatArray
    """e of each share, (p, q)"""
    slopes: FloatArray
    """∂e/∂u, (p, q, n_dim)"""

    def taken_out(self, sigma: float) -> tuple[ModeErrors, float]:
        """The errors less the likeliest shares and a row more for each; and
        ln |D + E S² Eᵀ| − ln |D| with D = S + F + σ² R."""
        found, near, columns = self.alone, self.neighbours, self.columns
        n = len(near.stds)
        precise = columns / (found.variances + found.floors + sigma**2 * found.reference)[:, None]
        information = np.diag(near.stds**-2) + columns.T @ precise
        gains = np.linalg.solve(information, precise.T)  # k, (q, p)
        shares = gains @ found.errors
        jacobian = found.jacobian - np.einsum("pqu,q->pu", self.slopes, shares)
        moved = gains @ jacobian
        wider = np.linalg.slogdet(information)[1] + 2 * np.log(near.stds).sum()
        cleared = replace(
            found,
            errors=np.append(found.errors - columns @ shares, shares),
            variances=np.append(found.variances, np.zeros(n)),
            floors=np.append(found.floors, near.stds**2),
            reference=np.append(found.reference, np.zeros(n)),
            jacobian=np.concatenate([jacobian - columns @ moved, moved]),
            groups=np.append(found.groups, near.observations),
            is_frequency=np.append(found.is_frequency, np.zeros(n, dtype=bool)),
            tracks=np.append(found.tracks, found.tracks[near.observations]),
            rows=np.append(found.rows, near.rows),
            units=np.append(found.units, near.units),
            shares=self,
        )
        return cleared, float(wider)


def with_mixtures(found: ModeErrors) -> ModeErrors:
    """The errors less the likeliest shares of neighbours, and a row more for each share.

    Parameters
    ----------
    found : ModeErrors
        At one point of the model.

    Returns
    -------
    ModeErrors
        The rows of shares come last, numbered by the neighbour, −1 − its place, with group and
        track of their mode: who leaves a mode out leaves its shares out.
    """
    near = _neighbours(found)
    if not len(near.stds):
        return found
    return NeighbourShares(found, near, *_columns(found, near)).taken_out(0.0)[0]


def _neighbours(found: ModeErrors) -> _Neighbours:
    """The modes of the model that are alike and near, but for those that no window resolves, which
    the comparison has accounted for."""
    modes = found.linearisation
    single = np.array([len(each.model_modes) == 1 and each.gap == 0.0 for each in found.used])
    partners = np.array([each.model_modes[0] for each in found.used])
    distances = np.log(modes.frequencies / modes.frequencies[partners, None])
    products = (modes.shapes[partners] @ modes.shapes.T) ** 2
    norms = (modes.shapes**2).sum(axis=1)
    alike = products > LEAST_LIKENESS * np.outer(norms[partners], norms)
    near = (np.abs(distances) < MIXED_REACH) & alike & single[:, None]
    near[np.arange(len(partners)), partners] = False
    observations, others = np.nonzero(near)
    apart = distances[observations, others]
    identified = np.zeros(len(modes.frequencies), dtype=bool)
    identified[partners] = True
    mixing = np.where(identified[others], SEEN_MIXING, HIDDEN_MIXING)
    damping = np.nan_to_num(found.damping_ratios[observations], nan=UNKNOWN_DAMPING)
    units = np.argmax(np.abs(modes.readings[partners]), axis=1)
    units[found.groups[~found.is_frequency]] = found.units[~found.is_frequency]
    return _Neighbours(
        observations=observations,
        modes=partners[observations],
        others=others,
        distances=apart,
        stds=np.minimum(mixing * (damping / apart) ** 2, WIDEST_SHARE),
        units=units[observations],
        rows=-1 - others,
    )


def _columns(found: ModeErrors, near: _Neighbours) -> tuple[FloatArray, FloatArray]:
    """e of each share, (p, q), and its derivatives by u, (p, q, n_dim)."""
    modes = found.linearisation
    own, own_slopes = _normalised(found, near.modes, near.units)
    largest = np.argmax(np.abs(modes.readings[near.others]), axis=1)
    other, other_slopes = _normalised(found, near.others, largest)
    each = np.arange(len(near.stds))
    at_unit, its_slope = other[each, near.units], other_slopes[each, near.units]
    shapes = other - at_unit[:, None] * own  # (q, n_channels)
    slopes = other_slopes - its_slope[:, None] * own[..., None]
    slopes -= at_unit[:, None, None] * own_slopes
    squares = (own**2).sum(axis=1)
    along = (own * other).sum(axis=1) / squares
    turned = np.einsum("qcu,qc->qu", own_slopes, other - 2 * along[:, None] * own)
    turned += np.einsum("qcu,qc->qu", other_slopes, own)
    by_frequency = modes.log_frequency_slopes[near.others] - modes.log_frequency_slopes[near.modes]
    by_frequency = along[:, None] * by_frequency + turned * (near.distances / squares)[:, None]
    columns = np.zeros((len(found.errors), len(each)))
    derivatives = np.zeros((*columns.shape, found.jacobian.shape[1]))
    columns[near.observations, each] = -along * near.distances
    derivatives[near.observations, each] = -by_frequency
    row, share = np.nonzero(
        (found.groups[:, None] == near.observations) & ~found.is_frequency[:, None]
    )
    channel = found.rows[row] - 1
    columns[row, share] = -shapes[share, channel]
    derivatives[row, share] = -slopes[share, channel]
    return columns, derivatives


def _normalised(
    found: ModeErrors, modes: IndexArray, units: IndexArray
) -> tuple[FloatArray, FloatArray]:
    """Shapes of modes of the model with a component of each 1, (q, n_channels), and their
    derivatives, (q, n_channels, n_dim)."""
    read = found.linearisation.readings[modes]
    turned = found.linearisation.reading_slopes[modes]
    each = np.arange(len(modes))
    at_unit = read[each, units][:, None]
    shapes = read / at_unit
    slopes = (turned - shapes[..., None] * turned[each, units][:, None]) / at_unit[..., None]
    return np.real(shapes), np.real(slopes)
