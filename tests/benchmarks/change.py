"""Changes found and false alarms, on modal estimates drawn with the errors a recording has.

    python -m tests.benchmarks change [--rows shift drop tide quiet] [--windows 22617]
        [--trials 200] [--first-seed 1] [--keep]

Frequencies, their standard deviations and how often each mode is found come from the shipped
recording of the parked turbine; nothing is simulated or sampled. The threshold is the average time
between false alarms, nothing else is set:

    shift   144 windows, modes 1 to 5 together shift by .2 % in the middle; one false alarm in three
            years. The water moves every frequency by ±.5 %, and no model says so; the wind moves
            each by some thousandths of a percent a m/s, in every row
    drop    144 windows, 10 % of k22 gone in the middle, one false alarm in ten times 36 h; the
            model knows what the water does. When, how much, and how often the 90 % interval holds
            the stiffness of its window 4 to 12 h after
    tide    the same while all springs rise and fall by 2 % with a tide of ±1.5 m
    quiet   as `shift`, and nothing changes in five months

The interval is that of the linear Gaussian model, the one that the updater samples: the windows
since the last change combined, the systematic floor once, and the last window's deviation.
"""

import argparse
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from pipeline.messages import FoundationPosterior, ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.recording.reader import read_messages
from pipeline.updating.change.detector import Change, ChangeDetector, ChangeState, Verdict
from pipeline.updating.change.event_message import (
    TrackSensitivity,
    measured_half_way,
    sensitivities_of,
    stiffness_slopes,
)
from pipeline.updating.change.likelihood_ratios import StiffnessStep
from pipeline.updating.change.random_walk import deviation
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import (
    UNCUT_MOMENTS,
    SeenFrequency,
    WatchedWindow,
    reduced_moments,
)
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.prior import Prior
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep

WINDOW = 600.0  # [s]
TIDE = 12.42 * 3600.0  # [s]
WATER = 0.005  # of ln f at a level of 1 m [-]
STREAM = 144  # windows of a trial
MIDDLE = 72  # the first one after the change
LATER = range(MIDDLE + 24, MIDDLE + 72)  # windows 4 to 12 h after it
SOFTER = np.array([1.0, 0.9, 1.0])  # k / nominal after the drop [-]
WIND_SLOPE = 3e-5  # standard deviation over the modes of ∂ ln f / ∂ wind speed, as simulated [s/m]
WIND_STD = 5.0  # of the wind [m/s]
WIND_MEMORY = 0.98  # correlation of the wind from window to window: of a day or so [-]
HIGH_WATER = 1.5  # of the tide that the springs ride with [m]
RIDE = 0.02  # of k at high water [-]
QUANTILE = 1.6449  # of the standard normal distribution at 95 %
ROWS = ("shift", "drop", "tide", "quiet")
RECORDING = Path("recordings/parked.mcap")
LAYOUT = biaxial_layout(
    "tower-1", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """The modes as windows of ten minutes report them."""

    model: ModalModel
    labels: tuple[str, ...]
    stds: FloatArray  # (J,) relative, of one window
    presence: FloatArray  # (J,) share of the windows

    @property
    def columns(self) -> list[int]:
        """Of these modes among the model's."""
        return [self.model.labels.index(label) for label in self.labels]

    def log_frequencies(self, ratios: FloatArray) -> FloatArray:
        """(n, J) at (n, 3) ratios k / nominal."""
        found = self.model.modal(ratios * self.model.nominal).frequencies
        return np.log(found[:, self.columns])

    def pairs(self, ratios: FloatArray, *, water: bool) -> tuple[TrackSensitivity, ...]:
        """Which track is which mode, and its slopes at (3,) ratios; water: whether the model knows
        what the level does."""
        slopes = stiffness_slopes(self.model, Prior(self.model.nominal), ratios)[self.columns]
        curve = np.array([WATER if water else 0.0, 0.0])
        return tuple(
            TrackSensitivity(track, label, slope, curve)
            for track, (label, slope) in enumerate(zip(self.labels, slopes, strict=True))
        )


def watched_in_recording() -> Watched:
    """Identified and paired from the shipped recording."""
    node = IdentificationNode()
    answers = [
        a for m in read_messages(RECORDING) if isinstance(m, node.inputs) for a in node.handle(m)
    ]
    estimates = [each for each in answers if isinstance(each, ModalEstimate)]
    model = ModalModel(load_turbine("iea15mw_monopile"), LAYOUT)
    updater = FoundationUpdater(model, LAYOUT, seed=1)
    state = updater.initial_state()
    for estimate in estimates[:-1]:
        state = replace(state, evidence=state.evidence.with_estimate(estimate))
    state, posterior = updater.updated(state, estimates[-1])
    assert isinstance(posterior, FoundationPosterior)
    by_name = {mode.name: mode for mode in state.evidence.modes}
    pairs = [pair for pair in posterior.pairs if by_name[pair.identified].n_windows > 1]
    modes = [by_name[pair.identified] for pair in pairs]
    return Watched(
        model,
        tuple(pair.model for pair in pairs),
        stds=np.array([m.frequency_std / m.frequency * np.sqrt(m.n_windows) for m in modes]),
        presence=np.array([mode.n_windows for mode in modes]) / len(estimates),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Surroundings:
    """Tide and wind of a stream's windows, and what the wind does to the modes."""

    levels: FloatArray  # of the water [m], (n,)
    winds: FloatArray  # from the regression's reference [m/s], (n,)
    wind_slopes: FloatArray  # ∂ ln f / ∂ wind speed, (J,) [s/m]


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """What happens in the windows of a stream, one a row."""

    log_frequencies: FloatArray  # (n, J) at the model's water level, without wind
    around: Surroundings
    pairs: tuple[TrackSensitivity, ...]  # what the detectors are told of the modes
    truth: FloatArray | None = None  # k / nominal, (n, 3), where it is asked for
    softer: FloatArray | None = None  # ln f at SOFTER, (J,)
    softer_pairs: tuple[TrackSensitivity, ...] = ()  # with the slopes there


def surroundings(
    n: int, n_modes: int, generator: np.random.Generator, *, high_water: float = 1.0
) -> Surroundings:
    """A tide of that height at the windows' mid-times, and a wind that wanders for days."""
    times = (np.arange(n) + 0.5) * WINDOW
    tide = high_water * np.sin(2 * np.pi * (times / TIDE + generator.random()))
    gusts = generator.standard_normal(n) * WIND_STD * np.sqrt(1 - WIND_MEMORY**2)
    gusts[0] = WIND_STD * generator.standard_normal()
    winds = lfilter([1.0], [1.0, -WIND_MEMORY], gusts)
    return Surroundings(tide, winds, WIND_SLOPE * generator.standard_normal(n_modes))


def still(modes: Watched, n: int, generator: np.random.Generator) -> Case:
    """Nothing moves but what water and wind do."""
    logs = np.tile(modes.log_frequencies(np.ones((1, 3))), (n, 1))
    around = surroundings(n, len(modes.labels), generator)
    return Case(logs, around, modes.pairs(np.ones(3), water=False))


def shifted(modes: Watched, generator: np.random.Generator) -> Case:
    """Modes 1 to 5 shift by .2 % in the middle."""
    case = still(modes, STREAM, generator)
    case.log_frequencies[MIDDLE:, np.isin(modes.labels, ["1", "2", "3", "4", "5"])] += 0.002
    return case


def softened(
    modes: Watched, generator: np.random.Generator, *, high_water: float, ride: float
) -> Case:
    """A tenth of k22 gone in the middle; beside it all springs ride with the tide."""
    around = surroundings(STREAM, len(modes.labels), generator, high_water=high_water)
    truth = np.where(np.arange(STREAM)[:, None] < MIDDLE, 1.0, SOFTER)
    truth = truth * (1 + ride * around.levels / high_water)[:, None]
    return Case(
        log_frequencies=modes.log_frequencies(truth),
        around=around,
        pairs=modes.pairs(np.ones(3), water=True),
        truth=truth,
        softer=modes.log_frequencies(SOFTER[None])[0],
        softer_pairs=modes.pairs(SOFTER, water=True),
    )


def window(
    number: int, modes: Watched, case: Case, generator: np.random.Generator
) -> WatchedWindow:
    """One window's drawn estimates."""
    level, wind = float(case.around.levels[number]), float(case.around.winds[number])
    found = np.flatnonzero(generator.random(len(modes.stds)) < modes.presence)
    errors = modes.stds[found] * generator.standard_normal(len(found))
    moved = WATER * level + case.around.wind_slopes[found] * wind
    logs = case.log_frequencies[number, found] + moved + errors
    seen = tuple(
        SeenFrequency(int(track), float(value), float(modes.stds[track]))
        for track, value in zip(found, logs, strict=True)
    )
    start = int(number * WINDOW * 1e9)
    return WatchedWindow(start, WINDOW, seen, water_level=level, wind=wind)


def looked(
    detector: ChangeDetector, state: ChangeState, drawn: WatchedWindow, case: Case
) -> tuple[ChangeState, Verdict]:
    """State and verdict after one more window."""
    tracks = state.sums.tracks
    known = sensitivities_of(tracks, case.pairs)
    state = detector.updated(state, drawn, known)
    if state.sums.tracks != tracks:
        known = sensitivities_of(state.sums.tracks, case.pairs)
    return state, detector.verdict(state, known, window_duration=WINDOW)


@dataclass(frozen=True, slots=True)
class Quiet:
    """What months without a change gave."""

    windows: int
    alarms: int
    largest: float
    """R over the threshold A, the largest [-]."""
    milliseconds: float
    """CPU time of a window [ms]."""

    def __str__(self) -> str:
        return (
            f"{self.alarms} alarms in {self.windows} windows, largest R / A {self.largest:.3f}, "
            f"{self.milliseconds:.2f} ms CPU a window"
        )

    @property
    def figures(self) -> dict[str, Any]:
        """For the result file."""
        return asdict(self)


def quiet(modes: Watched, n_windows: int, seed: int) -> Quiet:
    """Alarms in years without a change, the largest R / A, and CPU time a window."""
    detector, generator = ChangeDetector(), np.random.default_rng(seed)
    case, state = still(modes, n_windows, generator), ChangeState()
    alarms, highest, seconds = 0, -np.inf, 0.0
    for number in range(n_windows):
        drawn = window(number, modes, case, generator)
        begun = time.process_time()
        state, verdict = looked(detector, state, drawn, case)
        seconds += time.process_time() - begun
        highest = max(highest, verdict.log_total - verdict.log_threshold)
        if verdict.alarm:
            alarms += 1
            state = ChangeState()
    return Quiet(n_windows, alarms, float(np.exp(highest)), 1e3 * seconds / n_windows)


@dataclass(slots=True, eq=False)
class Outcome:
    """What some trials of one change gave."""

    trials: int
    delays: list[int] = field(default_factory=list)  # windows from the change to the alarm
    false: int = 0  # alarms before it
    later: int = 0  # further alarms after the first one
    kinds: Counter[str] = field(default_factory=Counter)
    sizes: list[StiffnessStep] = field(default_factory=list)
    sized: list[FloatArray] = field(default_factory=list)  # (3,) whether their interval holds it
    covered: list[FloatArray] = field(default_factory=list)  # (3,) of each window 4 to 12 h after

    def __str__(self) -> str:
        median, late = np.quantile(self.delays, [0.5, 0.95]) if self.delays else (np.nan, np.nan)
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(self.kinds.items()))
        text = (
            f"{len(self.delays)} of {self.trials} found, delay median {median:.0f} / 95 % "
            f"{late:.0f} windows, {self.false} false alarms before, {self.later} after; called "
            f"{kinds or 'nothing'}"
        )
        if self.sized:
            ratios = np.median([each.ratios for each in self.sizes], axis=0)
            sizes = " ".join(f"{each:+.1%}" for each in ratios)
            held = " ".join(f"{share:.2f}" for share in np.mean(self.sized, axis=0))
            text += f"; k11, k22, k12 by {sizes} in the median, held by its interval {held}"
        if self.covered:
            shares = np.mean(self.covered, axis=0)
            each = " ".join(f"{share:.3f}" for share in shares)
            text += f"; stiffness held 4 to 12 h after {each}, pooled {shares.mean():.3f}"
        return text

    @property
    def figures(self) -> dict[str, Any]:
        """For the result file."""
        found: dict[str, Any] = {
            "trials": self.trials,
            "found": len(self.delays),
            "false": self.false + self.later,
            "median_delay": float(np.median(self.delays)) if self.delays else None,
            "kinds": dict(self.kinds),
        }
        if self.sized:
            changes = 100 * np.median([each.ratios for each in self.sizes], axis=0)
            found["size_percent"] = changes.round(2).tolist()
            found["size_held"] = np.mean(self.sized, axis=0).round(3).tolist()
        if self.covered:
            found["held_after"] = np.mean(self.covered, axis=0).round(3).tolist()
        return found


def changes_found(
    modes: Watched,
    case_of: Callable[[np.random.Generator], Case],
    settings: ChangeSettings,
    trials: range,
) -> Outcome:
    """Trials of one change in the middle; case_of: with the tide and the wind that it draws."""
    outcome, detector = Outcome(len(trials)), ChangeDetector(settings)
    for trial in trials:
        generator = np.random.default_rng([20261121, trial])
        _one_trial(outcome, modes, case_of(generator), detector, generator)
    return outcome


def _one_trial(
    outcome: Outcome,
    modes: Watched,
    case: Case,
    detector: ChangeDetector,
    generator: np.random.Generator,
) -> None:
    state, found = ChangeState(), False
    for number in range(STREAM):
        drawn = window(number, modes, case, generator)
        state, verdict = looked(detector, state, drawn, case)
        if verdict.alarm:
            known = sensitivities_of(state.sums.tracks, case.pairs)
            change = detector.change(state, verdict, known)
            if number < MIDDLE:
                outcome.false += 1
            elif found:
                outcome.later += 1
            else:
                found = True
                outcome.delays.append(number - MIDDLE + 1)
                outcome.kinds[change.kind] += 1
                _size(outcome, modes, case, detector, state, change)
            state = detector.restarted(state, change.restart)
        if case.truth is not None and number in LATER:
            outcome.covered.append(_covered(state, case, number))


def _size(
    outcome: Outcome,
    modes: Watched,
    case: Case,
    detector: ChangeDetector,
    state: ChangeState,
    change: Change,
) -> None:
    """How large the event would say that the change was."""
    if case.truth is None:
        return
    prior, before = Prior(modes.model.nominal), np.ones(3)
    pairs = case.pairs
    step = measured_half_way(
        change, state, detector, modes.model, prior, before=before, pairs=pairs
    ).step
    stds = np.sqrt(np.diag(step.covariance))
    outcome.sizes.append(step)
    outcome.sized.append(np.abs(step.ratios - (SOFTER - 1)) < QUANTILE * stds)


def _covered(state: ChangeState, case: Case, number: int) -> FloatArray:
    """(3,) 1.0 where the 90 % interval of a spring holds its stiffness in that window.

    Least squares about SOFTER, where the sampled posterior of the whole model would be.
    """
    assert case.truth is not None
    assert case.softer is not None
    tracks, totals = list(state.sums.tracks), state.sums.totals
    known = sensitivities_of(state.sums.tracks, case.softer_pairs)
    n = np.maximum(totals[0], 1e-300)
    (moment,) = reduced_moments(totals, known.water, UNCUT_MOMENTS, 1)
    mean = state.sums.reference + moment / n
    moved = mean - case.softer[tracks]
    weight = 1 / (1 / n + LikelihoodSettings().frequency_floor ** 2)
    S = known.stiffness
    covariance = np.linalg.inv((S.T * weight) @ S + np.eye(3))
    now = deviation(state.walk)
    estimate = covariance @ S.T @ (weight * moved) + now.mean
    std = np.sqrt(np.diag(covariance + now.covariance))
    return np.asarray(np.abs(estimate - (case.truth[number] - SOFTER)) < QUANTILE * std, float)


def main(arguments: list[str]) -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(prog="change", description=__doc__)
    parser.add_argument("--rows", nargs="+", choices=ROWS, default=ROWS)
    parser.add_argument("--windows", type=int, default=22_617)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--keep", action="store_true", help="write the result")
    chosen = parser.parse_args(arguments)
    trials = range(chosen.first_seed, chosen.first_seed + chosen.trials)
    modes = watched_in_recording()
    print(
        f"{len(modes.labels)} modes, stds {modes.stds.min():.3%} to {modes.stds.max():.3%}, "
        f"median {np.median(modes.stds):.3%}",
        flush=True,
    )
    often = ChangeSettings(years_between_false_alarms=360 / 8766)
    drop = partial(softened, modes, high_water=1.0, ride=0.0)
    riding = partial(softened, modes, high_water=HIGH_WATER, ride=RIDE)
    shift = partial(shifted, modes)
    rows: dict[str, Callable[[], Outcome | Quiet]] = {
        "shift": lambda: changes_found(modes, shift, ChangeSettings(), trials),
        "drop": lambda: changes_found(modes, drop, often, trials),
        "tide": lambda: changes_found(modes, riding, often, trials),
        "quiet": lambda: quiet(modes, chosen.windows, chosen.first_seed),
    }
    found = {}
    for row in chosen.rows:
        found[row] = rows[row]()
        print(f"{row:6}", found[row], flush=True)
    if chosen.keep:
        keep(
            "change",
            {row: each.figures for row, each in found.items()},
            command="python -m tests.benchmarks change "
            f"--trials {chosen.trials} --first-seed {chosen.first_seed}",
            seeds=trials,
            depends=("pipeline/updating/change", "tests/benchmarks/change.py"),
        )
