"""What is remembered of the windows: sums over segments of time, and the steps between them.

A segment is what lies between two candidates, the windows a change may have begun with. Every
segment holds, for each track, eight sums over its windows of weight w = hop / (duration · σ²):

    Σ w l⁰ … l³,   Σ w y l⁰ … l¹ of y cut,   the same of y as it was     (l the water level)

From them follow the regression on the level and every candidate's step; the model's dependence on
the level, slope and curvature of each paired track, can be taken out afterwards, so that it is
always the present pairing's.

Why errors are cut at three standard deviations: an identification that takes a mode's sister for
the mode must not look like scour. What is found is then measured on the errors uncut.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from pipeline.updating.forward_model import FloatArray

SLOPE_STD = 0.01  # prior of ∂ ln f / ∂ level, beyond what the model says of it [1/m]
FLAT = 1e-6  # information on the intercept of ln f: a standard deviation of 1000
CUT = 3.0  # errors beyond so many standard deviations count as such [-]
SCATTER_WINDOWS = 10.0  # what the identification's own standard deviation counts for
SCATTER_RANGE = (0.5, 25.0)  # of s²

N_SUMS = 8
CUT_MOMENTS = (4, 5)  # places of Σ w y l⁰, l¹ of y cut, after those of Σ w l⁰ … l³
UNCUT_MOMENTS = (6, 7)


@dataclass(frozen=True, slots=True)
class SeenFrequency:
    """A tracked mode in one window."""

    track: int
    log_frequency: float  # ln f
    std: float  # relative [-]


@dataclass(frozen=True, slots=True)
class WatchedWindow:
    """What the detectors are told of one window."""

    start_ns: int
    duration: float  # [s]
    seen: tuple[SeenFrequency, ...]
    weight: float = 1.0  # hop / window duration: how much of it is new [-]
    water_level: float = 0.0  # above the model's [m]; 0 where it is not known


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A window's frequencies by the columns of the sums before it."""

    columns: NDArray[np.intp]  # (n_seen,)
    values: FloatArray  # y, ln f from the reference, (n_seen,)
    variances: FloatArray  # σ² as stated, (n_seen,)
    totals: FloatArray  # of the sums before it, (8, J)


@dataclass(frozen=True, slots=True, eq=False)
class Sensitivities:
    """How the model's frequencies depend on springs and water, by track; zeros for a track that is
    paired with no mode of the model."""

    stiffness: FloatArray  # S = ∂ ln f / ∂ (k / nominal), (J, 3) [-]
    water: FloatArray  # ∂ ln f / ∂ level and ½ ∂² ln f / ∂ level², (J, 2) [1/m, 1/m²]

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
    starts_ns: tuple[int, ...] = ()  # of each segment's first window
    shares: FloatArray = field(default_factory=_NONE)  # (K,) windows that a candidate stands for
    segments: FloatArray = field(default_factory=_NO_SEGMENTS)  # (8, K, J); y from the reference
    reference: FloatArray = field(default_factory=_NONE)  # ln f when first seen, (J,)
    last: FloatArray = field(default_factory=_NO_PAIRS)  # (2, J) y and σ² when last seen
    scatter: FloatArray = field(
        default_factory=_NO_PAIRS
    )  # (2, J) Σ of squared differences, and their number

    @property
    def totals(self) -> FloatArray:
        """(8, J) sums over all segments."""
        return np.asarray(self.segments.sum(axis=1))

    @property
    def scatter_factor(self) -> FloatArray:
        """s², (J,): variance of successive sightings over the one they state."""
        return scatter_factor(self.scatter)


def scatter_factor(scatter: FloatArray) -> FloatArray:
    """s², (J,), from (2, J) squared differences and their number."""
    factor = (SCATTER_WINDOWS + scatter[0]) / (SCATTER_WINDOWS + scatter[1])
    return np.minimum(np.maximum(factor, SCATTER_RANGE[0]), SCATTER_RANGE[1])


@dataclass(frozen=True, slots=True, eq=False)
class Regression:
    """ln f, from the reference, of every track as a line in the water level."""

    intercept: FloatArray  # (J,)
    slope: FloatArray  # (J,) beyond the model's [1/m]
    covariance: FloatArray  # A⁻¹: of the intercept, of both, of the slope, (3, J)

    @classmethod
    def of(
        cls, sums: FloatArray, water: FloatArray, moments: tuple[int, int] = UNCUT_MOMENTS
    ) -> "Regression":
        """sums: (8, J). water: the model's slope and curvature, (J, 2)."""
        n, c, square = sums[:3]
        moment, of_level = reduced_moments(sums, water, moments)
        a, d = n + FLAT, square + SLOPE_STD**-2
        determinant = a * d - c**2
        return cls(
            intercept=(d * moment - c * of_level) / determinant,
            slope=(a * of_level - c * moment) / determinant,
            covariance=np.array([d, -c, a]) / determinant,
        )

    def variance(self, level: float) -> FloatArray:
        """(J,) of the line at a level [m]."""
        own, both, slope = self.covariance
        return np.asarray(own + 2 * level * both + level**2 * slope)


@dataclass(frozen=True, slots=True, eq=False)
class Steps:
    """What every candidate's windows say of a step, g ~ N(δ h, h); both (K, J), in units of the
    tracks' own scatter."""

    g: FloatArray
    h: FloatArray

    def of(self, candidate: int) -> "Steps":
        """One candidate's, (1, J)."""
        return Steps(self.g[[candidate]], self.h[[candidate]])


def reduced_moments(
    sums: FloatArray, water: FloatArray, moments: tuple[int, int], n_powers: int = 2
) -> FloatArray:
    """(n_powers, …, J): Σ w y lᵖ, p = 0, 1, with the model's slope a and curvature b of the level
    taken out of y, y − a l − b l², from (8, …, J) sums."""
    slope, curvature = water.T
    own = sums[moments[0] : moments[0] + n_powers]
    return np.asarray(own - slope * sums[1 : 1 + n_powers] - curvature * sums[2 : 2 + n_powers])


def steps(sums: ChangeSums, water: FloatArray, moments: tuple[int, int] = CUT_MOMENTS) -> Steps:
    """g and h of every candidate and track. water: (J, 2)."""
    line = Regression.of(sums.totals, water, moments)
    wanted = np.concatenate([sums.segments[:2], reduced_moments(sums.segments, water, moments, 1)])
    n, c, r = np.cumsum(wanted[:, ::-1], axis=1)[:, ::-1]  # sums from each candidate on
    own, both, slope = line.covariance
    h = n - (own * n**2 + 2 * both * n * c + slope * c**2)
    g = r - line.intercept * n - line.slope * c
    told = (h > 1e-9 * n) / sums.scatter_factor  # 0: the rounding of a track not seen before
    return Steps(g * told, h * told)


def before(sums: ChangeSums, candidate: int) -> FloatArray:
    """(8, J) sums over the windows before a candidate."""
    return np.asarray(sums.segments[:, :candidate].sum(axis=1))


def with_window(
    sums: ChangeSums, window: WatchedWindow, told: Seen, water: FloatArray, *, most_candidates: int
) -> ChangeSums:
    """The sums after one more window, told as `seen_in` tells it."""
    seen, values, variances = told.columns, told.values, told.variances
    level = window.water_level
    scatter, last = _scatter(sums, seen, values, variances, window.weight)
    line = Regression.of(told.totals, water, CUT_MOMENTS)
    predicted = line.intercept + (line.slope + water[:, 0] + water[:, 1] * level) * level
    spread = np.sqrt(line.variance(level) + last[1] * scatter_factor(scatter))[seen]
    within = CUT * spread
    expected = predicted[seen]
    cut = np.minimum(np.maximum(values, expected - within), expected + within)
    new = np.zeros((N_SUMS, 1, len(sums.tracks)))
    powers = np.array([1.0, level, level**2, level**3])[:, None]
    rows = np.concatenate([powers * np.ones(len(seen)), powers[:2] * cut, powers[:2] * values])
    new[:, 0, seen] = rows * window.weight / variances
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
    segments[list(CUT_MOMENTS)] = segments[list(UNCUT_MOMENTS)]
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
    """Sums of the squared differences between successive sightings, and the last sightings.

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
