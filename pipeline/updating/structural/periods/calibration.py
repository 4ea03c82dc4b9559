"""What a first period of measurements reports of the structure's figures.

Windows are put together by the water's level: between them the springs and the figures are the
same, and how each mode follows the tide separates what a single level leaves together. All levels
are fitted at once (`periods`), about the peak of the ordinary joint fit, for every alternative of
the structure that has not lost.

Later sessions begin with the figures' share of this posterior, the sensors' figures included. The
springs are left out, since the foundation may change, and so is the gauge's error.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import ModeEvidence
from pipeline.updating.evidence.observations import SeenWindow
from pipeline.updating.prior import UpdatingError
from pipeline.updating.structural.alternatives import FittedAlternative, JointResult
from pipeline.updating.structural.periods.joint_periods import CommonFit, Period, common_fit
from pipeline.updating.structural.prior import N_SPRINGS, GaussianBelief, JointCoordinates
from sensors.arrays import FloatArray, IndexArray
from sensors.structure.calibration import AlternativeFigures, Calibration
from sensors.structure.foundation import positive_definite

BETWEEN_LEVELS = 0.5  # of the water between two periods, about [m]
MOST_LEVELS = 9
FEWEST_OF_A_LEVEL = 3  # of a level
CALIBRATION_ROUNDS = 6  # of relinearising
COMMON_FLOORS = 4.0  # of what all levels have in common: later sessions have the same floors,
# and what these limit must not count twice; chosen on seeds below 22000 [-]
LEAST_KEPT_WEIGHT = 0.01  # of an alternative that is kept [-]
LARGEST_DESIGN_STD = 1.0  # [-]
DESIGN_DRAWS = 4000
UNSEPARATED = 0.7  # std of a direction of figures, of that before: above, no data report it [-]
LEAST_MOVE = 0.003  # of ln k by one standard deviation of a direction, to be worth a word [-]
LARGE_PART = 0.35  # of a direction's unit vector, for a figure to be named with it [-]


@dataclass(frozen=True, slots=True)
class DesignSprings:
    """What a foundation's design says of its springs."""

    stiffness: tuple[float, float, float]
    """k11 [N/m], k22 [N·m/rad], k12 [N/rad]"""
    std: float
    """Of each one's logarithm, independent [-]."""

    def __post_init__(self) -> None:
        k11, k22, k12 = self.stiffness
        if not (k11 > 0 and k22 > 0 and k11 * k22 > k12**2 > 0):
            raise UpdatingError(
                f"design springs {k11:g} N/m, {k22:g} N·m/rad, {k12:g} N/rad are not positive "
                "definite, or not coupled"
            )
        if not 0 < self.std <= LARGEST_DESIGN_STD:
            raise UpdatingError(
                f"the design springs' standard deviation is {self.std:g}; a share up to "
                f"{LARGEST_DESIGN_STD:g} is needed"
            )

    def belief(self, coordinates: JointCoordinates) -> GaussianBelief:
        """As one Gaussian of the springs' coordinates."""
        generator = np.random.default_rng(0)
        ratios = np.abs(np.array(self.stiffness) / coordinates.nominal)
        drawn = ratios * np.exp(self.std * generator.standard_normal((DESIGN_DRAWS, 3)))
        drawn = drawn[positive_definite(drawn * coordinates.nominal)]
        u = coordinates.of_ratios(drawn)
        return GaussianBelief(
            coordinates.names[:N_SPRINGS],
            u.mean(axis=0),
            np.asarray(np.linalg.inv(np.cov(u, rowvar=False))),
        )


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedAlternative:
    """One alternative's fit to all water levels."""

    name: str
    weight: float
    """[-]"""
    coordinates: JointCoordinates
    fit: CommonFit

    @property
    def places(self) -> IndexArray:
        """(n,) of the figures in u: neither springs nor the level."""
        level = N_SPRINGS + len(self.coordinates.figures)
        places = np.arange(N_SPRINGS, self.coordinates.n_dim)
        return np.asarray(places[places != level])

    @property
    def names(self) -> tuple[str, ...]:
        """(n,) of the figures."""
        return tuple(self.coordinates.names[place] for place in self.places)

    @property
    def mean(self) -> FloatArray:
        """(n,) of the figures [prior standard deviations]."""
        return self.fit.x[self.places]

    @property
    def covariance(self) -> FloatArray:
        """(n, n) of the figures."""
        return self.fit.covariance[np.ix_(self.places, self.places)]

    @property
    def departures(self) -> tuple[FloatArray, FloatArray]:
        """(n,) medians in the prior standard deviations of each figure, and half the distance
        between the quantiles one standard deviation below and above: of a half-normal one too."""
        stds = np.sqrt(np.diag(self.covariance))
        low, middle, high = (self._in_prior_stds(self.mean + k * stds) for k in (-1, 0, 1))
        return middle, (high - low) / 2

    def _in_prior_stds(self, z: FloatArray) -> FloatArray:
        u = self.fit.x.copy()
        u[self.places] = z
        n = len(self.coordinates.figures)
        stds = np.array([figure.std for figure in self.coordinates.figures])
        return np.concatenate([self.coordinates.departures(u) / stds, z[n:]])

    @property
    def log_springs(self) -> tuple[FloatArray, FloatArray]:
        """ln (k / nominal), (3,), and their standard deviations, (3,)."""
        theta, slopes = self.coordinates.springs(self.fit.x), self._log_slopes
        covariance = self.fit.covariance[:N_SPRINGS, :N_SPRINGS]
        stds = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
        return np.log(theta / self.coordinates.nominal), stds

    @property
    def unseparated(self) -> tuple["UnseparatedFigures", ...]:
        """Directions of the figures that the data leave as they were and that move the springs,
        the one that moves them most first."""
        values, vectors = np.linalg.eigh(self.covariance)
        with_springs = self._log_slopes @ self.fit.covariance[:N_SPRINGS][:, self.places]
        found = []
        for value, vector in zip(values, vectors.T, strict=True):
            moved = with_springs @ vector / np.sqrt(value)
            large = np.flatnonzero(np.abs(vector) >= LARGE_PART)
            if value >= UNSEPARATED**2 and len(large) and np.abs(moved).max() >= LEAST_MOVE:
                sign = np.sign(vector[large[np.argmax(np.abs(vector[large]))]])
                parts = {self.names[i]: float(sign * vector[i]) for i in large}
                found.append(UnseparatedFigures(parts, tuple((sign * moved).tolist())))
        return tuple(sorted(found, key=lambda each: -max(map(abs, each.moved))))

    @property
    def _log_slopes(self) -> FloatArray:
        """∂ ln k / ∂u of the springs, (3, 3)."""
        theta = self.coordinates.springs(self.fit.x)
        slopes = self.coordinates.slopes(self.fit.x)[:N_SPRINGS, :N_SPRINGS]
        return np.asarray(slopes / theta[:, None])


@dataclass(frozen=True, slots=True)
class UnseparatedFigures:
    """Figures of which the data report only others' sums."""

    parts: Mapping[str, float]
    """Figure → its part in the direction, the largest positive."""
    moved: tuple[float, ...]
    """(3,) of ln k by one standard deviation of the direction [-]"""


def calibrated(
    result: JointResult, levels: Sequence[tuple[float, ModalEvidence]]
) -> tuple[CalibratedAlternative, ...]:
    """Fit springs and figures to all water levels, the likeliest alternative first.

    Parameters
    ----------
    result : JointResult
        Of the ordinary fit to all windows: where to start, and the weights.
    levels : sequence of (float, ModalEvidence)
        Rise above the model's level [m] and evidence of each (`evidence_by_level`).
    """
    found = [
        _calibrated(each, levels) for each in result.fitted if each.weight >= LEAST_KEPT_WEIGHT
    ]
    kept = [each for each in found if each is not None]
    total = sum(each.weight for each in kept)
    return tuple(replace(each, weight=each.weight / total) for each in kept)


def _calibrated(
    each: FittedAlternative, levels: Sequence[tuple[float, ModalEvidence]]
) -> CalibratedAlternative | None:
    coordinates = each.fit.coordinates
    everything = np.arange(coordinates.n_dim)
    fit = common_fit(
        each.fit,
        [Period(evidence, everything, rise) for rise, evidence in levels],
        each.peak.u,
        origin=coordinates.origin,
        precision=coordinates.prior_precision,
        tolerance=each.fit.tolerance,
        sigma=each.posterior.likeliest_sigma,
        common_floors=COMMON_FLOORS,
        rounds=CALIBRATION_ROUNDS,
    )
    if fit is None:
        return None
    return CalibratedAlternative(each.alternative.name, each.weight, coordinates, fit)


def calibration_of(
    found: Sequence[CalibratedAlternative],
    stds: Mapping[str, float],
    *,
    springs_sign: str,
    source: str,
) -> Calibration:
    """Calibrated alternatives as a description's section.

    Parameters
    ----------
    found : sequence of CalibratedAlternative
        The likeliest first.
    stds : mapping of str to float
        Of the figures' priors, by name.
    springs_sign : str
        Sign convention of k12.
    source : str
        What the calibration was made from.
    """
    names = found[0].names
    lower = np.tril_indices(len(names))
    return Calibration(
        springs_sign=springs_sign,
        names=names,
        stds=tuple(stds[name] for name in names),
        alternatives=tuple(
            AlternativeFigures(
                name=each.name,
                weight=each.weight,
                mean=tuple(each.mean.tolist()),
                covariance=tuple(each.covariance[lower].tolist()),
            )
            for each in found
        ),
        source=source,
    )


# ---- evidence by the water's level -------------------------------------------------------------


def evidence_by_level(
    windows: Sequence[SeenWindow], empty: ModalEvidence
) -> tuple[ModalEvidence, list[tuple[float, ModalEvidence]]]:
    """The evidence of all windows, and that of each water level with its rise [m].

    A mode has one track and one unit component at every level. A window whose level nothing
    reported is at none of them, unless nothing reported any.
    """
    known = [window for window in windows if window.level_known]
    unknown = not known
    known = known or list(windows)
    rises = np.array([window.rise for window in known])
    numbers = _level_numbers(rises)
    centres = [float(rises[numbers == k].mean()) for k in range(numbers.max() + 1)]
    places = iter(numbers.tolist())
    whole = empty
    modes: list[dict[int, ModeEvidence]] = [{} for _ in centres]
    for window in windows:
        whole = whole.with_window(window)
        if window.level_known or unknown:
            _add(modes[next(places)], window, whole)
    kept = {mode.track for mode in whole.modes}
    counts = np.bincount(numbers)
    levels = [
        (
            centre,
            replace(
                whole,
                n_windows=int(count),
                n_unknown_levels=int(count) * unknown,
                modes=_ordered(here, kept),
            ),
        )
        for centre, here, count in zip(centres, modes, counts, strict=True)
        if count >= min(FEWEST_OF_A_LEVEL, len(known))
    ]
    return whole, levels


def _level_numbers(rises: FloatArray) -> IndexArray:
    """(n_windows,) from 0, without a gap."""
    span = float(np.ptp(rises))
    n = int(np.clip(round(span / BETWEEN_LEVELS), 1, MOST_LEVELS))
    numbers = np.minimum((rises - rises.min()) / max(span, 1e-9) * n, n - 1).astype(int)
    return np.unique(numbers, return_inverse=True)[1]


def _add(here: dict[int, ModeEvidence], window: SeenWindow, whole: ModalEvidence) -> None:
    """One window's modes in a level's evidence, by the tracks that they have in the whole one.

    The quarter of a metre by which its water differs from the level's mean is left out: it cancels
    between the windows.
    """
    observations = {each.frequency: each for each in window.observations}
    for mode in whole.modes:
        if mode.last_window != whole.n_windows:
            continue
        observation = observations[mode.last_frequency]
        known = here.get(mode.track)
        if known is None:
            empty = ModeEvidence.empty(observation, mode.track)
            known = replace(empty, unit_component=mode.unit_component)
        here[mode.track] = known.with_observation(
            observation,
            window=whole.n_windows,
            weight=window.weight,
            joint_covariance=whole.joint_covariance,
        )


def _ordered(modes: Mapping[int, ModeEvidence], kept: set[int]) -> tuple[ModeEvidence, ...]:
    found = [mode for track, mode in modes.items() if track in kept]
    return tuple(sorted(found, key=lambda mode: mode.frequency))
