"""Likelihood of the combined modal estimates, Eqs. 9 and 10, with σ integrated out exactly.

    p(d̄ | θ, σ) ∝ det(Σ)^(−1/2) exp(−½ ηᵀ Σ⁻¹ η),   Σ = σ² R + Σ_D
    η = (f(θ) − f̄, φ(θ) − φ̄),   R = diag(f̄², ‖φ̄‖²)

Source: [foundation-updating] Eqs. 9, 10. Eq. 9 prints ηᵀ Σ η where the inverse is meant: as
printed, the posterior of k equals the prior.

Four things differ from the paper, each because the intervals lie without it. The shape's unit
component is left out (its variance is zero). σ's discrepancy is one vector for all windows, so the
windows are combined before R is added (`evidence`). A systematic floor is added once, after they
are combined: the identification has a small persistent bias that more windows do not average out.
Discrepancy and floor are Student-t distributed over the modes: one mode that the identification
got wrong by 1 % must not drag the stiffness by 20 % (`error_distributions`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import ModeEvidence
from pipeline.updating.forward_model import ModesOfStiffness
from pipeline.updating.likelihood.error_distributions import (
    ErrorModel,
    GaussianErrors,
    StudentErrors,
)
from pipeline.updating.likelihood.pairing import Pairing
from pipeline.updating.prior import UpdatingError
from sensors.arrays import FloatArray
from sensors.settings import NO_KEY

SMALLEST_SIGMA_STEP = 2e-4  # where σ's grid turns from even to geometric steps [-]


MOST_MERGED = 0.005  # relative distance of two modes that the identification takes for one pair:
# `ALIKE` of its coincident modes, which above .5 Hz is more than a window resolves


@dataclass(frozen=True, slots=True)
class LikelihoodSettings:
    """What is counted as error beside the identification's own standard deviations."""

    frequency_floor: float = 0.0005
    """Systematic error of a frequency, as a share of it [-]."""
    shape_floor: float = 0.005
    """Systematic error of a shape's component, as a share of the largest [-]."""
    resolution: ClassVar[float] = 1.5
    """Model modes nearer than this many 1/T cannot be distinguished [-]."""

    shape_mixing: ClassVar[float] = 0.012
    """Model modes of like shape nearer than this share of f mix their shapes [-]."""

    unlike_mixing: ClassVar[float] = 0.004
    """The same of modes whose shapes the sensors tell apart [-]: of 18 towers identified from time
    histories (tests.outside, seeds 17100 to 17117) such shapes were as good as others from .4 %
    on, χ² a component 1.1 in the mean, and twice as bad below."""

    mixing_mac: ClassVar[float] = 0.5
    """Least MAC of a neighbour of like shape [-]."""

    least_mac: ClassVar[float] = 0.95
    """With the partner's shape; below, only the frequency is compared [-]."""

    joint_covariance: bool = False
    """Whether the correlations between the components of one mode are kept."""
    sigma_points: int = field(default=60, metadata=NO_KEY)
    """Of the grid over which σ is integrated."""
    tails: Literal["gaussian", "student-t"] = "student-t"
    """Distribution of each mode's discrepancy."""
    degrees_of_freedom: ClassVar[float] = 4.0
    """Of Student's t; fewer forgive an outlying mode more."""
    modes: tuple[str, ...] = ()
    """Labels of the model's modes that are compared; empty: all of them."""

    def __post_init__(self) -> None:
        smallest = min(self.frequency_floor, self.shape_floor)
        if not smallest >= 0:
            raise UpdatingError(f"likelihood settings must not be negative; one is {smallest}")
        if self.sigma_points < 20:
            raise UpdatingError(f"sigma_points is {self.sigma_points}; at least 20 are needed")
        if self.tails == "student-t" and self.joint_covariance:
            raise UpdatingError(
                "tails are 'student-t' and joint_covariance is true; heavy tails are a mode's own "
                "and need its components apart: joint_covariance = false"
            )


@dataclass(frozen=True, slots=True)
class ModeComparison:
    """How one identified mode enters: which model modes it is compared with, and in what."""

    identified: int
    """Index in ModalEvidence.modes."""
    model_modes: tuple[int, ...]
    """Their mean frequency is compared; two for a close pair."""
    shape_used: bool
    gap: float
    """[Hz], added to the standard deviation of f: the neighbour it may be mixed with."""
    shape_unlike: bool = False
    """Left out although no neighbour is near enough to be mixed with."""


def observations(
    evidence: ModalEvidence,
    pairing: Pairing,
    model_frequencies: FloatArray,
    settings: LikelihoodSettings,
    *,
    mac: FloatArray | None = None,
) -> tuple[ModeComparison, ...]:
    """One observation a paired mode.

    Parameters
    ----------
    evidence : ModalEvidence
        With the identified modes.
    pairing : Pairing
        Of these with modes of the model.
    model_frequencies : ndarray, shape (n_model,)
        Of all visible modes at the pairing's stiffness [Hz].
    settings : LikelihoodSettings
        With the resolution in 1/T.
    mac : ndarray, shape (n_identified, n_model), optional
        At the pairing's stiffness [-]; None: every shape is taken as it is, and every neighbour's
        for a like one.

    Notes
    -----
    A window of duration T does not resolve modes nearer than about 1/T: what was identified may be
    either of them or a mixture. Then only the frequency is used, with the gap as a further standard
    deviation; a close pair that the identification itself declared is compared by its mean with the
    mean of the two. Somewhat wider, frequencies are resolved while shapes still mix, sometimes and
    by their excitation, farther where the sensors hardly tell the two apart: a shape that is a
    mixture differs from the model's by a hundred of its standard deviations, and one such shape
    would be bought off by a σ that blurs all the others.
    """
    resolved = settings.resolution / evidence.window_duration
    gaps = np.abs(model_frequencies[:, None] - model_frequencies)
    np.fill_diagonal(gaps, np.inf)
    gaps[np.isnan(gaps)] = np.inf
    nearest = gaps.argmin(axis=1)
    found = []
    for identified, model in enumerate(pairing.model_modes):
        if model < 0:
            continue
        neighbour = int(nearest[model])
        gap = float(gaps[model, neighbour])
        if evidence.modes[identified].close_pair:
            merged = max(resolved, MOST_MERGED * float(model_frequencies[model]))
            both = (model, neighbour) if gap < merged else (model,)
            found.append(ModeComparison(identified, both, shape_used=False, gap=0.0))
        elif gap < resolved:
            found.append(ModeComparison(identified, (model,), shape_used=False, gap=gap))
        else:
            own = None if mac is None else mac[identified]
            separate = _stands_apart(gaps[model] / model_frequencies[model], own, settings)
            alike = own is None or bool(own[model] >= settings.least_mac)
            found.append(
                ModeComparison(
                    identified,
                    (model,),
                    shape_used=separate and alike,
                    gap=0.0,
                    shape_unlike=separate and not alike,
                )
            )
    return tuple(found)


def _stands_apart(gaps: FloatArray, mac: FloatArray | None, settings: LikelihoodSettings) -> bool:
    """Whether no neighbour is near enough to mix its shape into that of a mode.

    gaps   (n_model,) to the model's other modes, relative; infinite to itself [-]
    mac    (n_model,) of the identified shape with theirs [-]; None: all may be alike
    """
    alike = True if mac is None else mac >= settings.mixing_mac
    return bool((gaps >= np.where(alike, settings.shape_mixing, settings.unlike_mixing)).all())


def sigma_grid(highest: float, n_points: int) -> tuple[FloatArray, FloatArray]:
    """Nodes of σ in [0, highest] and their trapezoid weights, (n_points,) each.

    Parameters
    ----------
    highest : float
        Of σ [-].
    n_points : int
        How many nodes.

    Notes
    -----
    Even steps near zero, geometric ones above, so that a narrow posterior of σ is resolved
    wherever it lies. The weights carry the uniform prior 1 / highest.
    """
    steps = np.linspace(0.0, np.arcsinh(highest / SMALLEST_SIGMA_STEP), n_points)
    sigma = SMALLEST_SIGMA_STEP * np.sinh(steps)
    sigma[-1] = highest
    widths = np.diff(sigma)
    weights = np.zeros(n_points)
    weights[:-1] += widths / 2
    weights[1:] += widths / 2
    return sigma, weights / highest


class ModalLikelihood:
    """Likelihood of the paired modes for many θ at once, σ on a grid.

    A whole grid of σ costs one matrix product (`error_distributions`), so σ can be integrated out
    for every θ. A chain then walks over three nearly Gaussian dimensions instead of a funnel of
    four.
    """

    def __init__(
        self,
        evidence: ModalEvidence,
        used: Sequence[ModeComparison],
        *,
        model_columns: Sequence[int],
        settings: LikelihoodSettings,
        highest_sigma: float,
    ) -> None:
        """model_columns: index of each mode that the forward model will give, in its order."""
        column = {mode: number for number, mode in enumerate(model_columns)}
        modes = [evidence.modes[each.identified] for each in used]
        self._averaging = _averaging(used, column)
        self._components = [
            _components(mode, each.shape_used) for mode, each in zip(modes, used, strict=True)
        ]
        self._shape_columns = np.array([column[each.model_modes[0]] for each in used])
        self._units = np.array([mode.unit_component for mode in modes])
        self._means = np.concatenate(
            [mode.mean[rows] for mode, rows in zip(modes, self._components, strict=True)]
        )
        covariances = [
            _measurement_covariance(mode, rows, each.gap, settings)
            for mode, rows, each in zip(modes, self._components, used, strict=True)
        ]
        self.measurement_covariance: FloatArray = block_diag(*covariances)  # Σ_D, (p, p)
        self.reference: FloatArray = np.concatenate(  # diagonal of R, (p,)
            [_reference(mode, rows) for mode, rows in zip(modes, self._components, strict=True)]
        )
        self.sigma, self._weights = sigma_grid(highest_sigma, settings.sigma_points)
        self._errors = self._error_model(modes, settings)

    def _error_model(
        self, modes: Sequence[ModeEvidence], settings: LikelihoodSettings
    ) -> ErrorModel:
        if settings.tails == "gaussian":
            return GaussianErrors(self.measurement_covariance, self.reference, self.sigma)
        lengths = [len(rows) for rows in self._components]
        combined = [
            np.diag(mode.covariance)[rows]
            for mode, rows in zip(modes, self._components, strict=True)
        ]
        return StudentErrors(
            variances=np.concatenate(combined),
            floors=np.diag(self.measurement_covariance) - np.concatenate(combined),
            reference=self.reference,
            sigma=self.sigma,
            groups=_frequency_and_shape_groups(lengths),
            degrees=settings.degrees_of_freedom,
        )

    @property
    def frequency_components(self) -> NDArray[np.intp]:
        """(n_observations,) positions of the frequencies in η."""
        lengths = [len(rows) for rows in self._components]
        return np.concatenate([[0], np.cumsum(lengths)[:-1]]).astype(np.intp)

    def errors(self, modes: ModesOfStiffness) -> FloatArray:
        """η, (n, p): model minus combined estimate [Hz, -]; NaN where not admissible."""
        frequencies = modes.frequencies @ self._averaging.T
        shapes = modes.shapes[:, self._shape_columns]
        units = np.take_along_axis(shapes, self._units[None, :, None], axis=2)
        with np.errstate(divide="ignore", invalid="ignore"):
            shapes = shapes / units
        rows = np.concatenate([frequencies[:, :, None], shapes], axis=2)
        parts = [rows[:, number, which] for number, which in enumerate(self._components)]
        return np.concatenate(parts, axis=1) - self._means

    def whitened(self, modes: ModesOfStiffness) -> FloatArray:
        """η̃, (n, p): of unit variance at σ = 0."""
        return self._errors.whitened(self.errors(modes))

    def log_likelihood(self, modes: ModesOfStiffness) -> FloatArray:
        """(n, n_sigma) log p(d̄ | θ, σ) on the grid of σ, constant dropped; −inf for NaN."""
        values = self._errors.log_density(self.whitened(modes) ** 2)
        return np.where(np.isfinite(values), values, -np.inf)

    def marginal(
        self, modes: ModesOfStiffness, generator: np.random.Generator
    ) -> tuple[FloatArray, FloatArray]:
        """log ∫ p(d̄ | θ, σ) p(σ) dσ, (n,), and for each θ one σ drawn from p(σ | θ, d̄), (n,)."""
        values = self.log_likelihood(modes)
        highest = values.max(axis=1)
        highest[~np.isfinite(highest)] = 0.0
        density = np.exp(values - highest[:, None])
        with np.errstate(divide="ignore"):  # log(0) = −inf is meant
            marginal = highest + np.log(density @ self._weights)
        return marginal, self._drawn(density, generator)

    def weights(self, squares: FloatArray) -> FloatArray:
        """(p,) precision of each whitened error at the likeliest σ, given their squares, (p,).

        1 at σ = 0; an outlier's is smaller where tails are heavy.
        """
        return self._errors.weights(squares)

    def _drawn(self, density: FloatArray, generator: np.random.Generator) -> FloatArray:
        """One σ a row of (n, n_sigma) by inversion of the distribution, linear between nodes."""
        uniform = generator.random(len(density))
        masses = (density[:, 1:] + density[:, :-1]) / 2 * np.diff(self.sigma)
        cumulated = np.cumsum(masses, axis=1)
        wanted = uniform * cumulated[:, -1]
        cell = np.minimum((cumulated < wanted[:, None]).sum(axis=1), masses.shape[1] - 1)
        row = np.arange(len(cell))
        beyond = wanted - (cumulated[row, cell] - masses[row, cell])
        share = np.divide(
            beyond, masses[row, cell], out=np.zeros_like(beyond), where=masses[row, cell] > 0
        )
        return self.sigma[cell] + share * (self.sigma[cell + 1] - self.sigma[cell])


def _averaging(used: Sequence[ModeComparison], column: dict[int, int]) -> FloatArray:
    """(n_observations, n_model) that turns model frequencies into the compared ones."""
    averaging = np.zeros((len(used), len(column)))
    for number, each in enumerate(used):
        for mode in each.model_modes:
            averaging[number, column[mode]] = 1 / len(each.model_modes)
    return averaging


def _components(mode: ModeEvidence, shape_used: bool) -> NDArray[np.intp]:
    """Rows of (f, φ) that are compared: f, and where wanted what is known of the shape."""
    known = np.flatnonzero(mode.known)
    return known if shape_used else known[known == 0]


def _measurement_covariance(
    mode: ModeEvidence, rows: NDArray[np.intp], gap: float, settings: LikelihoodSettings
) -> FloatArray:
    """Block of Σ_D: the combined estimate's covariance, the floor and the neighbour's gap."""
    covariance = mode.covariance[np.ix_(rows, rows)]
    floor = np.full(len(rows), settings.shape_floor**2)
    floor[0] = (settings.frequency_floor * mode.frequency) ** 2 + gap**2
    return covariance + np.diag(floor)


def _reference(mode: ModeEvidence, rows: NDArray[np.intp]) -> FloatArray:
    """Diagonal block of R: f̄² and ‖φ̄‖² (Eq. 10). Fixed numbers: σ multiplies nothing that
    depends on θ."""
    reference = np.full(len(rows), float(np.nansum(mode.shape**2)))
    reference[0] = mode.frequency**2
    return reference


def _frequency_and_shape_groups(lengths: Sequence[int]) -> NDArray[np.intp]:
    """(p,) number of the group that each component belongs to: a mode's frequency, its shape."""
    first = np.concatenate([np.arange(length) == 0 for length in lengths])
    second = np.concatenate([np.arange(length) == 1 for length in lengths])
    return np.cumsum(first | second) - 1
