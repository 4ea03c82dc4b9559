"""The structure as its mudline springs see it: every mode from a 2 × 2 equation.

In one vertical plane the springs act on two coordinates only, y = (u, ψ) of the mudline. With the
mudline clamped the rest of the structure has modes of squared frequency p_j (the poles), which
take part in mudline motion with the factors c_j. Eliminating them exactly leaves

    G(λ) y = 0,   G(λ) = S + K_s − λ M_s − λ² Σ_j c_j c_jᵀ / (p_j − λ),   λ = ω²

with the springs S the only part that depends on the foundation. Each eigenvalue of G falls
steadily between two poles, and the number of modes below λ is the number of poles below it plus
the number of negative eigenvalues of G(λ). So every mode is first enclosed by counting on a fixed
grid of λ, then found by Newton's method with the enclosure as its guard: none is missed or found
twice, and it costs a third of an eigenvalue solution in the same basis.
Source: Craig and Bampton, AIAA Journal 6 (1968) 1313; Wittrick and Williams, Quarterly Journal of
Mechanics and Applied Mathematics 24 (1971) 263, for the count.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, null_space

from sensors.arrays import FloatArray, IndexArray

# Grid in each half of an interval between two poles: distances to the nearer pole in units of the
# interval. At first geometric, because a mode that hardly moves the mudline hugs its pole; a
# mode nearer than the first distance counts as at its pole (nearer, G is lost in rounding).
_DISTANCES = np.concatenate(
    [np.geomspace(1e-10, 1e-3, 19), np.geomspace(2e-3, 0.1, 18), np.linspace(0.12, 0.5, 26)]
)
_NEWTON_STEPS = 40  # never needed so far: 3 or 4 are
_CONVERGED = 3e-4  # relative step in the distance to the pole; the error is its square [-]


@dataclass(frozen=True, slots=True, eq=False)
class SpringModes:
    """Mass-normalised modes for n foundations, lowest first."""

    squares: FloatArray
    """λ = ω², (n, n_modes) [rad²/s²]."""

    coordinates: FloatArray
    """Coordinates, (n, n_modes, m): mudline y, then the clamped modes' amplitudes."""


@dataclass(frozen=True, slots=True, eq=False)
class _Grid:
    """Places λ = p_near + offset, lowest first, at which G is tabulated."""

    near: IndexArray
    """Near, (n_grid,): index of the nearer pole."""

    offset: FloatArray
    """λ − p_near, never 0 [rad²/s²]."""

    poles_below: IndexArray
    """Poles below, (n_grid,)."""

    g: FloatArray
    """G, (3, n_grid): entries 11, 22, 12 of G without S."""


@dataclass(slots=True, eq=False)
class _Roots:
    """One root λ = p_near + offset of G for each foundation and mode, while it is being found.

    All arrays (n_roots,), foundation by foundation, but
    springs   (3, n_roots): entries 11, 22, 12 of S
    """

    springs: FloatArray
    near: IndexArray
    offset: FloatArray
    lower: FloatArray
    """Enclosure of the offset."""

    upper: FloatArray
    side: FloatArray
    """−1: the smaller eigenvalue of G is zero at the root, +1: the larger."""

    @property
    def at_pole(self) -> NDArray[np.bool_]:
        """Modes so near a pole that they do not move the mudline: they stay there."""
        return (self.lower < 0) & (self.upper > 0)

    def take(self, which: IndexArray) -> "_Roots":
        """Some of the roots, as a copy."""
        return _Roots(
            springs=self.springs[:, which],
            near=self.near[which],
            offset=self.offset[which],
            lower=self.lower[which],
            upper=self.upper[which],
            side=self.side[which],
        )


class MudlineCondensation:
    """One decoupled group of the structure, condensed onto its two mudline coordinates.

    Parameters
    ----------
    squares : ndarray, shape (m,)
        Λ: the group's stiffness in a mass-normalised basis, with springs S_ref.
    spring_rows : ndarray, shape (2, m)
        Y: the mudline coordinates in that basis.
    springs : ndarray, shape (2, 2)
        S_ref.

    Notes
    -----
    `basis`, (m, m), takes the coordinates of `modes` back to that basis. Poles must be distinct:
    see `distinct`.
    """

    def __init__(self, squares: FloatArray, spring_rows: FloatArray, springs: FloatArray) -> None:
        lower = np.linalg.cholesky(springs)  # S_ref is the unit matrix for the coordinates Lᵀ y
        self._unscale = np.linalg.inv(lower)
        Y = lower.T @ spring_rows
        free = np.diag(squares) - Y.T @ Y  # stiffness without springs
        clamped = null_space(Y)
        self.poles, rotation = eigh(clamped.T @ free @ clamped)
        clamped = clamped @ rotation
        static = np.linalg.pinv(Y)  # any motion with y = 1, less the clamped modes' part in it
        static -= clamped @ ((clamped.T @ free @ static) / self.poles[:, None])
        self.basis = np.concatenate([static, clamped], axis=1)
        self._participation = clamped.T @ static  # c, (n_poles, 2)
        self._weights = _entries(
            self._participation[:, :, None] * self._participation[:, None, :]
        ).T  # (n_poles, 3)
        self._stiffness = _entries(static.T @ free @ static)  # K_s
        mass = static.T @ static  # M_s
        self._mass = _entries(mass)
        self._own_mass = mass - self._participation.T @ self._participation
        self._differences = self.poles - self.poles[:, None]  # p_j − p_near, (near, j)

    @property
    def n_modes(self) -> int:
        """As many as there are poles: the k-th mode lies below the k-th pole."""
        return len(self.poles)

    @property
    def distinct(self) -> bool:
        """Whether the poles are positive and far enough apart for the enclosure to work."""
        return bool(self.poles[0] > 0 and np.all(np.diff(self.poles) > 1e-9 * self.poles[1:]))

    def modes(self, springs: FloatArray) -> SpringModes:
        """Return the modes with other springs.

        Parameters
        ----------
        springs : ndarray, shape (n, 2, 2)
            S, positive definite and strong enough to hold the structure.
        """
        roots = self._enclosed(_entries(self._unscale @ springs @ self._unscale.T))
        self._converge(roots)
        squares, coordinates = self._mode_vectors(roots)
        shape = (len(springs), self.n_modes)
        return SpringModes(squares.reshape(shape), coordinates.reshape(*shape, -1))

    @cached_property
    def _grid(self) -> _Grid:
        """As many points in every interval between poles, the first from 0 up, and one beyond."""
        edges = np.r_[0.0, self.poles]
        gaps = np.diff(edges)[:, None]
        from_left = np.broadcast_to(_DISTANCES * gaps, (len(gaps), len(_DISTANCES))).copy()
        from_left[0] -= self.poles[0]  # nothing happens at λ = 0: both halves count from pole 0
        from_right = -_DISTANCES[::-1] * gaps
        number = np.arange(len(gaps))[:, None]
        nearer = np.concatenate([np.maximum(number - 1, 0), number], axis=1)
        offset = np.concatenate([from_left, from_right], axis=1).ravel()
        offset = np.append(offset, _DISTANCES[0] * gaps[-1])
        near = np.append(np.repeat(nearer.ravel(), len(_DISTANCES)), len(gaps) - 1)
        below = np.append(np.repeat(number.ravel(), 2 * len(_DISTANCES)), len(gaps))
        g, _, _ = self._condensed(np.zeros((3, len(near))), near, offset)
        return _Grid(near=near, offset=offset, poles_below=below, g=g)

    def _condensed(
        self, springs: FloatArray, near: IndexArray, offset: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """G and dG/dλ as entries 11, 22, 12, (3, N), and 1 / (p_j − λ), (N, n_poles)."""
        inverse = self._differences.take(near, axis=0)
        inverse -= offset[:, None]
        np.reciprocal(inverse, out=inverse)
        first = (inverse @ self._weights).T
        second = (np.square(inverse) @ self._weights).T
        square = self.poles[near] + offset
        first *= square
        g = springs + self._stiffness[:, None] - square * (self._mass[:, None] + first)
        return g, -self._mass[:, None] - 2 * first - square**2 * second, inverse

    def _enclosed(self, springs: FloatArray) -> _Roots:
        """Return every root between two neighbouring points of the grid, by bisection of the count.

        Parameters
        ----------
        springs : ndarray, shape (3, n)
            The k-th mode lies between the poles k − 2 and k, or at one of them.
        """
        grid, per_interval = self._grid, 2 * len(_DISTANCES)
        number = np.tile(np.arange(self.n_modes), springs.shape[1])
        springs = np.repeat(springs, self.n_modes, axis=1)
        lower = np.maximum((number - 1) * per_interval - 1, 0)
        upper = (number + 1) * per_interval
        for _ in range(int(np.ceil(np.log2(2 * per_interval + 1)))):
            middle = (lower + upper) // 2
            g11, g22, g12 = springs + grid.g.take(middle, axis=1)
            negative = np.where(g11 * g22 < g12 * g12, 1, 2 * (g11 + g22 < 0))
            too_high = grid.poles_below[middle] + negative > number
            upper = np.where(too_high, middle, upper)
            lower = np.where(too_high, lower, middle)
        near = grid.near[upper]
        roots = _Roots(
            springs=springs,
            near=near,
            offset=grid.offset[upper],
            lower=self.poles[grid.near[lower]] - self.poles[near] + grid.offset[lower],
            upper=grid.offset[upper],
            side=np.where(number <= grid.poles_below[upper], -1.0, 1.0),
        )
        at_lower = _eigenvalue(springs + grid.g.take(lower, axis=1), roots.side)
        at_upper = _eigenvalue(springs + grid.g.take(upper, axis=1), roots.side)
        self._start(roots, at_lower, at_upper)
        return roots

    @staticmethod
    def _start(roots: _Roots, at_lower: FloatArray, at_upper: FloatArray) -> None:
        """First offset: the secant in 1 / offset, in which an eigenvalue near a pole is linear."""
        inside = ~roots.at_pole & (at_lower > 0) & (at_upper < 0)
        share = at_lower[inside] / (at_lower[inside] - at_upper[inside])
        reciprocal = (1 - share) / roots.lower[inside] + share / roots.upper[inside]
        roots.offset[inside] = 1 / reciprocal

    def _converge(self, roots: _Roots) -> None:
        """Newton's method in 1 / offset, inside the enclosure, for all roots together.

        With μ the eigenvalue of G that vanishes:  offset ← offset / (1 + μ / (μ' offset))
        """
        active = np.flatnonzero(~roots.at_pole)
        for _ in range(_NEWTON_STEPS):
            if not len(active):
                return
            part = roots.take(active)
            g, g_slope, _ = self._condensed(part.springs, part.near, part.offset)
            value, slope = _eigenvalue(g, part.side), _eigenvalue_slope(g, g_slope, part.side)
            above = value > 0  # eigenvalues of G fall: the root lies further up
            lower = np.where(above, part.offset, part.lower)
            upper = np.where(above, part.upper, part.offset)
            with np.errstate(divide="ignore", invalid="ignore"):  # rounding; caught by the guard
                offset = part.offset / (1 + value / (slope * part.offset))
            guarded = ~((offset >= lower) & (offset <= upper))
            offset[guarded] = np.sign(upper[guarded]) * np.sqrt(lower[guarded] * upper[guarded])
            roots.lower[active], roots.upper[active], roots.offset[active] = lower, upper, offset
            active = active[np.abs(offset - part.offset) > _CONVERGED * np.abs(offset)]

    def _mode_vectors(self, roots: _Roots) -> tuple[FloatArray, FloatArray]:
        """λ (n_roots,) and mass-normalised coordinates (n_roots, m).

        The clamped modes' amplitudes are a_j = λ c_j · y / (p_j − λ), and the modal mass is
            −yᵀ G' y = yᵀ (M_s − Σ c_j c_jᵀ) y + Σ (c_j · y + a_j)²
        in this form, because near a pole the entries of G' are huge and cancel where y moves
        across its c: their difference may even be negative.
        """
        g, _, inverse = self._condensed(roots.springs, roots.near, roots.offset)
        squares = self.poles[roots.near] + roots.offset
        y = _eigenvector(g, roots.side)
        coordinates = np.empty((len(y), 2 + self.n_modes))
        coordinates[:, :2] = y
        moved = y @ self._participation.T
        inverse *= squares[:, None]
        np.multiply(moved, inverse, out=coordinates[:, 2:])
        moved += coordinates[:, 2:]
        modal_mass = np.einsum("ni,ij,nj->n", y, self._own_mass, y)
        modal_mass += np.einsum("nj,nj->n", moved, moved)
        coordinates /= np.sqrt(modal_mass)[:, None]
        at_pole = np.flatnonzero(roots.at_pole)
        coordinates[at_pole] = 0.0
        coordinates[at_pole, 2 + roots.near[at_pole]] = 1.0
        return squares, coordinates


class SpringEigenproblem:
    """The same by a plain eigenvalue solution: slower, for any number of planes and any poles.

    Parameters
    ----------
    squares : ndarray, shape (m,)
        Λ: stiffness in a mass-normalised basis, with springs S_ref.
    spring_rows : ndarray, shape (n_planes, 2, m)
        Y: the mudline coordinates of each plane in that basis.
    springs : ndarray, shape (2, 2)
        S_ref.

    Notes
    -----
        K = Λ + Σ Yᵀ (S − S_ref) Y over the planes
    """

    def __init__(self, squares: FloatArray, spring_rows: FloatArray, springs: FloatArray) -> None:
        self._squares = squares
        self._spring_rows = spring_rows
        self._springs = springs
        self.basis = np.eye(len(squares))

    def modes(self, springs: FloatArray) -> SpringModes:
        """Return the modes with other springs S, (n, 2, 2)."""
        Y = self._spring_rows
        stiffness = np.einsum("pia,nij,pjb->nab", Y, springs - self._springs, Y, optimize=True)
        diagonal = np.arange(len(self._squares))
        stiffness[:, diagonal, diagonal] += self._squares
        squares, vectors = np.linalg.eigh(stiffness)
        return SpringModes(squares, vectors.swapaxes(1, 2))


def spring_modes_solver(
    squares: FloatArray, spring_rows: FloatArray, springs: FloatArray, *, n_modes: int
) -> MudlineCondensation | SpringEigenproblem:
    """Return the faster of the two that can give the lowest n_modes of this group.

    The other arguments as for SpringEigenproblem.
    """
    acting = spring_rows[np.abs(spring_rows).max(axis=(1, 2)) > 0]
    if len(acting) == 1 and len(squares) - 2 >= n_modes:
        condensation = MudlineCondensation(squares, acting[0], springs)
        if condensation.distinct:
            return condensation
    return SpringEigenproblem(squares, acting, springs)


def _entries(matrices: FloatArray) -> FloatArray:
    """Entries 11, 22, 12 of symmetric 2 × 2 matrices: (..., 2, 2) → (3, ...)."""
    return np.stack([matrices[..., 0, 0], matrices[..., 1, 1], matrices[..., 0, 1]])


def _eigenvalue(g: FloatArray, side: FloatArray) -> FloatArray:
    """Smaller (side −1) or larger (+1) eigenvalue of G; g: entries (3, N)."""
    g11, g22, g12 = g
    return (g11 + g22) / 2 + side * np.hypot((g11 - g22) / 2, g12)


def _eigenvalue_slope(g: FloatArray, g_slope: FloatArray, side: FloatArray) -> FloatArray:
    """Derivative of that eigenvalue, given the derivatives of the entries (3, N)."""
    half, d_half = (g[0] - g[1]) / 2, (g_slope[0] - g_slope[1]) / 2
    radius = np.maximum(np.hypot(half, g[2]), np.finfo(float).tiny)
    return (g_slope[0] + g_slope[1]) / 2 + side * (half * d_half + g[2] * g_slope[2]) / radius


def _eigenvector(g: FloatArray, side: FloatArray) -> FloatArray:
    """Unit eigenvector (N, 2) of that eigenvalue, by the form that does not cancel."""
    half, coupling = side * (g[0] - g[1]) / 2, side * g[2]
    long = np.abs(half) + np.hypot(half, coupling)
    first = np.where(half >= 0, long, coupling)
    second = np.where(half >= 0, coupling, long)
    vector = np.stack([first, second], axis=1)
    return vector / np.linalg.norm(vector, axis=1)[:, None]
