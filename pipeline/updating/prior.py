"""θ = (k11, k22, k12) as ratios to nominal, their uniform prior, and what it excludes.

Coordinates are the ratios r = k / k_nominal: dimensionless, of one size, and a prior uniform in k
is uniform in r, so no Jacobian appears anywhere.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from pipeline.updating.forward_model import ForwardModel, ModesOfStiffness
from sensors.arrays import FloatArray
from sensors.errors import InputError

SOFTEST_SEARCHED = 0.01  # 1 − k12² / (k11 k22), of the softest springs that a search looks at [-]
PARAMETER_NAMES = ("k11", "k22", "k12")
PARAMETER_UNITS = ("N/m", "N·m/rad", "N/rad")
VOLUME_NODES = 1000  # a side, of the midpoint rule for the prior's volume


class UpdatingError(InputError):
    """A setting or a stiffness with which no posterior can be computed."""


@dataclass(frozen=True, slots=True)
class PriorSettings:
    """Bounds of the uniform prior of an exact structure, [foundation-updating] §4.2.

    Where the structure is uncertain, the springs' prior is fixed and wide, and `highest_sigma`
    alone is used.
    """

    lowest_ratio: float = 0.25
    """Lower bound of each spring over nominal [-]."""
    highest_ratio: float = 4.0
    """Upper bound of each spring over nominal [-]."""
    highest_sigma: float = 0.1
    """Upper bound of σ, the relative model discrepancy [-]."""

    def __post_init__(self) -> None:
        if not 0 < self.lowest_ratio < self.highest_ratio < np.inf:
            raise UpdatingError(
                f"prior ratios run from {self.lowest_ratio} to {self.highest_ratio}; they must be "
                "positive and in rising order"
            )
        if not 0 < self.highest_sigma < np.inf:
            raise UpdatingError(f"highest_sigma is {self.highest_sigma}; it must be positive")


class Prior:
    """Uniform in k11, k22, k12 within the box, zero where no foundation can be.

    The springs must be positive definite, k11·k22 > k12², which excludes 39 % of the box of the
    IEA 15 MW monopile; and the structure must stand under gravity, which only the forward model
    can check (`modal(...).admissible`).
    """

    def __init__(self, nominal: FloatArray, settings: PriorSettings | None = None) -> None:
        """nominal: (3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]. Raises UpdatingError."""
        nominal = np.asarray(nominal, dtype=float)
        if nominal.shape != (3,) or not np.all(np.isfinite(nominal)) or np.any(nominal == 0):
            raise UpdatingError(
                f"springs {', '.join(f'{each:g}' for each in nominal)} (k11, k22, k12) of the "
                "description: their posterior is of ratios to these, so three finite numbers "
                "other than 0 are needed; of a tower that only rocks, k11 = 1e12 and k12 = 1e8"
            )
        self.nominal = nominal
        self.settings = settings or PriorSettings()
        self._coupling = nominal[2] ** 2 / (nominal[0] * nominal[1])  # k12² / (k11 k22) [-]

    def stiffness(self, ratios: FloatArray) -> FloatArray:
        """(..., 3) [N/m, N·m/rad, N/rad] of (..., 3) ratios [-]."""
        return ratios * self.nominal

    def supports(self, ratios: FloatArray) -> NDArray[np.bool_]:
        """(...,) whether (..., 3) ratios lie in the box with positive definite springs."""
        within = (ratios >= self.settings.lowest_ratio) & (ratios <= self.settings.highest_ratio)
        definite = ratios[..., 0] * ratios[..., 1] > self._coupling * ratios[..., 2] ** 2
        return within.all(axis=-1) & definite

    def log_density(self, ratios: FloatArray) -> FloatArray:
        """(n,) relative to the uniform one where it is supported: 0."""
        return np.zeros(ratios.shape[:-1])

    def draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3) ratios drawn from the supported part of the box (gravity not yet asked)."""
        low, high = self.settings.lowest_ratio, self.settings.highest_ratio
        accepted = np.empty((0, 3))
        for _ in range(200):
            candidates = generator.uniform(low, high, size=(2 * n, 3))
            accepted = np.vstack([accepted, candidates[self.supports(candidates)]])
            if len(accepted) >= n:
                return accepted[:n]
        raise UpdatingError(
            f"fewer than {n} of {400 * n} draws between {low} and {high} times nominal "
            f"{self.nominal.tolist()} have positive definite springs; k11·k22 > k12² is needed"
        )

    def spread(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3) supported ratios for a search: half of them uniform, half thick near the edge.

        Parameters
        ----------
        n : int
            How many.
        generator : numpy.random.Generator
            That they are drawn with.

        Notes
        -----
        Towards the edge of positive definiteness the springs' softer direction, of stiffness about
        k22 (1 − c²) with c = k12 / √(k11 k22), goes to zero and takes the lowest modes along; few
        uniform draws fall there. The other half has 1 − c² even in its logarithm, and k11 and k22
        too: what moves a frequency is a spring's share. Of 100 stiffnesses with 1 − c² < .2, seen
        through the paper's eleven modes, a search from such draws misses 5, from even ones 13.
        """
        low, high = self.settings.lowest_ratio, self.settings.highest_ratio
        uniform = self.draws(n - n // 2, generator)
        edge = np.empty((0, 3))
        for _ in range(200):
            if len(edge) >= n // 2:
                break
            k11, k22 = np.exp(generator.uniform(np.log(low), np.log(high), size=(2, 2 * n)))
            softness = np.exp(generator.uniform(np.log(SOFTEST_SEARCHED), 0.0, 2 * n))  # 1 − c²
            k12 = np.sqrt((1 - softness) * k11 * k22 / self._coupling)
            candidates = np.column_stack([k11, k22, k12])
            edge = np.vstack([edge, candidates[self.supports(candidates)]])
        return np.vstack([uniform, edge[: n // 2], self.draws(n // 2, generator)])[:n]


def modal_where_supported(
    forward: ForwardModel, prior: Prior, ratios: FloatArray
) -> tuple[NDArray[np.bool_], ModesOfStiffness | None]:
    """Which of (n, 3) ratios have a prior above zero, and the modes of those only.

    Parameters
    ----------
    forward : ForwardModel
        The structure at the layout's sensors.
    prior : Prior
        Of the ratios.
    ratios : ndarray, shape (n, 3)
        k / nominal [-].

    Returns
    -------
    admissible : ndarray of bool, shape (n,)
        Where the prior is above zero.
    modes : ModesOfStiffness or None
        Of the supported ones; None where there is none.

    Notes
    -----
    A model evaluation costs a thousand times the box test, so the box comes first.
    """
    admissible = prior.supports(ratios)
    if not admissible.any():
        return admissible, None
    modes = forward.modal(prior.stiffness(ratios[admissible]))
    return admissible, modes


def log_prior_volume(prior: Prior) -> float:
    """log of ∫ dr over the supported ratios: the box where k11·k22 > k12².

        V = ∫∫ max(0, min(h, √(r11 r22 / c)) − l) dr11 dr22,   c = k12² / (k11 k22) at nominal

    with l and h the box's bounds. What gravity alone forbids (.1 % of it for the IEA 15 MW
    monopile) counts as prior with a likelihood of zero.
    """
    box = (prior.settings.lowest_ratio, prior.settings.highest_ratio)
    k11, k22, k12 = map(float, prior.nominal)
    return _log_volume(box, k11, k22, k12)


@lru_cache(maxsize=64)  # the same for every window of a turbine
def _log_volume(box: tuple[float, float], k11: float, k22: float, k12: float) -> float:
    """log of the integral over r11 and r22 by midpoints."""
    low, high = box
    nodes = low + (np.arange(VOLUME_NODES) + 0.5) * (high - low) / VOLUME_NODES
    highest = np.minimum(high, np.sqrt(np.outer(nodes, nodes) * k11 * k22 / k12**2))
    return float(np.log(np.maximum(highest - low, 0.0).mean() * (high - low) ** 2))
