"""When did the structure change, and was it the foundation? Two detectors on sums alone.

Every tracked mode's ln f is a line in what is known of the environment (the water level), with
errors of known size; a change adds a step δ_j from some window k on:

    y_tj = β_jᵀ z_t + δ_j [t ≥ k] + e_tj,   z = (1, water level),   e ~ N(0, s_j² σ_tj²)

β is integrated out under a flat prior of the intercept. With the sums from k on,
n = Σ 1/σ², c = Σ z/σ², r = Σ y/σ², and A, β̂ of all windows, what is left of the step is

    g = r − cᵀ β̂,   h = n − cᵀ A⁻¹ c      (g ~ N(δ h, h))

so that each candidate k costs a few products and the model's constant discrepancy, which sits in
the intercept, cancels. The likelihood ratio of a change at k is

    modal drift    δ_j ~ N(0, τ²) for one mode or for all:  (1 + τ²h)^(−½) exp(½ g² τ² / (1 + τ²h))
    foundation     δ_j = S_j κ, S = ∂ ln f / ∂ ratio, κ ~ N(0, τ² 1):
                   det(1 + τ² H)^(−½) exp(½ Gᵀ (H + 1/τ²)⁻¹ G),   H = Σ h_j S_j S_jᵀ, G = Σ g_j S_j

mixed over a few τ. Their sum over the candidates, R = Σ_k LR_k (Shiryaev and Roberts), is what the
Bayesian change-point mixture with a small constant hazard ρ says: P(changed) = ρR / (1 + ρR). R − t
is a martingale while nothing changes, so an alarm at R ≥ A comes falsely at most once in A windows
on average, whatever the number of modes: the person sets the rate, no threshold is tuned.

Beside it, a stiffness that walks: a Kalman filter of κ with a step of given size a window.
Sources: Shiryaev (1963), Theory of Probability and its Applications 8; Pollak (1985), Annals of
Statistics 13; Adams and MacKay (2007), arXiv:0710.3742.

Why errors are cut at three standard deviations in the alarm: an identification that takes a mode's
sister for the mode must not look like scour. What is found is then measured on the errors uncut.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.updating.forward_model import FloatArray
from pipeline.updating.prior import UpdatingError

SECONDS_PER_YEAR = 365.25 * 86400.0
SHIFTS = np.array([0.001, 0.004, 0.016])  # τ of ln f [-]
STIFFNESS_SHIFTS = np.array([0.01, 0.05, 0.2])  # τ of the ratios k / nominal [-]
SLOPE_STD = 0.01  # prior of ∂ ln f / ∂ water level [1/m]
FLAT = 1e-6  # information on the intercept of ln f: a standard deviation of 1000
CUT = 3.0  # errors beyond so many standard deviations count as such [-]
SCATTER_WINDOWS = 10.0  # what the identification's own standard deviation counts for
SCATTER_RANGE = (0.5, 25.0)  # of s²
EXPLAINED = 0.5  # of the evidence of all modes, that stiffness must explain to be called its change
STEPS = 10  # of iterated least squares
N_REGRESSORS = 2  # intercept, water level


@dataclass(frozen=True, slots=True)
class ChangeSettings:
    """How much may be missed for how much quiet."""

    years_between_false_alarms: float = 3.0  # on average, of both detectors together [a]
    changes_per_year: float = 1.0  # expected beforehand; only the stated probability knows it
    candidates: int = 64  # windows that a change may have begun with; older ones are thinned out
    walk: float = 0.005  # step of the random-walk stiffness a window, share of nominal [-]

    def __post_init__(self) -> None:
        smallest = min(self.years_between_false_alarms, self.changes_per_year, self.walk)
        if not smallest > 0:
            raise UpdatingError(
                "years_between_false_alarms, changes_per_year and walk must be positive; one is "
                f"{smallest}"
            )
        if self.candidates < 8:
            raise UpdatingError(f"candidates is {self.candidates}; at least 8 are needed")


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
    water_level: float = float("nan")  # [m]


@dataclass(frozen=True, slots=True, eq=False)
class ChangeState:
    """Sums over windows; their size depends on the number of tracks and candidates only.

    Row 0 of the sums is over all windows since the last change, row k over those from candidate k
    on. Columns are tracks.
    """

    tracks: tuple[int, ...] = ()
    starts_ns: tuple[int, ...] = ()  # of each candidate's first window
    shares: FloatArray | None = None  # (K,) windows that a candidate stands for
    information: FloatArray | None = None  # Σ z zᵀ/σ², (1 + K, J, 2, 2)
    moments: FloatArray | None = None  # Σ z y/σ², (1 + K, J, 2); y cut, from the reference
    uncut: FloatArray | None = None  # the same of y as it was
    reference: FloatArray | None = None  # ln f when first seen, (J,)
    last: FloatArray | None = None  # (2, J) y and σ² when last seen
    scatter: FloatArray | None = None  # (2, J) Σ of squared differences, and their number
    walk_mean: FloatArray | None = None  # (3,) ratios
    walk_covariance: FloatArray | None = None  # (3, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What one window's look at the sums says."""

    drift: float  # R of the modal drift [windows]
    foundation: float  # R of the foundation's change [windows]
    threshold: float  # A, the same for both [windows]
    probability: float  # that there was a change since the last one [-]
    log_ratios: FloatArray  # (K,) of the detector with the larger R, shares included

    @property
    def alarm(self) -> bool:
        return max(self.drift, self.foundation) >= self.threshold


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """A change that was noticed: when, which kind, how large."""

    kind: str  # "foundation" or "modal-drift"
    candidate: int  # index of the most probable start
    restart: int  # index of the first candidate that lies after the change almost surely
    earliest: int  # indices of the 5 % …
    latest: int  # … and 95 % quantiles
    ratios: FloatArray  # κ, (3,) change of the ratios k / nominal
    covariance: FloatArray  # (3, 3)
    shifts: FloatArray  # (J,) change of ln f; NaN for tracks not seen before and after
    shift_stds: FloatArray  # (J,)
    log_frequencies: FloatArray  # (J,) before the change, at mean water level


class ChangeDetector:
    """Both detectors. Holds no state; ChangeState goes in and comes out."""

    def __init__(self, settings: ChangeSettings | None = None) -> None:
        self.settings = settings or ChangeSettings()

    def initial_state(self) -> ChangeState:
        """No window yet."""
        none = np.zeros
        return ChangeState(
            shares=none(0),
            information=none((1, 0, N_REGRESSORS, N_REGRESSORS)),
            moments=none((1, 0, N_REGRESSORS)),
            uncut=none((1, 0, N_REGRESSORS)),
            reference=none(0),
            last=none((2, 0)),
            scatter=none((2, 0)),
            walk_mean=none(3),
            walk_covariance=none((3, 3)),
        )

    def updated(
        self, state: ChangeState, window: WatchedWindow, sensitivities: FloatArray | None = None
    ) -> ChangeState:
        """The sums after one more window.

        sensitivities   S, (n_tracks, 3) of the state's tracks, for the walking stiffness; rows of
                        unpaired tracks zero
        """
        if not window.seen:
            return state
        state = _with_tracks(state, window.seen)
        state = _with_candidate(state, window, self.settings.candidates)
        column = {track: number for number, track in enumerate(state.tracks)}
        seen = np.array([column[each.track] for each in window.seen], dtype=np.intp)
        values = np.array([each.log_frequency for each in window.seen]) - _of(state.reference)[seen]
        variances = np.square([each.std for each in window.seen])
        regressors = np.array([1.0, np.nan_to_num(window.water_level)])
        return self._added(state, seen, values, variances, regressors, window, sensitivities)

    def _added(
        self,
        state: ChangeState,
        seen: NDArray[np.intp],
        values: FloatArray,
        variances: FloatArray,
        regressors: FloatArray,
        window: WatchedWindow,
        sensitivities: FloatArray | None,
    ) -> ChangeState:
        baseline, inverse = _baseline(state, _of(state.moments))
        scatter, last = _scatter(state, seen, values, variances, window.weight)
        predicted = baseline[seen] @ regressors
        spread = np.einsum("a,jab,b->j", regressors, inverse[seen], regressors)
        spread = np.sqrt(spread + variances * _scatter_factor(scatter)[seen])
        errors = values - predicted
        cut = predicted + np.clip(errors, -CUT * spread, CUT * spread)
        weights = window.weight / variances
        information, moments, uncut = (
            _of(each).copy() for each in (state.information, state.moments, state.uncut)
        )
        information[:, seen] += weights[:, None, None] * np.outer(regressors, regressors)
        moments[:, seen] += (weights * cut)[:, None] * regressors
        uncut[:, seen] += (weights * values)[:, None] * regressors
        mean, covariance = self._walked(state, seen, errors, spread, window, sensitivities)
        return replace(
            state,
            information=information,
            moments=moments,
            uncut=uncut,
            last=last,
            scatter=scatter,
            walk_mean=mean,
            walk_covariance=covariance,
        )

    def _walked(
        self,
        state: ChangeState,
        seen: NDArray[np.intp],
        errors: FloatArray,
        spread: FloatArray,
        window: WatchedWindow,
        sensitivities: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray]:
        """Kalman step of κ_t = κ_{t−1} + N(0, walk²), seen through errors = S κ + N(0, spread²)."""
        covariance = _of(state.walk_covariance) + window.weight * self.settings.walk**2 * np.eye(3)
        mean = _of(state.walk_mean)
        if sensitivities is None or not len(sensitivities):
            return mean, covariance
        known = np.flatnonzero((seen < len(sensitivities)) & (spread < 1.0))
        S = sensitivities[seen[known]]
        precision = window.weight / spread[known] ** 2
        covariance = np.asarray(
            np.linalg.inv(np.linalg.inv(covariance) + (S.T * precision) @ S), dtype=float
        )
        gain = covariance @ (S.T * precision)
        return mean + gain @ (errors[known] - S @ mean), (covariance + covariance.T) / 2

    def verdict(
        self, state: ChangeState, sensitivities: FloatArray, *, window_duration: float
    ) -> Verdict:
        """Whether there was a change. sensitivities: S, (n_tracks, 3); window_duration [s]."""
        g, h = _steps(state, _of(state.moments))
        shares = np.log(_of(state.shares))
        by_kind = shares + np.stack([_log_drift(g, h), _log_foundation(g, h, sensitivities)])
        totals = np.exp(np.minimum(_log_sum(by_kind.T), 700.0))
        a_year = SECONDS_PER_YEAR / window_duration  # windows
        hazard = self.settings.changes_per_year / a_year
        odds = hazard * float(totals.mean())
        return Verdict(
            drift=float(totals[0]),
            foundation=float(totals[1]),
            threshold=2 * self.settings.years_between_false_alarms * a_year,
            probability=odds / (1 + odds),
            log_ratios=by_kind[int(np.argmax(totals))],
        )

    def change(self, state: ChangeState, verdict: Verdict, sensitivities: FloatArray) -> Change:
        """The change behind an alarm, measured on the frequencies as they were."""
        chances = np.exp(verdict.log_ratios - _log_sum(verdict.log_ratios))
        candidate = int(np.argmax(chances))
        earliest, latest = np.searchsorted(np.cumsum(chances), [0.05, 0.95])
        latest = min(int(latest), len(chances) - 1)
        g, h = (each[[candidate]] for each in _steps(state, _of(state.uncut)))
        ratios, covariance = _stiffness_step(g[0], h[0], sensitivities)
        g_cut, h_cut = (each[[candidate]] for each in _steps(state, _of(state.moments)))
        by_stiffness = float(_log_foundation(g_cut, h_cut, sensitivities)[0])
        by_anything = float(_log_every(g_cut, h_cut)[0])
        baseline, _ = _baseline(state, _of(state.uncut), rows=_before(state, candidate))
        known = np.where(h[0] > 0, h[0], np.nan)
        return Change(
            kind="foundation" if by_stiffness >= EXPLAINED * by_anything else "modal-drift",
            candidate=candidate,
            restart=max(candidate, latest),
            earliest=min(int(earliest), candidate),
            latest=latest,
            ratios=ratios,
            covariance=covariance,
            shifts=g[0] / known,
            shift_stds=1 / np.sqrt(known),
            log_frequencies=_of(state.reference) + baseline[:, 0],
        )

    def restarted(self, state: ChangeState, candidate: int) -> ChangeState:
        """The sums with that candidate's windows as all there is: what was before is forgotten."""
        kept = slice(1 + candidate, None)  # its row becomes the row of all
        return replace(
            state,
            starts_ns=state.starts_ns[candidate + 1 :],
            shares=_of(state.shares)[candidate + 1 :],
            information=_of(state.information)[kept],
            moments=_of(state.uncut)[kept],
            uncut=_of(state.uncut)[kept],
            walk_mean=np.zeros(3),
            walk_covariance=np.zeros((3, 3)),
        )


def _of(array: FloatArray | None) -> FloatArray:
    assert array is not None  # ChangeDetector.initial_state fills every field
    return array


def _with_tracks(state: ChangeState, seen: Sequence[SeenFrequency]) -> ChangeState:
    """With a column for every track seen for the first time."""
    new = [each for each in seen if each.track not in state.tracks]
    if not new:
        return state

    def widened(array: FloatArray | None, axis: int) -> FloatArray:
        extent = [(0, len(new) if number == axis else 0) for number in range(_of(array).ndim)]
        return np.pad(_of(array), extent)

    first = [each.log_frequency for each in new]
    return replace(
        state,
        tracks=state.tracks + tuple(each.track for each in new),
        information=widened(state.information, 1),
        moments=widened(state.moments, 1),
        uncut=widened(state.uncut, 1),
        reference=np.append(_of(state.reference), first),
        last=np.hstack([_of(state.last), np.full((2, len(new)), np.nan)]),
        scatter=widened(state.scatter, 1),
    )


def with_tracks_only(state: ChangeState, kept: Sequence[int]) -> ChangeState:
    """Without the columns of tracks that are remembered no longer."""
    columns = [number for number, track in enumerate(state.tracks) if track in set(kept)]
    if len(columns) == len(state.tracks):
        return state
    return replace(
        state,
        tracks=tuple(state.tracks[number] for number in columns),
        information=_of(state.information)[:, columns],
        moments=_of(state.moments)[:, columns],
        uncut=_of(state.uncut)[:, columns],
        reference=_of(state.reference)[columns],
        last=_of(state.last)[:, columns],
        scatter=_of(state.scatter)[:, columns],
    )


def _with_candidate(state: ChangeState, window: WatchedWindow, most: int) -> ChangeState:
    """With a row for a change that begins with this window.

    Where there are too many, the two neighbours nearest to each other for their age become one,
    which stands for both. That choice knows nothing of the measurements.
    """
    starts = (*state.starts_ns, window.start_ns)
    shares = np.append(_of(state.shares), window.weight)
    kept = list(range(len(starts)))
    if len(starts) > most:
        ages = window.start_ns - np.array(starts[:-1], dtype=float)
        gaps = np.diff(np.array(starts, dtype=float))
        dropped = int(np.argmin(gaps[1:] / ages[1:])) + 1
        shares[dropped + 1] += shares[dropped]
        kept.remove(dropped)
    rows = [0, *(1 + number for number in kept)]

    def grown(array: FloatArray | None) -> FloatArray:
        array = _of(array)
        return np.concatenate([array, np.zeros((1, *array.shape[1:]))])[rows]

    return replace(
        state,
        starts_ns=tuple(starts[number] for number in kept),
        shares=shares[kept],
        information=grown(state.information),
        moments=grown(state.moments),
        uncut=grown(state.uncut),
    )


def _before(state: ChangeState, candidate: int) -> FloatArray:
    """(J, 2, 3) sums over the windows before a candidate: information beside uncut moments."""
    information, uncut = _of(state.information), _of(state.uncut)
    before = information[0] - information[1 + candidate]
    return np.concatenate([before, (uncut[0] - uncut[1 + candidate])[:, :, None]], axis=2)


def _baseline(
    state: ChangeState, moments: FloatArray, rows: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """β̂, (J, 2), and A⁻¹, (J, 2, 2), of all windows since the last change.

    rows   (J, 2, 3) other sums, information beside moments
    """
    if rows is None:
        rows = np.concatenate([_of(state.information)[0], moments[0][:, :, None]], axis=2)
    inverse = np.linalg.inv(rows[:, :, :N_REGRESSORS] + np.diag([FLAT, SLOPE_STD**-2]))
    return np.einsum("jab,jb->ja", inverse, rows[:, :, N_REGRESSORS]), np.asarray(inverse)


def _steps(state: ChangeState, moments: FloatArray) -> tuple[FloatArray, FloatArray]:
    """g and h of every candidate and track, (K, J) each, in units of the tracks' own scatter."""
    baseline, inverse = _baseline(state, moments)
    sums = _of(state.information)[1:, :, 0]  # n and c, (K, J, 2)
    n, c = sums[:, :, 0], sums[:, :, 1]
    h = n - (inverse[:, 0, 0] * n**2 + 2 * inverse[:, 0, 1] * n * c + inverse[:, 1, 1] * c**2)
    g = moments[1:, :, 0] - baseline[:, 0] * n - baseline[:, 1] * c
    factor = _scatter_factor(_of(state.scatter))
    h = np.where(h > 1e-9 * n, h, 0.0)  # rounding of a track not seen before k
    return np.where(h > 0, g, 0.0) / factor, h / factor


def _scatter(
    state: ChangeState,
    seen: NDArray[np.intp],
    values: FloatArray,
    variances: FloatArray,
    weight: float,
) -> tuple[FloatArray, FloatArray]:
    """Sums of the squared differences between successive sightings, and the last sightings.

    (y_t − y_{t−1})² / (σ_t² + σ_{t−1}²) has mean s², w s² for windows that overlap by 1 − w. A
    step enters only one difference: what is to be found doesn't hide itself in the scatter.
    """
    scatter, last = _of(state.scatter).copy(), _of(state.last).copy()
    squares = (values - last[0, seen]) ** 2 / ((variances + last[1, seen]) * weight)
    known = np.isfinite(squares)
    scatter[0, seen[known]] += np.minimum(squares[known], CUT**2)
    scatter[1, seen[known]] += 1
    last[:, seen] = values, variances
    return scatter, last


def _scatter_factor(scatter: FloatArray) -> FloatArray:
    """s², (J,)"""
    factor = (SCATTER_WINDOWS + scatter[0]) / (SCATTER_WINDOWS + scatter[1])
    return np.clip(factor, *SCATTER_RANGE)


def _log_each(g: FloatArray, h: FloatArray) -> FloatArray:
    """(n_τ, K, J) log likelihood ratio of a step in one mode."""
    growth = SHIFTS[:, None, None] ** 2 * h
    logs = np.log1p(growth)
    growth += 1
    return 0.5 * (g**2 * SHIFTS[:, None, None] ** 2 / growth - logs)


def _log_every(g: FloatArray, h: FloatArray) -> FloatArray:
    """(K,) … of steps in all modes, unrelated but of one size."""
    return _log_mean(_log_each(g, h).sum(axis=2))


def _log_drift(g: FloatArray, h: FloatArray) -> FloatArray:
    """(K,) log likelihood ratio of a modal drift: of every mode, or of one."""
    each = _log_each(g, h)
    watched = np.any(h > 0, axis=0)
    if not watched.any():
        return np.zeros(len(g))
    single = _log_mean(_log_mean(each[:, :, watched]).T)
    return np.logaddexp(_log_mean(each.sum(axis=2)), single) - np.log(2)


def _log_foundation(g: FloatArray, h: FloatArray, sensitivities: FloatArray) -> FloatArray:
    """(K,) log likelihood ratio of a change of stiffness."""
    gradient = g @ sensitivities  # G, (K, 3)
    squared = (sensitivities[:, :, None] * sensitivities[:, None, :]).reshape(-1, 9)
    hessian = (h @ squared).reshape(-1, 3, 3)  # H, (K, 3, 3)
    squares = STIFFNESS_SHIFTS[:, None, None, None] ** 2
    inner = hessian + np.eye(3) / squares  # (n_τ, K, 3, 3)
    solved = np.linalg.solve(inner, np.broadcast_to(gradient[:, :, None], (*inner.shape[:3], 1)))
    logs = 0.5 * (gradient * solved[..., 0]).sum(axis=2)
    logs -= 0.5 * np.linalg.slogdet(np.eye(3) + squares * hessian)[1]
    return _log_mean(logs)


def _stiffness_step(
    g: FloatArray, h: FloatArray, sensitivities: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """κ, (3,), and its covariance, (3, 3), from one candidate's steps, (J,).

    Iterated least squares with the weights of Student's t: one mode that jumped to its sister
    must not be read as a stiffness.
    """
    weights = np.ones(len(g))
    prior = np.eye(3) / STIFFNESS_SHIFTS[-1] ** 2
    for _ in range(STEPS):
        hessian = (sensitivities.T * (weights * h)) @ sensitivities + prior
        ratios = np.linalg.solve(hessian, sensitivities.T @ (weights * g))
        residuals = g - h * (sensitivities @ ratios)
        squares = np.divide(residuals**2, h, out=np.zeros_like(h), where=h > 0)
        weights = 5 / (4 + squares)  # ν = 4
    return ratios, np.linalg.inv(hessian)


def _log_sum(logs: FloatArray) -> FloatArray:
    """log Σ exp over the first axis; ten times faster than SciPy's on arrays this small."""
    highest = logs.max(axis=0)
    return np.asarray(highest + np.log(np.exp(logs - highest).sum(axis=0)))


def _log_mean(logs: FloatArray) -> FloatArray:
    """log of the mean over the first axis."""
    return _log_sum(logs) - np.log(len(logs))
