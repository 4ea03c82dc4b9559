"""By which angle all sensors may be turned against the nacelle's axes.

Sensors are fixed to the tower, fore-aft follows the nacelle. Where all are turned, no frequency
changes, modes mostly have their partners, and the angle is that at which the shapes are theirs:

    max over α of Σ MAC(φ, cos α r + sin α r_⊥)

r and r_⊥ what the sensors read of a mode of the model along their axes and across them. Beyond some
40° modes find wrong partners or none; then the angle is that at which modes find much nearer ones
among drawn structures.
"""

from dataclasses import replace

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.joint_model import JointPeak
from sensors.acquisition.layout import turning_matrix
from sensors.arrays import FloatArray
from sensors.errors import InputError

ANGLES = np.arange(-90.0, 90.0)  # half a turn changes the sign of a shape, which is free [deg]
NEARER_SHAPES = 0.5  # of what all MACs lack of 1 is left at an angle that is tried first [-]
NEARER_PAIRS = 0.7  # of the pairing cost as it is, at an angle that modes call for: as for wrong
# cables (`faults.MUCH_NEARER`)
TURNS = (90.0, 75.0, -75.0, 60.0, -60.0, 45.0, -45.0, 30.0, -30.0)  # [deg]
NEARER_TURNS = (-10.0, -5.0, 0.0, 5.0, 10.0)  # beside the best of them [deg]


def likely_angles(fit: JointFit, evidence: ModalEvidence, peak: JointPeak) -> list[float]:
    """The angles [deg] at which modes find much nearer partners, or shapes are much more like their
    partners' at a peak; none where no angle does."""
    angles = (_by_pairing(fit, evidence), _by_shapes(fit, evidence, peak))
    return [angle for angle in angles if angle is not None]


def _by_shapes(fit: JointFit, evidence: ModalEvidence, peak: JointPeak) -> float | None:
    """The angle at which the shapes of the paired modes are those of their partners [deg]."""
    headings = fit.sensors.placement(fit.coordinates.sensors(peak.u)).headings
    values = turned_macs(evidence, peak, headings)
    if not values.size:
        return None
    lacking = 1.0 - values.mean(axis=0)
    best = int(np.argmin(lacking))
    as_stated = lacking[int(np.argmin(np.abs(ANGLES)))]
    return float(ANGLES[best]) if lacking[best] <= NEARER_SHAPES * as_stated else None


def turned_macs(evidence: ModalEvidence, peak: JointPeak, headings: FloatArray) -> FloatArray:
    """MAC of lone modes with their partners as sensors turned by each of `ANGLES` read them [-].

    Parameters
    ----------
    evidence : ModalEvidence
        Of all windows.
    peak : JointPeak
        With the pairs.
    headings : ndarray, shape (n_channels,)
        Of the sensors at the peak, from the stated directions [rad].

    Returns
    -------
    ndarray, shape (n_modes, n_angles)
        Of the modes that are alone at their frequency; the angles are from the sensors' stated
        directions.
    """
    modes = peak.comparison.linearisation
    alone = [each for each in peak.comparison.used if each.shape_used or each.shape_unlike]
    angles = np.radians(ANGLES)[:, None] - headings
    found = []
    for each in alone:
        measured = evidence.modes[each.identified].mean[1:]
        along, across = (
            np.real(readings[each.model_modes[0]])
            for readings in (modes.readings, modes.by_heading)
        )
        known = np.isfinite(measured)
        turned = (np.cos(angles) * along + np.sin(angles) * across)[:, known]
        phi = measured[known]
        squares = (turned @ phi) ** 2
        found.append(squares / ((turned**2).sum(axis=1) * (phi @ phi) + 1e-300))
    return np.array(found)


def _by_pairing(fit: JointFit, evidence: ModalEvidence) -> float | None:
    """The angle at which modes find much nearer partners among drawn structures [deg]; None where
    none does, or where the motion across a sensor is not measured."""
    layout, targets = fit.model.layout, fit.targets(evidence)

    def bound(angle: float) -> float:
        as_stated = turning_matrix(layout, -angle)
        return fit.pairing_bound(replace(targets, shapes=targets.shapes @ as_stated.T))

    try:
        best = min(TURNS, key=bound)
    except InputError:
        return None
    best = min((best + nearer for nearer in NEARER_TURNS), key=bound)
    return best if bound(best) < NEARER_PAIRS * fit.pairing_bound(targets) else None
