"""What is remembered of the windows: sums over segments of time, and the steps between them.

A segment is what lies between two candidates, the windows a change may have started with. With the
surroundings of a window z = (1, l, v), l the water level and v the wind, every segment holds for
each track these sums over its windows of weight w = hop / (duration · σ²):

    Σ w z (z, l²)ᵀ,   Σ w y z of y cut,   the same of y as it was

From them follow the regression on z and every candidate's step; the model's dependence on the
level, slope and curvature of each paired track, can be taken out afterwards, so that it is always
the present pairing's.

Why errors are cut at three standard deviations: an identification that takes a mode's sister for
the mode must not look like scour. What is found is then measured on the errors uncut.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray, IndexArray

SLOPE_STD = 0.01  # prior of ∂ ln f / ∂ level, beyond what the model predicts [1/m]
WIND_STD = 0.00005  # prior of ∂ ln f / ∂ wind speed, as storms move simulated towers [s/m]
WIND_REFERENCE = 10.0  # where the regression counts the wind from [m/s]
FLAT = 1e-6  # information on the intercept of ln f: a standard deviation of 1000
PRIOR = np.diag([FLAT, SLOPE_STD**-2, WIND_STD**-2])[:, :, None]  # of β, as information
MODEL_SLOPE_PRIOR = np.diag([FLAT, 1e8, WIND_STD**-2])[:, :, None]  # the model's slopes hold
CUT = 3.0  # errors beyond so many standard deviations count as such [-]
SCATTER_WINDOWS = 10.0  # what the identification's own standard deviation counts for
SCATTER_RANGE = (0.5, 25.0)  # of s²

N_Z = 3
PRODUCTS = slice(0, N_Z * (N_Z + 1))  # places of Σ w z (z, l²)ᵀ row by row
CUT_MOMENTS = slice(PRODUCTS.stop, PRODUCTS.stop + N_Z)  # of Σ w y z of y cut
UNCUT_MOMENTS = slice(CUT_MOMENTS.stop, CUT_MOMENTS.stop + N_Z)
N_SUMS = UNCUT_MOMENTS.stop
NEXT, LAST = np.array([[1], [2], [0]]), np.array([[2], [0], [1]])  # rows of a cofactor


@dataclass(frozen=True, slots=True)
class SeenFrequency:
    """A tracked mode in one window."""

    track: int
    log_frequency: float
    """Ln f."""
    std: float
    """Relative [-]."""


@dataclass(frozen=True, slots=True)
class WatchedWindow:
    """What the detectors receive of one window."""

    start_ns: int
    duration: float
    """Length of the window [s]."""
    seen: tuple[SeenFrequency, ...]
    weight: float = 1.0
    """Hop / window duration: how much of it is new [-]."""
    water_level: float = 0.0
    """Above the model's [m]; 0 where it is not known."""
    wind: float = 0.0
    """Mean speed above WIND_REFERENCE [m/s]; 0 where it is not known."""
    level_std: float = 0.0
    """Of a level that nothing reports; 0 where one is reported [m]."""

    @property
    def surroundings(self) -> FloatArray:
        """z, (3,)"""
        return np.array([1.0, self.water_level, self.wind])


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A window's frequencies by the columns of the sums before it."""

    columns: NDArray[np.intp]
    """(n_seen,)."""
    values: FloatArray
    """y, ln f from the reference, (n_seen,)."""
    variances: FloatArray
    """σ² as stated, (n_seen,)."""
    totals: FloatArray
    """Of the sums before it, (N_SUMS, J)."""


SLOPE_ERROR = (
    0.1  # of S over a change of a fifth of a spring: curvature, and figures that are off [-]
)
ROUGH_SLOPE_ERROR = 0.3  # of a model whose description does not hold [-]


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivities:
    """How the model's frequencies depend on springs and water, by track; zeros for a track that is
    paired with no mode of the model."""

    stiffness: FloatArray
    """S = ∂ ln f / ∂ (k / nominal), (J, 3) [-]."""
    water: FloatArray
    """∂ ln f / ∂ level and ½ ∂² ln f / ∂ level², (J, 2) [1/m, 1/m²]."""
    rough: bool = False
    """Of a model whose description does not hold."""
    level_std: float = 0.0
    """Of levels that follow from the modes; 0: they are reported [m]."""

    @property
    def slope_error(self) -> float:
        """Relative standard deviation of S over the whole of a large change [-]."""
        return ROUGH_SLOPE_ERROR if self.rough else SLOPE_ERROR

    @property
    def half_way_error(self) -> float:
        """The same of S half way through it: its curvature cancels [-]."""
        return ROUGH_SLOPE_ERROR if self.rough else 0.0

    @property
    def slopes(self) -> FloatArray:
        """(J, 3) S; (J, 4) with the level's a beside it where that follows from the modes, for
        what it took of a change or did not."""
        if self.level_std == 0.0:
            return self.stiffness
        return np.column_stack([self.stiffness, self.water[:, 0]])

    def precision(self, size: float) -> FloatArray:
        """Of what `slopes` multiply, beforehand, for springs' ratios of that standard deviation;
        (3, 3) or (4, 4)."""
        level = [] if self.level_std == 0.0 else [self.level_std**-2]
        return np.diag([size**-2] * 3 + level)

    def of_tracks(self, chosen: IndexArray) -> "Sensitivities":
        """Of some of the tracks."""
        return replace(self, stiffness=self.stiffness[chosen], water=self.water[chosen])

    @classmethod
    def unknown(cls, n_tracks: int) -> "Sensitivities":
        """No track is paired."""
        return cls(np.zeros((n_tracks, 3)), np.zeros((n_tracks, 2)))


_NONE = partial(np.zeros, 0)
_NO_PAIRS = partial(np.zeros, (2, 0))
_NO_SEGMENTS = partial(np.zeros, (N_SUMS, 0, 0))


@dataclass(frozen=True, slots=True, eq=False)
class ChangeSums:
    """Sums over windows since the last change, of K segments and J tracks. Their size depends on
    the numbers of tracks and candidates only, not on that of windows."""

    tracks: tuple[int, ...] = ()
    starts_ns: tuple[int, ...] = ()
    """Of each segment's first window."""
    shares: FloatArray = field(default_factory=_NONE)
    """(K,) windows that a candidate stands for."""
    segments: FloatArray = field(default_factory=_NO_SEGMENTS)
    """Sums of every segment and track, y from the reference, (N_SUMS, K, J)."""
    reference: FloatArray = field(default_factory=_NONE)
    """Ln f when first seen, (J,)."""
    last: FloatArray = field(default_factory=_NO_PAIRS)
    """(2, J) y and σ² when last seen."""
    scatter: FloatArray = field(default_factory=_NO_PAIRS)
    """Σ of squared differences, and their number, (2, J)."""

    @property
    def totals(self) -> FloatArray:
        """(N_SUMS, J) sums over all segments."""
        return np.asarray(self.segments.sum(axis=1))

    @property
    def scatter_factor(self) -> FloatArray:
        """s², (J,): variance of successive observations over the one they state."""
        return scatter_factor(self.scatter)


def scatter_factor(scatter: FloatArray) -> FloatArray:
    """s², (J,), from (2, J) squared differences and their number."""
    factor = (SCATTER_WINDOWS + scatter[0]) / (SCATTER_WINDOWS + scatter[1])
    return np.minimum(np.maximum(factor, SCATTER_RANGE[0]), SCATTER_RANGE[1])


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """ln f, from the reference, of every track as β z, the model's dependence on the water taken
    out."""

    coefficients: FloatArray
    """β: at the model's level and WIND_REFERENCE, 1/m, s/m, (3, J)."""
    covariance: FloatArray
    """A⁻¹, (3, 3, J)."""

    @classmethod
    def of(
        cls,
        sums: FloatArray,
        water: FloatArray,
        moments: slice = UNCUT_MOMENTS,
        prior: FloatArray = PRIOR,
    ) -> "Regression":
        """sums: (N_SUMS, J). water: the model's slope and curvature, (J, 2)."""
        covariance = _inverse(_products(sums)[:, :N_Z] + prior)
        moved = reduced_moments(sums, water, moments)
        return cls((covariance * moved).sum(axis=1), covariance)

    def variance(self, surroundings: FloatArray) -> FloatArray:
        """(J,) of the line at z."""
        return np.asarray(surroundings @ (surroundings @ self.covariance))


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """What every candidate's windows imply of a step, g ~ N(δ h, h); both (K, J), in units of the
    tracks' own scatter."""

    g: FloatArray
    h: FloatArray

    def of(self, candidate: int) -> "Steps":
        """One candidate's, (1, J)."""
        return Steps(self.g[[candidate]], self.h[[candidate]])


def reduced_moments(
    sums: FloatArray, water: FloatArray, moments: slice, n: int = N_Z
) -> FloatArray:
    """(n, …, J): the first n of Σ w y z with the model's slope a and curvature b of the level
    taken out of y, y − a l − b l², from (N_SUMS, …, J) sums."""
    slope, curvature = water.T
    products = _products(sums)[:n]
    return np.asarray(sums[moments][:n] - slope * products[:, 1] - curvature * products[:, N_Z])


def _products(sums: FloatArray) -> FloatArray:
    """(3, 4, …, J) Σ w z (z, l²)ᵀ"""
    return sums[PRODUCTS].reshape(N_Z, N_Z + 1, *sums.shape[1:])


def _inverse(matrix: FloatArray) -> FloatArray:
    """Of symmetric 3 × 3 matrices, (3, 3, …), by cofactors: for dozens so small twice as fast as a
    library's decomposition."""
    cofactors = (
        matrix[NEXT, NEXT.T] * matrix[LAST, LAST.T] - matrix[NEXT, LAST.T] * matrix[LAST, NEXT.T]
    )
    return np.asarray(cofactors / (matrix[0] * cofactors[0]).sum(axis=0))


def steps(sums: ChangeSums, water: FloatArray, moments: slice = CUT_MOMENTS) -> Steps:
    """g and h of every candidate and track. water: (J, 2)."""
    line = Regression.of(sums.totals, water, moments)
    wanted = np.concatenate(
        [_products(sums.segments)[0, :N_Z], reduced_moments(sums.segments, water, moments, 1)]
    )
    from_each = np.cumsum(wanted[:, ::-1], axis=1)[:, ::-1]  # sums from each candidate on
    c, r = from_each[:N_Z], from_each[N_Z]
    pulled = (line.covariance[:, :, None] * c).sum(axis=1)  # A⁻¹ c
    h = c[0] - (c * pulled).sum(axis=0)
    g = r - (c * line.coefficients[:, None]).sum(axis=0)
    known = (h > 1e-9 * c[0]) / sums.scatter_factor  # 0: the rounding of a track not seen before
    return Steps(g * known, h * known)


def before(sums: ChangeSums, candidate: int) -> FloatArray:
    """(N_SUMS, J) sums over the windows before a candidate."""
    return np.asarray(sums.segments[:, :candidate].sum(axis=1))


def with_window(
    sums: ChangeSums,
    window: WatchedWindow,
    observed: Seen,
    water: FloatArray,
    *,
    most_candidates: int,
) -> ChangeSums:
    """The sums after one more window, in the form that `seen_in` returns."""
    seen, values, variances = observed.columns, observed.values, observed.variances
    level, surroundings = window.water_level, window.surroundings
    scatter, last = _scatter(sums, seen, values, variances, window.weight)
    line = Regression.of(observed.totals, water, CUT_MOMENTS)
    predicted = surroundings @ line.coefficients + (water[:, 0] + water[:, 1] * level) * level
    spread = np.sqrt(line.variance(surroundings) + last[1] * scatter_factor(scatter))[seen]
    within = CUT * spread
    expected = predicted[seen]
    cut = np.minimum(np.maximum(values, expected - within), expected + within)
    new = np.zeros((N_SUMS, 1, len(sums.tracks)))
    products = np.outer(surroundings, [*surroundings, level**2]).ravel()
    of_values = surroundings[:, None] * np.stack([cut, values])[:, None]  # (2, 3, n_seen)
    rows = [np.tile(products[:, None], len(seen)), *of_values]
    new[:, 0, seen] = np.concatenate(rows) * window.weight / variances
    grown = replace(
        sums,
        starts_ns=(*sums.starts_ns, window.start_ns),
        shares=np.concatenate([sums.shares, [window.weight]]),
        segments=np.concatenate([sums.segments, new], axis=1),
        scatter=scatter,
        last=last,
    )
    return _thinned(grown, most_candidates)


def seen_in(sums: ChangeSums, window: WatchedWindow) -> Seen:
    """A window's frequencies by the columns of the sums, which have all its tracks
    (`with_tracks_of`)."""
    column = {track: number for number, track in enumerate(sums.tracks)}
    columns = np.array([column[each.track] for each in window.seen], dtype=np.intp)
    values = np.array([each.log_frequency for each in window.seen]) - sums.reference[columns]
    return Seen(columns, values, np.square([each.std for each in window.seen]), sums.totals)


def with_tracks_of(sums: ChangeSums, window: WatchedWindow) -> ChangeSums:
    """With a column for every track that the window sees for the first time."""
    known = set(sums.tracks)
    new = [each for each in window.seen if each.track not in known]
    if not new:
        return sums
    more = len(new)
    return replace(
        sums,
        tracks=sums.tracks + tuple(each.track for each in new),
        segments=np.pad(sums.segments, ((0, 0), (0, 0), (0, more))),
        reference=np.append(sums.reference, [each.log_frequency for each in new]),
        last=np.pad(sums.last, ((0, 0), (0, more)), constant_values=np.nan),
        scatter=np.pad(sums.scatter, ((0, 0), (0, more))),
    )


def with_tracks_only(sums: ChangeSums, kept: Sequence[int]) -> ChangeSums:
    """Without the columns of tracks that are remembered no longer."""
    wanted = set(kept)
    columns = [number for number, track in enumerate(sums.tracks) if track in wanted]
    if len(columns) == len(sums.tracks):
        return sums
    return replace(
        sums,
        tracks=tuple(sums.tracks[number] for number in columns),
        segments=sums.segments[:, :, columns],
        reference=sums.reference[columns],
        last=sums.last[:, columns],
        scatter=sums.scatter[:, columns],
    )


def since(sums: ChangeSums, candidate: int) -> ChangeSums:
    """The windows from a candidate on as all there is; their errors uncut, since it was the change
    that they were cut for."""
    segments = sums.segments[:, candidate:].copy()
    segments[CUT_MOMENTS] = segments[UNCUT_MOMENTS]
    return replace(
        sums,
        starts_ns=sums.starts_ns[candidate:],
        shares=sums.shares[candidate:],
        segments=segments,
    )


def _thinned(sums: ChangeSums, most: int) -> ChangeSums:
    """With at most so many candidates: the one goes whose neighbours are nearest to each other for
    its age; the next one stands for it as well. That choice knows nothing of the measurements."""
    if len(sums.starts_ns) <= most:
        return sums
    starts = np.array(sums.starts_ns, dtype=float)
    dropped = int(np.argmin((starts[2:] - starts[:-2]) / (starts[-1] - starts[1:-1]))) + 1
    whole, shares = sums.segments, sums.shares
    joined = whole[:, dropped - 1 : dropped] + whole[:, dropped : dropped + 1]
    return replace(
        sums,
        starts_ns=sums.starts_ns[:dropped] + sums.starts_ns[dropped + 1 :],
        shares=np.concatenate(
            [shares[:dropped], [shares[dropped] + shares[dropped + 1]], shares[dropped + 2 :]]
        ),
        segments=np.concatenate([whole[:, : dropped - 1], joined, whole[:, dropped + 1 :]], axis=1),
    )


def _scatter(
    sums: ChangeSums,
    seen: NDArray[np.intp],
    values: FloatArray,
    variances: FloatArray,
    weight: float,
) -> tuple[FloatArray, FloatArray]:
    """Sums of the squared differences between successive observations, and the last observations.

    (y_t − y_{t−1})² / (σ_t² + σ_{t−1}²) has mean s², w s² for windows that overlap by 1 − w. A
    step enters only one difference, and counts for nine times s² at most: what is to be found
    doesn't hide itself in the scatter.
    """
    largest = CUT**2 * sums.scatter_factor[seen]
    scatter, last = sums.scatter.copy(), sums.last.copy()
    squares = (values - last[0, seen]) ** 2 / ((variances + last[1, seen]) * weight)
    known = np.isfinite(squares)
    scatter[0, seen[known]] += np.minimum(squares, largest)[known]
    scatter[1, seen[known]] += 1
    last[:, seen] = values, variances
    return scatter, last
