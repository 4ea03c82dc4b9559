"""What the data determine and what they don't: contraction, information by mode, misfit by mode."""

from collections.abc import Sequence

import numpy as np

from pipeline.messages import ModePair, ParameterSummary, QualityWarning
from pipeline.updating.acceptance import AcceptanceSettings
from sensors.arrays import FloatArray

FREQUENCY_FITS = 2.0  # standard deviations of a misfit within which the shape is what is odd [-]


def contraction(width: float, extent: float) -> float:
    """1 − (90 % interval) / (the uniform prior's 90 % interval); 0 where nothing was learned.

    width    of the 90 % interval;  extent   of the prior from bound to bound, in the same unit
    """
    return float(1.0 - width / (0.9 * extent))


def mode_information(
    jacobian: FloatArray, precisions: FloatArray, groups: Sequence[int]
) -> FloatArray:
    """(n_modes,) share of all modes' information on the stiffness, of sum 1.

    jacobian     ∂η / ∂ ratio, (p, 3) [Hz, -]
    precisions   (p,) of η, floor and discrepancy included
    groups       (p,) which mode each error belongs to

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

    errors          model minus identified, (n_draws, n_modes) [Hz]
    variances       of the identified ones, floor and gaps included, (n_modes,) [Hz²]
    discrepancies   σ² f̄² of the same draws, (n_draws, n_modes) [Hz²]

        z = mean η / √(variance + mean σ² f̄² + var η)
    """
    spread = variances + discrepancies.mean(axis=0) + errors.var(axis=0)
    return np.asarray(errors.mean(axis=0) / np.sqrt(spread))


def misfit_doubts(
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


def unidentified_doubts(
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
