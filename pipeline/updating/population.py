"""What a farm's other turbines imply of one that is not yet among them: a prior of its springs.

    p(x) = mean over draws s of  (1 − ε_s) N(x; μ_s, Σ_s) + ε_s N(x; μ_s, Σ_s + w² I)

in `SpringCoordinates`, each draw (μ, Σ, ε) one from the posterior of the farm that
`pipeline.farm` samples: how sure the farm is of its mean and spread, and that a new turbine
may be unlike the others, are in it. It is kept as a small JSON file.

Where the turbines' structure is uncertain, x are the springs as the nominal description reads them,
and the true ones are x + Lᵀ ξ: errors ξ ~ N(0, I) of the description, which the new turbine shares.
An inference that has the figures of its structure takes x + Lᵀ ξ as it is, so that what they share
is not counted twice; for an exact structure the errors widen the prior.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp

from pipeline.updating.prior import UpdatingError
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SpringCoordinates:
    """x = (ln k11/k11⁰, ln k22/k22⁰, atanh ρ − atanh ρ⁰),   ρ = k12 / √(k11 k22)

    with ⁰ the nominal foundation, at which x = 0. The third is Fisher's z of the coupling, which
    fills the line while |ρ| < 1. About the IEA 15 MW monopile (ρ⁰ = .755) one percent of k12 alone
    moves it by .018.

    Source: Fisher (1921), Metron 1, for z; k as in [foundation-updating] Eq. 12.
    """

    nominal: FloatArray
    """(3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]; none 0, positive definite."""

    @property
    def _nominal_coupling(self) -> float:
        """ρ⁰ [-]"""
        return float(self.nominal[2] / np.sqrt(self.nominal[0] * self.nominal[1]))

    def of_ratios(self, ratios: FloatArray) -> FloatArray:
        """(..., 3) coordinates [-] of (..., 3) ratios k / nominal [-], positive definite ones."""
        coupling = self._nominal_coupling
        rho = coupling * ratios[..., 2] / np.sqrt(ratios[..., 0] * ratios[..., 1])
        z = np.arctanh(rho) - np.arctanh(coupling)
        return np.stack([np.log(ratios[..., 0]), np.log(ratios[..., 1]), z], axis=-1)

    def to_ratios(self, points: FloatArray) -> FloatArray:
        """(..., 3) ratios k / nominal [-] of (..., 3) coordinates [-]."""
        coupling = self._nominal_coupling
        rho = np.tanh(points[..., 2] + np.arctanh(coupling))
        r11, r22 = np.exp(points[..., 0]), np.exp(points[..., 1])
        return np.stack([r11, r22, rho / coupling * np.sqrt(r11 * r22)], axis=-1)

    def steps(self, log_steps: FloatArray, ratios: FloatArray) -> FloatArray:
        """(..., 3) steps of x, to the first order, of steps of ln k, (..., 3), at ratios, (3,).

        d atanh ρ = ρ / (1 − ρ²) (d ln k12 − (d ln k11 + d ln k22) / 2)
        """
        rho = self._nominal_coupling * ratios[2] / np.sqrt(ratios[0] * ratios[1])
        coupled = log_steps[..., 2] - (log_steps[..., 0] + log_steps[..., 1]) / 2
        return np.stack(
            [log_steps[..., 0], log_steps[..., 1], rho / (1 - rho**2) * coupled], axis=-1
        )

    def log_jacobian(self, points: FloatArray) -> FloatArray:
        """(...,) log |∂r/∂x|: up to a constant, the density in x of a prior uniform in k.

        |∂r/∂x| = (r11 r22)^(3/2) (1 − ρ²) / |ρ⁰|
        """
        coupling = self._nominal_coupling
        z = points[..., 2] + np.arctanh(coupling)
        log_softness = np.log(4.0) - 2 * np.logaddexp(z, -z)  # log(1 − tanh² z), exact far out
        return 1.5 * (points[..., 0] + points[..., 1]) + log_softness - np.log(abs(coupling))


FORMAT = "pilewatch population 1"
SAME_NOMINAL = 1e-6  # relative difference of springs that are one and the same
CANDIDATES_AT_ONCE = 1000  # points evaluated at once


@dataclass(frozen=True, slots=True, eq=False)
class StiffnessPopulation:
    """The predictive prior of one more turbine of a farm."""

    turbines: tuple[str, ...]
    """That it was learned from."""
    nominal: FloatArray
    """(3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]: of all of them."""
    means: FloatArray
    """μ, (n_draws, 3)."""
    covariances: FloatArray
    """Σ, (n_draws, 3, 3)."""
    outlier_shares: FloatArray
    """ε, (n_draws,)."""
    outlier_std: float
    """w [-]."""
    figures: tuple[str, ...] = ()
    """Of the description, whose errors all turbines share."""
    common: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    """L, (n_figures, 3)."""

    @property
    def _wide(self) -> FloatArray:
        """(n_draws, 3, 3) Σ with the description's errors, independent of this turbine's."""
        return np.asarray(self.covariances + self.common.T @ self.common)

    @property
    def name(self) -> str:
        """For messages: "19 turbines, t1 … t19"."""
        first, last = self.turbines[0], self.turbines[-1]
        return f"{len(self.turbines)} turbines, {first} … {last}"

    @property
    def coordinates(self) -> SpringCoordinates:
        """In which it is a mixture of Gaussians."""
        return SpringCoordinates(self.nominal)

    @property
    def centre(self) -> FloatArray:
        """(3,) ratios k / nominal [-] about which the farm lies."""
        return self.coordinates.to_ratios(self.means.mean(axis=0))

    def log_density(self, ratios: FloatArray) -> FloatArray:
        """(n,) log p of (n, 3) ratios k / nominal, positive definite ones, with respect to dr."""
        points = self.coordinates.of_ratios(ratios)
        starts = range(0, len(points), CANDIDATES_AT_ONCE)
        in_x = [self._log_mixture(points[start : start + CANDIDATES_AT_ONCE]) for start in starts]
        return np.concatenate([np.empty(0), *in_x]) - self.coordinates.log_jacobian(points)

    def _log_mixture(self, points: FloatArray) -> FloatArray:
        offsets = points - self.means[:, None]
        covariances = self._wide
        wide = covariances + self.outlier_std**2 * np.eye(3)
        logs = np.stack(
            [
                log_gaussian(offsets, covariances[:, None])
                + np.log1p(-self.outlier_shares)[:, None],
                log_gaussian(offsets, wide[:, None]) + np.log(self.outlier_shares)[:, None],
            ]
        )
        return np.asarray(logsumexp(logs, axis=(0, 1)) - np.log(len(self.means)))

    def draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3) ratios k / nominal."""
        return self._drawn(n, generator, self._wide)

    def as_described(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3) ratios k / nominal as the nominal description reads them, without its errors."""
        return self._drawn(n, generator, self.covariances)

    def _drawn(self, n: int, generator: np.random.Generator, covariances: FloatArray) -> FloatArray:
        chosen = generator.integers(len(self.means), size=n)
        outlying = generator.random(n) < self.outlier_shares[chosen]
        wide = outlying[:, None, None] * self.outlier_std**2 * np.eye(3)
        factors = np.linalg.cholesky(covariances[chosen] + wide)
        normal = generator.standard_normal((n, 3))
        points = self.means[chosen] + np.einsum("nij,nj->ni", factors, normal)
        return self.coordinates.to_ratios(points)

    def require_nominal(self, nominal: FloatArray) -> None:
        """Raises UpdatingError where this farm's foundations are not about that one."""
        if not np.allclose(self.nominal, nominal, rtol=SAME_NOMINAL, atol=0.0):
            raise UpdatingError(
                f"the population of {self.name} is of foundations about "
                f"{_springs(self.nominal)}; this structure's are about {_springs(nominal)}"
            )

    def as_json(self) -> str:
        """The text of its file."""
        content = {
            "format": FORMAT,
            "turbines": self.turbines,
            "nominal": self.nominal.tolist(),
            "means": self.means.tolist(),
            "covariances": self.covariances.tolist(),
            "outlier_shares": self.outlier_shares.tolist(),
            "outlier_std": self.outlier_std,
            "figures": self.figures,
            "common": self.common.tolist(),
        }
        return json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"


def load_population(path: Path) -> StiffnessPopulation:
    """The population of a file that `pilewatch farm --prior` wrote.

    Raises UpdatingError for a file that cannot be read or is none.
    """
    try:
        return population_from_json(path.read_text(encoding="utf-8"), str(path))
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise UpdatingError(
            f"population {path} cannot be read ({reason}); `pilewatch farm --prior FILE` makes one"
        ) from error


def population_from_json(text: str, origin: str) -> StiffnessPopulation:
    """What `as_json` wrote. origin: names it in errors. Raises UpdatingError."""
    try:
        content = json.loads(text)
        if not isinstance(content, dict) or content.get("format") != FORMAT:
            raise ValueError(f"its format is not {FORMAT!r}")
        return _checked(content)
    except (ValueError, KeyError, TypeError) as error:
        what = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise UpdatingError(f"{origin} is no population of a farm: {what}") from error


def _checked(content: Mapping[str, Any]) -> StiffnessPopulation:
    """Raises ValueError, KeyError, TypeError where numbers do not fit together."""
    shares = np.array(content["outlier_shares"], dtype=float)
    n = len(shares)
    figures = tuple(str(each) for each in content.get("figures", ()))
    common = content["common"] if figures else np.zeros((0, 3))
    population = StiffnessPopulation(
        turbines=tuple(str(each) for each in content["turbines"]),
        nominal=_shaped(content["nominal"], (3,), "nominal"),
        means=_shaped(content["means"], (n, 3), "means"),
        covariances=_shaped(content["covariances"], (n, 3, 3), "covariances"),
        outlier_shares=shares,
        outlier_std=float(content["outlier_std"]),
        figures=figures,
        common=_shaped(common, (len(figures), 3), "common"),
    )
    if n == 0 or not population.turbines:
        raise ValueError("it was learned from nothing")
    if not (np.all((shares > 0) & (shares < 1)) and population.outlier_std > 0):
        raise ValueError("outlier_shares lie between 0 and 1, outlier_std above 0")
    if not np.all(np.linalg.eigvalsh(population.covariances) > 0):
        raise ValueError("a covariance is not positive definite")
    if not np.all(population.nominal != 0):
        raise ValueError("a nominal spring is 0")
    return population


def _shaped(values: Any, shape: tuple[int, ...], name: str) -> FloatArray:
    numbers = np.array(values, dtype=float)
    if numbers.shape != shape or not np.all(np.isfinite(numbers)):
        raise ValueError(
            f"{name} has the shape {numbers.shape} instead of {shape}, or is not finite"
        )
    return numbers


def _springs(values: FloatArray) -> str:
    return ", ".join(f"{each:.4g}" for each in values)


def log_gaussian(offsets: FloatArray, covariance: FloatArray) -> FloatArray:
    """(...) log N(offsets; 0, covariance).

    Parameters
    ----------
    offsets : ndarray, shape (..., d)
        From the mean.
    covariance : ndarray, shape (..., d, d)
        One for each offset.

    Notes
    -----
    By Cholesky's factor L and L⁻¹ offsets, column by column for all matrices at once: for thousands
    of matrices of three rows LAPACK spends its time in being called.
    """
    d = offsets.shape[-1]
    A, y = np.moveaxis(covariance, (-2, -1), (0, 1)), np.moveaxis(offsets, -1, 0)
    L: list[list[FloatArray]] = [[] for _ in range(d)]
    whitened: list[FloatArray] = []
    log_density = np.asarray(-d / 2 * np.log(2 * np.pi))
    for i in range(d):
        for j in range(i):
            L[i].append((A[i, j] - sum(L[i][k] * L[j][k] for k in range(j))) / L[j][j])
        variance = A[i, i] - sum(each**2 for each in L[i])
        L[i].append(np.sqrt(variance))
        reached = sum(L[i][k] * whitened[k] for k in range(i))
        whitened.append((y[i] - reached) / L[i][i])
        log_density = log_density - 0.5 * (whitened[i] ** 2 + np.log(variance))
    return log_density
