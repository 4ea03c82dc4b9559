"""Both kinds of change together: when to raise the alarm, what to call it, where to start again."""

from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.updating.change.classification import ChangeKind, foundation_probability, kind_of
from pipeline.updating.change.level_from_modes import LastLevel, with_level_from_modes
from pipeline.updating.change.likelihood_ratios import (
    StiffnessStep,
    log_drift,
    log_foundation,
    log_sum,
    stiffness_step,
)
from pipeline.updating.change.random_walk import WalkState, kalman_step
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import (
    UNCUT_MOMENTS,
    ChangeSums,
    Regression,
    Sensitivities,
    WatchedWindow,
    before,
    seen_in,
    since,
    steps,
    with_tracks_of,
    with_window,
)
from sensors.arrays import FloatArray

SECONDS_PER_YEAR = 365.25 * 86400.0


@dataclass(frozen=True, slots=True, eq=False)
class ChangeState:
    """What the detectors remember; O(1) in the number of windows."""

    sums: ChangeSums = field(default_factory=ChangeSums)
    walk: WalkState = field(default_factory=WalkState)
    last_level: LastLevel = field(default_factory=LastLevel)


@dataclass(frozen=True, slots=True, eq=False)
class Verdict:
    """What one window's look at the sums finds. R is in windows; shares of candidates included."""

    log_kinds: FloatArray
    """(2, K) log R of drift and foundation, each with its share beforehand."""
    log_threshold: float
    """Log A."""
    hazard: float
    """Changes expected a window."""

    @property
    def log_total(self) -> float:
        """log R of both kinds and all candidates."""
        return float(log_sum(self.log_kinds.ravel()))

    @property
    def alarm(self) -> bool:
        """Whether the evidence of a change is beyond its threshold."""
        return self.log_total >= self.log_threshold

    @property
    def probability(self) -> float:
        """That there was a change since the last one [-]."""
        odds = self.hazard * np.exp(min(self.log_total, 700.0))
        return float(odds / (1 + odds))


@dataclass(frozen=True, slots=True, eq=False)
class Change:
    """A change that was noticed: when, which kind, how large."""

    kind: ChangeKind
    foundation_probability: float
    """Given that there was a change [-]."""
    candidate: int
    """Index of the most probable start."""
    restart: int
    """Index of the first candidate that lies after the change almost surely."""
    earliest: int
    """Indices of the 5 % …"""
    latest: int
    """… and 95 % quantiles."""
    step: StiffnessStep
    """If it was the foundation."""
    rough: bool
    """Whether that is of a model whose description does not hold."""
    level_std: float
    """Of levels that followed from the modes; 0: they were reported [m]."""
    shifts: FloatArray
    """(J,) change of ln f; NaN for tracks not seen before and after."""
    shift_stds: FloatArray
    """(J,)."""
    log_frequencies: FloatArray
    """(J,) before it, at the model's water level and WIND_REFERENCE."""


class ChangeDetector:
    """Both detectors. Holds no state; ChangeState goes in and comes out."""

    def __init__(self, settings: ChangeSettings | None = None) -> None:
        self.settings = settings or ChangeSettings()

    def updated(
        self, state: ChangeState, window: WatchedWindow, sensitivities: Sensitivities | None = None
    ) -> ChangeState:
        """What is remembered after one more window.

        Parameters
        ----------
        state : ChangeState
            Of the windows before; returned as it is where the window saw nothing.
        window : WatchedWindow
            The next one.
        sensitivities : Sensitivities, optional
            Of the state's tracks; those of tracks seen for the first time are unknown.
        """
        if not window.seen:
            return state
        sums = with_tracks_of(state.sums, window)
        known = _padded(sensitivities, len(sums.tracks))
        observed = seen_in(sums, window)
        if window.level_std > 0:
            window = with_level_from_modes(window, sums, observed, known.water, state.last_level)
        walk = kalman_step(state.walk, sums, window, observed, apart_from_water(known, sums))
        most = self.settings.candidates
        sums = with_window(sums, window, observed, known.water, most_candidates=most)
        return ChangeState(sums, walk, LastLevel(window.water_level, window.start_ns))

    def verdict(
        self, state: ChangeState, sensitivities: Sensitivities, *, window_duration: float
    ) -> Verdict:
        """Whether there was a change. window_duration [s]"""
        sensitivities = apart_from_water(sensitivities, state.sums)
        found = steps(state.sums, sensitivities.water)
        kinds = np.array([log_drift(found), log_foundation(found, sensitivities.stiffness)])
        share = self.settings.foundation_share
        shares = np.log([[1 - share], [share]]) + np.log(state.sums.shares)
        a_year = SECONDS_PER_YEAR / window_duration
        return Verdict(
            log_kinds=shares + kinds,
            log_threshold=float(np.log(self.settings.years_between_false_alarms * a_year)),
            hazard=self.settings.changes_per_year / a_year,
        )

    def change(self, state: ChangeState, verdict: Verdict, sensitivities: Sensitivities) -> Change:
        """The change behind an alarm, measured on the frequencies as they were."""
        sums = state.sums
        logs = log_sum(verdict.log_kinds)
        chances = np.exp(logs - log_sum(logs))
        candidate = int(np.argmax(chances))
        earliest, latest = np.searchsorted(np.cumsum(chances), [0.05, 0.95])
        latest = min(int(latest), len(chances) - 1)
        step = steps(sums, sensitivities.water, UNCUT_MOMENTS).of(candidate)
        line = Regression.of(before(sums, candidate), sensitivities.water)
        probability = foundation_probability(step, sensitivities, self.settings)
        known = np.where(step.h[0] > 0, step.h[0], np.nan)
        return Change(
            kind=kind_of(probability, self.settings),
            foundation_probability=probability,
            candidate=candidate,
            restart=max(candidate, latest),
            earliest=min(int(earliest), candidate),
            latest=latest,
            step=stiffness_step(step, sensitivities),
            rough=sensitivities.rough,
            level_std=sensitivities.level_std,
            shifts=step.g[0] / known,
            shift_stds=1 / np.sqrt(known),
            log_frequencies=sums.reference + line.coefficients[0],
        )

    def remeasured(self, state: ChangeState, found: Change, sensitivities: Sensitivities) -> Change:
        """The change with its size by other sensitivities, such as those half way through it."""
        step = steps(state.sums, sensitivities.water, UNCUT_MOMENTS).of(found.candidate)
        sensitivities = replace(sensitivities, rough=found.rough, level_std=found.level_std)
        return replace(found, step=stiffness_step(step, sensitivities))

    def restarted(self, state: ChangeState, candidate: int) -> ChangeState:
        """That candidate's windows as all there is: what was before is forgotten."""
        return ChangeState(since(state.sums, candidate), WalkState(), state.last_level)


def _padded(sensitivities: Sensitivities | None, n_tracks: int) -> Sensitivities:
    """With rows of zeros for the tracks that it does not know yet."""
    if sensitivities is None:
        return Sensitivities.unknown(n_tracks)
    missing = n_tracks - len(sensitivities.stiffness)
    if not missing:
        return sensitivities
    return replace(
        sensitivities,
        stiffness=np.pad(sensitivities.stiffness, ((0, missing), (0, 0))),
        water=np.pad(sensitivities.water, ((0, missing), (0, 0))),
    )


def apart_from_water(known: Sensitivities, sums: ChangeSums) -> Sensitivities:
    """The sensitivities without what a level that follows from the modes takes of a change.

    Parameters
    ----------
    known : Sensitivities
        Returned as they are where the level is reported.
    sums : ChangeSums
        Of the same tracks.

    Notes
    -----
    What a change of the springs has in common with a rise of the water goes into the level as well
    (`level_from_modes`), so that only the rest of it can be seen: S loses what it shares with a,

        S − a (aᵀ H a + s⁻²)⁻¹ aᵀ H S,   H the information on each track's frequency.
    """
    if known.level_std == 0.0:
        return known
    slope = known.water[:, 0]
    pull = slope * sums.totals[0]
    shared = pull @ known.stiffness / (pull @ slope + known.level_std**-2)
    return replace(known, stiffness=known.stiffness - np.outer(slope, shared))
