"""How errors of size √Σ_D and a discrepancy of size σ are distributed: normal, or heavy-tailed.

Both work on whitened errors, of unit variance at σ = 0, and on a whole grid of σ at once.
"""

from functools import lru_cache
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular
from scipy.special import gammaincc, gammainccinv

from sensors.arrays import FloatArray

TAIL_NODES = 5  # of the distribution of λ
ROWS_AT_ONCE = 256  # rows at once: (rows, σ, λ) must stay within the processor's cache


class ErrorModel(Protocol):
    """Distribution of η for every σ of a grid."""

    def whitened(self, errors: FloatArray) -> FloatArray:
        """η̃, (n, p), of unit variance at σ = 0."""
        ...

    def log_density(self, squares: FloatArray) -> FloatArray:
        """(n, n_sigma) of (n, p) squares of η̃, up to one constant."""
        ...

    def weights(self, squares: FloatArray) -> FloatArray:
        """(p,) expected precision of each η̃ at the likeliest σ, given their squares, (p,)."""
        ...


class GaussianErrors:
    """η ~ N(0, σ² R + Σ_D)

    The two are made diagonal together, once: with Σ_D = L Lᵀ and L⁻¹ R L⁻ᵀ = Q Λ Qᵀ,
        ηᵀ Σ⁻¹ η = Σ_j η̃_j² / (1 + σ² λ_j),   η̃ = Qᵀ L⁻¹ η
    """

    def __init__(self, covariance: FloatArray, reference: FloatArray, sigma: FloatArray) -> None:
        """covariance: Σ_D, (p, p); reference: diagonal of R, (p,); sigma: the grid, (n_sigma,)."""
        lower = cholesky(covariance, lower=True)
        root = solve_triangular(lower, np.diag(np.sqrt(reference)), lower=True)
        ratios, rotation = np.linalg.eigh(root @ root.T)
        self._whitening = solve_triangular(lower, rotation, lower=True, trans="T")
        growth = sigma[:, None] ** 2 * np.maximum(ratios, 0.0)
        self._precisions = 1 / (1 + growth)  # (n_sigma, p)
        self._log_determinants = np.log1p(growth).sum(axis=1)

    def whitened(self, errors: FloatArray) -> FloatArray:
        """η̃ = Wᵀ η"""
        return errors @ self._whitening

    def log_density(self, squares: FloatArray) -> FloatArray:
        """−½ (Σ_j η̃_j² / (1 + σ² λ_j) + Σ_j log(1 + σ² λ_j))"""
        return -0.5 * (squares @ self._precisions.T + self._log_determinants)

    def weights(self, squares: FloatArray) -> FloatArray:
        """1 / (1 + σ² λ_j)"""
        return self._precisions[int(np.argmax(self.log_density(squares[None])[0]))]


class StudentErrors:
    """η_g ~ ∫ N(0, S_g + λ (σ² R_g + F_g)) IG(λ; ν/2, ν/2) dλ for each group g of components.

    What the identification knows of its scatter, S, stays normal. What it does not know, model
    discrepancy and systematic floor, is a mode's own λ times as large in variance as in most
    modes: an inverse gamma λ makes it Student-t with ν degrees of freedom. One mode with an error
    of ten floors then costs a few nats and pulls no stiffness; under a normal error it costs fifty
    and is bought off by σ and the stiffness together. A mode's frequency and its shape have a λ
    each: a shape that fits must not vouch for a frequency.

    λ is integrated over equal steps of its logarithm, which reach far into the tail (`tail_nodes`).
    Source: scale mixtures of normals, West (1987), Biometrika 74.
    """

    def __init__(
        self,
        *,
        variances: FloatArray,
        floors: FloatArray,
        reference: FloatArray,
        sigma: FloatArray,
        groups: NDArray[np.intp],
        degrees: float,
    ) -> None:
        """variances, floors, reference: diagonals of S, F and R, (p,). sigma: (n_sigma,).
        groups: (p,) number of each component's group, in rising order. degrees: ν."""
        scales, shares = tail_nodes(degrees)
        self._stds = np.sqrt(variances + floors)
        systematic = sigma[:, None] ** 2 * reference + floors  # (n_sigma, p)
        ratios = (variances + scales[:, None, None] * systematic) / self._stds**2
        starts = np.flatnonzero(np.diff(groups, prepend=-1))
        self._spans = [slice(*each) for each in pairwise([*starts.tolist(), len(groups)])]
        self._groups = groups
        self._precisions = 1 / ratios  # (λ, σ, p)
        logs = np.add.reduceat(np.log(ratios), starts, axis=2)  # (λ, σ, groups)
        self._offsets = np.log(shares)[:, None, None] - 0.5 * logs  # (λ, σ, groups)
        self._widest = self._precisions[-1].T / 2, self._offsets[-1].sum(axis=1)  # of largest λ
        others = (self._precisions[:-1] - self._precisions[-1]) / 2
        self._others = np.moveaxis(others, 2, 0).reshape(len(groups), -1)  # (p, λ·σ)
        self._other_offsets = (self._offsets[:-1] - self._offsets[-1]).reshape(-1, len(starts)).T

    def whitened(self, errors: FloatArray) -> FloatArray:
        """η / √(S + F)"""
        return errors / self._stds

    def log_density(self, squares: FloatArray) -> FloatArray:
        """Σ_g log Σ_λ p(λ) N(η_g; 0, S + λ (σ² R + F))"""
        starts = range(0, max(len(squares), 1), ROWS_AT_ONCE)
        return np.concatenate(
            [self._rows(squares[start : start + ROWS_AT_ONCE]) for start in starts]
        )

    def _rows(self, squares: FloatArray) -> FloatArray:
        """The sum over λ as the largest λ's term times 1 + the others' ratios to it: an error, as
        large as it may be, only makes the others smaller, so that no exponent can overflow."""
        precisions, offsets = self._widest
        total = offsets - squares @ precisions
        with np.errstate(invalid="ignore", under="ignore"):  # NaN where θ is not admissible
            for span, offset in zip(self._spans, self._other_offsets, strict=True):
                others = np.exp(offset - squares[:, span] @ self._others[span])
                total += np.log1p(others.reshape(len(squares), -1, total.shape[1]).sum(axis=1))
        return np.asarray(total)

    def weights(self, squares: FloatArray) -> FloatArray:
        """E[1 / (1 + …) | η] over λ at the likeliest σ: the weights of iterated least squares."""
        best = int(np.argmax(self.log_density(squares[None])[0]))
        precisions = self._precisions[:, best]  # (λ, p)
        starts = [span.start for span in self._spans]
        exponents = np.add.reduceat(squares * precisions, starts, axis=1)
        logs = self._offsets[:, best] - 0.5 * exponents  # (λ, groups)
        chances = np.exp(logs - logs.max(axis=0))
        chances /= chances.sum(axis=0)
        return np.asarray((chances[:, self._groups] * precisions).sum(axis=0))


@lru_cache(maxsize=64)  # the same for every window of a turbine
def tail_nodes(degrees: float, n_nodes: int = TAIL_NODES) -> tuple[FloatArray, FloatArray]:
    """Nodes λ and their probabilities for an inverse gamma of shape and scale ν/2.

    Parameters
    ----------
    degrees : float
        ν [-].
    n_nodes : int, optional
        How many nodes.

    Returns
    -------
    nodes, masses : ndarray, shape (n_nodes,)
        λ and their probabilities [-].

    Notes
    -----
    Equal steps of ln λ between the quantiles .05 and .9999, each with the probability of its step:
    the far ones, rare as they are, are what makes the tail. With Q the regularised upper
    incomplete gamma function, P(λ < x) = Q(ν/2, ν/2x); `scipy.stats`, which has it by name, takes
    half a second and 45 MB to load.
    """
    half = degrees / 2
    low, high = np.log(1.0 / gammainccinv(half, [0.05, 0.9999]) * half)
    edges = np.linspace(low, high, n_nodes + 1)
    inner = gammaincc(half, 1.0 / (np.exp(edges[1:-1]) / half))
    masses = np.diff(np.concatenate([[0.0], inner, [1.0]]))
    nodes = np.exp((edges[:-1] + edges[1:]) / 2)
    for shared in (nodes, masses):
        shared.setflags(write=False)
    return nodes, masses
