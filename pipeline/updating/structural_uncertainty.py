"""Figures of the structure that are not known exactly, beside the springs: declared by name.

    [updating.uncertain]
    rna_mass = 0.03        # standard deviation, relative: nacelle and hub
    steel_modulus = 0.01   # of every tube
    added_mass = 0.2       # of the water that moves along
    scour_depth = 1.5      # of a half-normal prior, 0 at the least [m]

Each is one more coordinate of the posterior: springs are then as uncertain as they are when the
nacelle may weigh three percent more, and what the data say of the nacelle is told as well. Modes
answer linearly in the first three, ln f by D_j a and shapes by their slopes, which a few percent
allow; scour softens the springs by a pile on Winkler springs, before the modes are asked for.

What pairs modes, follows them and looks for changes knows nothing of this: there the figures are
as described.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from pipeline.messages import ParameterSummary
from pipeline.updating.diagnostics import contraction
from pipeline.updating.forward_model import ForwardModel, ModesOfStiffness
from pipeline.updating.likelihood.laplace import bounded_inverse
from pipeline.updating.likelihood.pairing import DIFFERENCE
from pipeline.updating.model_matching import Match
from pipeline.updating.prior import Prior, PriorSettings, UpdatingError
from pipeline.updating.samplers.interface import Peak
from sensors.arrays import FloatArray

SCOUR = "scour_depth"
WITHIN = 5.0  # standard deviations of a figure's prior that are looked at [-]
SCOUR_START = 0.5  # where the search for the peak leaves scour, in its prior's std [-]
NORMAL_90 = float(np.ptp(ndtri([0.05, 0.95])))  # width of its 90 % interval [std]
HALF_NORMAL_90 = float(np.ptp(ndtri([0.525, 0.975])))  # the same of a half-normal one


@dataclass(frozen=True, slots=True)
class UncertainSettings:
    """Section [updating.uncertain] of a scenario: prior standard deviations; 0: known exactly."""

    rna_mass: float = 0.0  # relative [-]
    steel_modulus: float = 0.0  # relative [-]
    added_mass: float = 0.0  # relative [-]
    scour_depth: float = 0.0  # [m]

    def __post_init__(self) -> None:
        for each in fields(self):
            std = getattr(self, each.name)
            largest = np.inf if each.name == SCOUR else 0.3
            if not 0 <= std <= largest:
                raise UpdatingError(
                    f"{each.name} is {std:g}; a prior's standard deviation from 0 (known) "
                    + ("upwards [m]" if each.name == SCOUR else "to 0.3 (linear up to there)")
                )

    @property
    def names(self) -> tuple[str, ...]:
        """Of the figures that are uncertain."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) > 0)

    @property
    def stds(self) -> FloatArray:
        """(q,) of their priors."""
        return np.array([getattr(self, name) for name in self.names])


class StructuralPrior(Prior):
    """The springs' uniform prior with the figures' normal ones.

    Coordinates are (k11, k22, k12) / nominal, then each figure's departure from its description:
    relative, scour in metres.
    """

    def __init__(
        self, nominal: FloatArray, settings: PriorSettings, uncertain: UncertainSettings
    ) -> None:
        """nominal: (3,) springs. Raises UpdatingError."""
        super().__init__(nominal, settings)
        self.springs = Prior(nominal, settings)
        self.names = uncertain.names
        self.stds = uncertain.stds
        self._lowest = np.where([name == SCOUR for name in self.names], 0.0, -WITHIN)

    def stiffness(self, ratios: FloatArray) -> FloatArray:
        """(..., 3 + q) springs in their units, then the figures' departures."""
        springs = self.springs.stiffness(ratios[..., :3])
        return np.concatenate([springs, ratios[..., 3:]], axis=-1)

    def supports(self, ratios: FloatArray) -> NDArray[np.bool_]:
        """(...,) whether springs and figures lie where they are looked for."""
        figures = ratios[..., 3:] / self.stds
        within = ((figures >= self._lowest) & (figures <= WITHIN)).all(axis=-1)
        return self.springs.supports(ratios[..., :3]) & within

    def draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3 + q)"""
        normal = generator.standard_normal((n, len(self.names)))
        figures = np.where(self._lowest == 0.0, np.abs(normal), normal)
        return np.hstack([self.springs.draws(n, generator), figures * self.stds])

    def log_density(self, ratios: FloatArray) -> FloatArray:
        """(n,) of the figures; the springs' is uniform."""
        figures = ratios[..., 3:] / self.stds
        halves = np.log(2.0) * np.count_nonzero(self._lowest == 0.0)
        constant = halves - np.log(np.sqrt(2 * np.pi) * self.stds).sum()
        return np.asarray(constant - 0.5 * (figures**2).sum(axis=-1))

    def precision(self) -> FloatArray:
        """(3 + q, 3 + q) of the normal part; zero for springs."""
        return np.diag(np.concatenate([np.zeros(3), self.stds**-2]))


@dataclass(frozen=True, slots=True, eq=False)
class StructuralModes:
    """Modes of n points; `ModesOfStiffness`."""

    frequencies: FloatArray  # (n, m) [Hz]
    shapes: FloatArray  # (n, m, n_channels) [-]
    admissible: NDArray[np.bool_]  # (n,)


class StructuralForward:
    """The modes of a structure whose figures may be off: what a likelihood and a reader ask of a
    ForwardModel. Shapes come with their largest component 1."""

    def __init__(self, forward: ForwardModel, names: Sequence[str]) -> None:
        """Raises InputError where the structure has no such figure."""
        self._forward = forward
        self.labels = forward.labels
        self._linear = [3 + i for i, name in enumerate(names) if name != SCOUR]
        self._scour = 3 + names.index(SCOUR) if SCOUR in names else None
        answers = [forward.responses(name) for name in names if name != SCOUR]
        n_modes = len(self.labels)
        self._slopes = np.array([logs for logs, _ in answers]).reshape(-1, n_modes)  # D, (q, m)
        self._turns = np.array([shapes for _, shapes in answers])  # (q, m, n_channels)

    def modal(self, theta: FloatArray) -> ModesOfStiffness:
        """Modes for (n, 3 + q) springs and departures."""
        springs = theta[:, :3]
        if self._scour is not None:
            springs = self._forward.scoured(springs, theta[:, self._scour])
        modes = self._forward.modal(springs)
        if not self._linear:
            return modes
        off = theta[:, self._linear]
        largest = np.argmax(np.abs(modes.shapes), axis=2)[..., None]
        shapes = modes.shapes / np.take_along_axis(modes.shapes, largest, axis=2)
        return StructuralModes(
            frequencies=modes.frequencies * np.exp(off @ self._slopes),
            shapes=shapes + np.tensordot(off, self._turns, axes=1),
            admissible=modes.admissible,
        )


def require_figures(forward: ForwardModel, names: Sequence[str]) -> None:
    """Raises InputError where the structure has no such figure, or nothing is known of its pile."""
    StructuralForward(forward, names).modal(np.append(forward.nominal, np.zeros(len(names)))[None])


def widened(match: Match, prior: StructuralPrior) -> Match:
    """The match with the figures among its coordinates, and its peak there.

    One Gauss-Newton step from the springs' peak, the figures' prior added to the curvature.
    """
    forward = StructuralForward(match.forward, prior.names)
    start = np.concatenate([match.peak.ratios, np.zeros(len(prior.names))])
    steps = DIFFERENCE * np.vstack([np.zeros(len(start)), np.eye(len(start))])
    whitened = match.likelihood.whitened(forward.modal(prior.stiffness(start + steps)))
    jacobian = (whitened[1:] - whitened[0]).T / DIFFERENCE
    weights = match.likelihood.weights(whitened[0] ** 2)
    hessian = (jacobian.T * weights) @ jacobian + prior.precision()
    peak = Peak(start, np.diag(np.concatenate([np.ones(3), prior.stds**2])))
    if np.all(np.isfinite(hessian)):
        moved = start - np.linalg.pinv(hessian, rcond=1e-12) @ (
            jacobian.T @ (weights * whitened[0])
        )
        if SCOUR in prior.names:
            place = 3 + prior.names.index(SCOUR)
            moved[place] = max(moved[place], SCOUR_START * prior.stds[place - 3])
        inside = moved if prior.supports(moved) else start
        peak = Peak(inside, bounded_inverse(hessian))
    wide = StructuralForward(match.all_modes, prior.names)
    return replace(match, forward=forward, all_modes=wide, peak=peak)  # type: ignore[arg-type]


def figure_summaries(draws: FloatArray, prior: StructuralPrior) -> tuple[ParameterSummary, ...]:
    """What is known of each figure, from (n, q) draws of its departure: relative ones as the factor
    to the described value, scour in metres."""
    found = []
    for name, std, values in zip(prior.names, prior.stds, draws.T, strict=True):
        scour = name == SCOUR
        low, median, high = np.quantile(values + (0.0 if scour else 1.0), [0.05, 0.5, 0.95])
        before = (HALF_NORMAL_90 if scour else NORMAL_90) * std
        found.append(
            ParameterSummary(
                name=name,
                unit="m" if scour else "-",
                nominal=0.0 if scour else 1.0,
                median=float(median),
                p05=float(low),
                p95=float(high),
                contraction=contraction(high - low, before / 0.9),
            )
        )
    return tuple(found)
