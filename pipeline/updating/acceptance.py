"""When a posterior must not be trusted, however narrow it is, and what the data determine.

A wrong structure widens σ a little and moves the stiffness a lot; the interval does not protect
itself. The signs are how badly the frequencies fit, and how many modes find no partner.

Why these thresholds: simulated hours of the IEA 15 MW turbine, true stiffness in .8 to 1.25 of
nominal, after one window and after six (`python -m tests.benchmarks recovery --structure …`).

    seeds                              reduced χ²    paired share   pairing cost
    2001..2010, the structure known,
      strong and weak load             .5 to 2.3      .87 to 1       .05 to 1.3
    5001..5006, flooded monopile       2.2 to 6.6     .57 to .84     2.9 to 4.3
    5001..5006, 24 twisted elements
      a blade instead of six means     9 to 36        .08 to .24     7.2 to 8.4

The cost separates them, and its threshold is the geometric mean of the worst right and the best
wrong one; χ² and share, which overlap or nearly do, have theirs outside the right ones' range and
catch what the cost may miss. Refused is what pairs as if by chance: the blades' kind.

Held against seeds 7001..7020, of which no threshold knew: of twenty flooded monopiles eighteen were
untrusted and two refused, of twenty towers with the other blades all were refused, after one window
and after two; of twenty towers on the model's own elements and twenty on finer ones all were
trusted.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from pipeline.messages import ModePair, ParameterSummary, QualityWarning
from pipeline.updating.prior import UpdatingError
from sensors.arrays import FloatArray
from sensors.settings import NO_KEY

LARGEST_MISFIT = 3.0  # that one mode counts for [standard deviations]
N_STIFFNESSES = 3
UNCONVERGED = ("chain-short", "not-converged")  # codes of warnings
FREQUENCY_FITS = 2.0  # standard deviations of a misfit within which the shape is what is odd [-]


@dataclass(frozen=True, slots=True)
class AcceptanceSettings:
    """Thresholds beyond which the structure is probably not the modelled one."""

    reduced_chi_square: float = 3.0
    """Largest reduced χ² of the frequencies that is trusted [-]."""
    paired_share: float = 0.8
    """Least share of the identified modes that have a model mode [-]."""
    pairing_cost: float = 2.0
    """Largest mean pairing cost of a mode that is trusted [-]."""
    refused_share: float = field(default=0.5, metadata=NO_KEY)
    """Below, there is no posterior at all [-]."""

    refused_cost: ClassVar[float] = 4.5
    """Above, likewise [-]."""
    rhat: float = 1.05
    """R-hat above which chains have not converged [-]."""
    mode_misfit: ClassVar[float] = 4.0
    """Of one mode's frequency: beyond, it is named [standard deviations]."""

    unpredicted_share: ClassVar[float] = 0.12
    """Of modes that others do not predict: beyond, untrusted [-]."""

    unlike_share: ClassVar[float] = 0.25
    """Of shapes that are not those of the modes with their frequencies: beyond, untrusted [-]."""

    figure_deviation: ClassVar[float] = 4.0
    """Of a figure from its prior: beyond, untrusted and named [std]."""

    other_sign: ClassVar[float] = 0.5
    """Probability that k12 has not the described sign: beyond, untrusted [-]."""

    interval_share: ClassVar[float] = 0.8
    """Of the prior's 90 % interval: above, nothing was learned [-]."""

    def __post_init__(self) -> None:
        for name in ("reduced_chi_square", "paired_share", "pairing_cost", "rhat"):
            if not getattr(self, name) > 0:
                raise UpdatingError(f"guard {name} is {getattr(self, name)}; it must be positive")
        if not 0 <= self.refused_share <= self.paired_share:
            raise UpdatingError(
                f"guard refused_share is {self.refused_share}; it must lie between 0 and "
                f"paired_share ({self.paired_share})"
            )


@dataclass(frozen=True, slots=True)
class Fit:
    """The figures by which a posterior is judged."""

    reduced_chi_square: float
    paired_share: float
    pairing_cost: float


def reduced_chi_square(misfits: FloatArray) -> float:
    """Σ min(z², 9) / (n − 3) of the frequencies' misfits z, (n,), in standard deviations.

    A wrong structure is wrong in most modes; a single mode that the identification got wrong by
    ten standard deviations gives no information about the others, so it counts as three.
    """
    counted = np.minimum(misfits**2, LARGEST_MISFIT**2)
    return float(counted.sum() / max(len(misfits) - N_STIFFNESSES, 1))


def refusal(
    paired_share: float, pairing_cost: float, settings: AcceptanceSettings
) -> QualityWarning | None:
    """Why these modes are not this structure's; None where a posterior is worth computing.

    Parameters
    ----------
    paired_share : float
        Of the identified modes that have a partner in the model [-].
    pairing_cost : float
        Mean cost of a pair [-].
    settings : AcceptanceSettings
        With the least share and the highest cost.

    Notes
    -----
    Where most identified modes find no partner, the few pairs there are have been found by chance,
    and the stiffness they imply is not even roughly right.
    """
    share_needed, cost_allowed = settings.refused_share, settings.refused_cost
    if paired_share < share_needed:
        return QualityWarning(
            "few-pairs",
            f"only {paired_share:.0%} of the identified modes are modes of the model (at least "
            f"{share_needed:.0%} needed): no posterior",
        )
    if pairing_cost > cost_allowed:
        return QualityWarning(
            "pairing-cost",
            f"identified and model modes hardly resemble each other (mean cost {pairing_cost:.1f}, "
            f"at most {cost_allowed:g} allowed): no posterior",
        )
    return None


def unconverged(warnings: Sequence[QualityWarning]) -> bool:
    """Whether a sampler reports that its quantiles are rough."""
    return any(warning.code in UNCONVERGED for warning in warnings)


def contradictions(fit: Fit, settings: AcceptanceSettings) -> tuple[QualityWarning, ...]:
    """Why the data contradict the model; empty for a posterior that may be trusted."""
    warnings = []
    if fit.reduced_chi_square > settings.reduced_chi_square:
        warnings.append(
            QualityWarning(
                "misfit",
                f"the identified frequencies lie further from the model's than their standard "
                f"deviations allow (reduced chi-square {fit.reduced_chi_square:.1f}, at most "
                f"{settings.reduced_chi_square:g} expected)",
            )
        )
    if fit.paired_share < settings.paired_share:
        warnings.append(
            QualityWarning(
                "few-pairs",
                f"only {fit.paired_share:.0%} of the identified modes are modes of the model "
                f"(at least {settings.paired_share:.0%} expected)",
            )
        )
    if fit.pairing_cost > settings.pairing_cost:
        warnings.append(
            QualityWarning(
                "pairing-cost",
                f"identified and model modes resemble each other badly (mean cost "
                f"{fit.pairing_cost:.1f}, at most {settings.pairing_cost:g} expected)",
            )
        )
    return tuple(warnings)


def contraction(width: float, extent: float) -> float:
    """1 − (90 % interval) / (the uniform prior's 90 % interval); 0 where nothing was learned.

    Parameters
    ----------
    width : float
        Of the 90 % interval.
    extent : float
        Of the prior from bound to bound, in the same unit.
    """
    return float(1.0 - width / (0.9 * extent))


def mode_information(
    jacobian: FloatArray, precisions: FloatArray, groups: Sequence[int]
) -> FloatArray:
    """(n_modes,) share of all modes' information on the stiffness, of sum 1.

    Parameters
    ----------
    jacobian : ndarray, shape (p, 3)
        ∂η / ∂ ratio [Hz, -].
    precisions : ndarray, shape (p,)
        Of η, floor and discrepancy included.
    groups : sequence of int
        (p,) which mode each error belongs to.

    Notes
    -----
        share_j = tr(C F_j) / 3,   F_j = Σ_{i in j} w_i J_iᵀ J_i,   C = (Σ_j F_j)⁻¹   (Fisher)

    Shares of three parameters' worth of information: what one mode alone could not determine,
    but is needed for, counts too.
    """
    fisher = (jacobian.T * precisions) @ jacobian
    each = precisions * np.einsum("ia,ab,ib->i", jacobian, np.linalg.pinv(fisher), jacobian) / 3
    shares = np.zeros(max(groups, default=-1) + 1)
    np.add.at(shares, list(groups), each)
    return shares


def predictive_misfits(
    errors: FloatArray, variances: FloatArray, discrepancies: FloatArray
) -> FloatArray:
    """(n_modes,) posterior predictive misfit of each frequency, in standard deviations.

    Parameters
    ----------
    errors : ndarray, shape (n_draws, n_modes)
        η, model minus identified [Hz].
    variances : ndarray, shape (n_modes,)
        Of the identified ones, floor and gaps included [Hz²].
    discrepancies : ndarray, shape (n_draws, n_modes)
        σ² f̄² of the same draws [Hz²].

    Notes
    -----
        z = mean η / √(variance + mean σ² f̄² + var η)
    """
    spread = variances + discrepancies.mean(axis=0) + errors.var(axis=0)
    return np.asarray(errors.mean(axis=0) / np.sqrt(spread))


def misfit_warnings(
    pairs: Sequence[ModePair], settings: AcceptanceSettings
) -> tuple[QualityWarning, ...]:
    """One sentence for each mode that the posterior cannot explain."""
    return tuple(
        QualityWarning(
            "mode-misfit",
            f"mode {each.identified or '?'} at {each.frequency:.4g} Hz, taken for the model's "
            f"{each.model}, lies {each.frequency / each.model_frequency - 1:+.2%} off, "
            f"{abs(each.misfit):.1f} standard deviations: it counts little",
        )
        for each in pairs
        if abs(each.misfit) > settings.mode_misfit
    )


def what_differs(pair: ModePair) -> str:
    """Return the frequency's misfit, or the shape where the frequency fits."""
    if pair.shape_used and abs(pair.misfit) < FREQUENCY_FITS:
        return f"in shape: MAC {pair.mac:.3f}"
    return f"frequency {pair.misfit:+.1f} standard deviations off"


def unidentified_springs(
    parameters: Sequence[ParameterSummary], settings: AcceptanceSettings
) -> tuple[QualityWarning, ...]:
    """One sentence for each stiffness about which the sensors give next to no information."""
    return tuple(
        QualityWarning(
            "not-identified",
            f"{each.name} is not identified by these sensors: its interval is "
            f"{1 - each.contraction:.0%} of the prior's",
        )
        for each in parameters
        if each.name != "sigma" and 1 - each.contraction > settings.interval_share
    )
