"""The joint prior of springs and figures, in coordinates in which it is normal.

    u = (ln k11/k11⁰, ln k22/k22⁰, logit c², z_1 … z_q, z_level, z_sensors),   c² = k12² / (k11 k22)

The springs' prior is wide (`SPRING_STDS`) and every u is positive definite. A figure is the
quantile of its prior at Φ(z): a Gaussian copula, whatever its own distribution.
"""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.special import expit, logit, ndtr, ndtri

from sensors.arrays import FloatArray
from sensors.structure.figures import (
    BY_NAME,
    KNOWN_LEVEL_STD,
    LEVEL,
    TIDE_STD,
    UNKNOWN_LEVEL_STD,
    Figure,
)

N_SPRINGS = 3
SPRING_STDS = np.array([1.0, 1.0, 2.0])  # of a normal prior so wide that it only bounds what no
# mode reports: a posterior of 10 % moves by 1 % of its distance from nominal [-]
PRIOR_DRAWS = 20_000  # for the interval of a spring beforehand: to one per cent of it
LEAST_LEFT = 0.1  # of a described mass or stiffness that is left of it [-]
FARTHEST_FIGURE = 6.0  # |z| to which a figure is followed [-]


@dataclass(frozen=True, slots=True)
class UncertainFigure:
    """A figure that is inferred."""

    name: str
    std: float
    """Of its prior, in the figure's unit; the scale of a half-normal one."""

    @property
    def definition(self) -> Figure:
        """The figure that it is the prior of."""
        return BY_NAME[self.name]

    @property
    def half_normal(self) -> bool:
        """Whether it can only be more than nominal."""
        return self.definition.distribution == "half-normal"


@dataclass(frozen=True, slots=True)
class StructuralPrior:
    """Which figures are uncertain, and by how much."""

    figures: tuple[UncertainFigure, ...]
    known_level_std: float = KNOWN_LEVEL_STD
    """Of the water level where SCADA reports it [m]."""
    unknown_level_std: float = UNKNOWN_LEVEL_STD
    """Of the level where nothing reports it [m]."""
    tide_std: float = TIDE_STD
    """Of a level that nothing reports, from window to window [m]."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the figures, the level not counted."""
        return tuple(figure.name for figure in self.figures)


@dataclass(frozen=True, slots=True, eq=False)
class GaussianBelief:
    """What is known of some coordinates beyond the figures' own priors."""

    names: tuple[str, ...]
    """Of the coordinates."""
    mean: FloatArray
    """(n,)"""
    precision: FloatArray
    """(n, n)"""


@dataclass(frozen=True, slots=True, eq=False)
class JointPoint:
    """What a point u stands for."""

    theta: FloatArray
    """(3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]"""
    departures: FloatArray
    """(q,) of the figures, in their units"""
    level: float
    """Of the water above where the evidence has it [m]"""


class JointCoordinates:
    """u ↔ springs, figures and level of one turbine.

    Parameters
    ----------
    nominal : ndarray, shape (3,)
        Nominal springs [N/m, N·m/rad, N/rad].
    figures : sequence of UncertainFigure
        Of the structure.
    level_std : float
        Of the water level in the evidence [m]; 0 on land.
    sensor_names : sequence of str, optional
        Figures of the sensors (`sensor_figures`), after the level.
    belief : GaussianBelief, optional
        Gaussian of u from a calibration or a farm; None: the priors of the figures.
    """

    def __init__(
        self,
        nominal: FloatArray,
        figures: Sequence[UncertainFigure],
        level_std: float,
        *,
        sensor_names: Sequence[str] = (),
        belief: "GaussianBelief | None" = None,
    ) -> None:
        self.nominal = np.asarray(nominal, dtype=float)
        self.figures = tuple(figures)
        self.level_std = level_std
        self.sensor_names = tuple(sensor_names)
        self.belief = belief
        self._stds = np.array([figure.std for figure in figures])
        self._half = np.array([figure.half_normal for figure in figures], dtype=bool)
        shares = np.array([figure.definition.unit == "-" for figure in figures], dtype=bool)
        self._lowest = np.where(shares, LEAST_LEFT - 1, -np.inf)
        self._nominal_logit = float(logit(nominal[2] ** 2 / (nominal[0] * nominal[1])))

        self._level = N_SPRINGS + len(self.figures)
        origin = np.zeros(self.n_dim)
        origin[2] = self._nominal_logit
        precision = np.diag(np.concatenate([SPRING_STDS**-2, np.ones(self.n_dim - N_SPRINGS)]))
        if belief is not None:
            places = [self.names.index(name) for name in belief.names]
            origin[places] = belief.mean
            precision[np.ix_(places, places)] = belief.precision
        self.origin = origin
        """(n_dim,) the prior's mean: nominal springs, every figure at its prior's median"""
        self.prior_precision = precision
        """(n_dim, n_dim) about the origin"""

    @property
    def names(self) -> tuple[str, ...]:
        """(n_dim,) of the coordinates."""
        figures = (figure.name for figure in self.figures)
        return ("k11", "k22", "k12", *figures, LEVEL, *self.sensor_names)

    @property
    def n_dim(self) -> int:
        """Coordinates: springs, figures, σ and sensors' figures."""
        return N_SPRINGS + len(self.figures) + 1 + len(self.sensor_names)

    def with_level_std(self, level_std: float) -> "JointCoordinates":
        """The same with another uncertainty of the water's level [m]."""
        other = copy(self)
        other.level_std = level_std
        return other

    def with_belief(self, belief: "GaussianBelief | None") -> "JointCoordinates":
        """The same with another prior of some coordinates."""
        return JointCoordinates(
            self.nominal,
            self.figures,
            self.level_std,
            sensor_names=self.sensor_names,
            belief=belief,
        )

    def with_prior(self, place: int, mean: float, std: float) -> "JointCoordinates":
        """The same with another prior of one coordinate, apart from all others."""
        other = copy(self)
        other.origin, other.prior_precision = self.origin.copy(), self.prior_precision.copy()
        other.origin[place] = mean
        other.prior_precision[place], other.prior_precision[:, place] = 0.0, 0.0
        other.prior_precision[place, place] = std**-2
        return other

    def with_wider_figures(self, factor: float) -> "JointCoordinates":
        """The same with standard deviations of all figures that are so many times as large."""
        other = copy(self)
        scale = np.ones(self.n_dim)
        scale[N_SPRINGS : self._level] = factor
        other.prior_precision = self.prior_precision / np.outer(scale, scale)
        return other

    def prior_cost(self, u: FloatArray) -> float:
        """(u − u₀)ᵀ P (u − u₀)"""
        off = u - self.origin
        return float(off @ self.prior_precision @ off)

    def of_ratios(self, ratios: FloatArray) -> FloatArray:
        """(…, 3) the springs' coordinates of ratios to nominal, (…, 3)."""
        theta = ratios * self.nominal
        share = theta[..., 2] ** 2 / (theta[..., 0] * theta[..., 1])
        logs = np.log(ratios[..., :2])
        inside = np.clip(share, 1e-6, 1 - 1e-6)
        return np.concatenate([logs, logit(inside)[..., None]], axis=-1)

    def springs(self, u: FloatArray) -> FloatArray:
        """(…, 3) θ of points, (…, n_dim)."""
        k11 = self.nominal[0] * np.exp(u[..., 0])
        k22 = self.nominal[1] * np.exp(u[..., 1])
        k12 = np.sign(self.nominal[2]) * np.sqrt(expit(u[..., 2]) * k11 * k22)
        return np.stack([k11, k22, k12], axis=-1)

    def spring_intervals(self) -> FloatArray:
        """(3,) widths of 90 % intervals of ln k11, ln k22, ln |k12| beforehand [-]."""
        u = np.zeros((PRIOR_DRAWS, self.n_dim))
        covariance = np.linalg.inv(self.prior_precision)[:N_SPRINGS, :N_SPRINGS]
        normal = np.random.default_rng(0).standard_normal((PRIOR_DRAWS, N_SPRINGS))
        u[:, :N_SPRINGS] = self.origin[:N_SPRINGS] + normal @ np.linalg.cholesky(covariance).T
        low, high = np.quantile(np.log(self.springs(u) / self.nominal), [0.05, 0.95], axis=0)
        return np.asarray(high - low)

    def departures(self, u: FloatArray) -> FloatArray:
        """(…, q) of the figures."""
        z = u[..., N_SPRINGS : self._level]
        folded = ndtri((1 + ndtr(np.clip(z, -FARTHEST_FIGURE, FARTHEST_FIGURE))) / 2)
        return np.maximum(np.where(self._half, folded, z) * self._stds, self._lowest)

    def level(self, u: FloatArray) -> FloatArray:
        """(…) of the water above where the evidence has it [m]."""
        return np.asarray(u[..., self._level] * self.level_std)

    def point(self, u: FloatArray) -> JointPoint:
        """What one point stands for."""
        return JointPoint(self.springs(u), self.departures(u), float(self.level(u)))

    def sensors(self, u: FloatArray) -> FloatArray:
        """(…, r) of the sensors' figures, in their prior standard deviations."""
        return u[..., self._level + 1 :]

    def slopes(self, u: FloatArray) -> FloatArray:
        """∂(θ, departures, level)/∂u, (3 + q + 1, n_dim), at one point."""
        found = np.zeros((self._level + 1, self.n_dim))
        k11, k22, k12 = self.springs(u)
        found[0, 0], found[1, 1] = k11, k22
        found[2, :3] = k12 / 2 * np.array([1.0, 1.0, 1 - expit(u[2])])
        z = np.clip(u[N_SPRINGS : self._level], -FARTHEST_FIGURE, FARTHEST_FIGURE)
        folded = ndtri((1 + ndtr(z)) / 2)
        half = np.exp(-(z**2) / 2 + folded**2 / 2) / 2  # φ(z) / (2 φ(x))
        figures = np.arange(N_SPRINGS, self._level)
        inside = self.departures(u) > self._lowest
        found[figures, figures] = np.where(self._half, half, 1.0) * self._stds * inside
        found[self._level, self._level] = self.level_std
        return found

    def draws(self, n: int, generator: np.random.Generator, *, spread: float) -> FloatArray:
        """(n, n_dim) of the prior for a search, springs uniform in ±spread of their logarithms."""
        u = self.origin + np.zeros((n, self.n_dim))
        u[:, :2] += generator.uniform(-spread, spread, (n, 2))
        u[:, 2] += generator.uniform(-2.0, 2.0, n)
        n_figures = self._level + 1 - N_SPRINGS
        u[:, N_SPRINGS : self._level + 1] = generator.standard_normal((n, n_figures))
        return u
