"""Which sensor is to blame: each is left out in turn.

A sensor that is metres off leads the fit into another valley, from which no descent tells what is
wrong with it. What the others read fits as ever as soon as its channels are left out, and no other
sensor's, so that a few fits tell whether any one sensor is to blame, and which.
"""

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import FEW_STARTS, LARGEST_COST, JointFit
from pipeline.updating.structural.joint_model import JointPeak


def blamed_sensor(
    fit: JointFit, evidence: ModalEvidence, peak: JointPeak
) -> tuple[tuple[int, ...], JointPeak] | None:
    """Channels of the sensor without which the others fit best, and their peak.

    Parameters
    ----------
    fit : JointFit
        Of one alternative.
    evidence : ModalEvidence
        Of all windows, all sensors in it.
    peak : JointPeak
        Of the evidence with all sensors.

    Returns
    -------
    (tuple of int, JointPeak) or None
        None where they fit without none, or where there are no others.
    """
    best: tuple[tuple[int, ...], JointPeak] | None = None
    good, elevations = fit.settings.good_cost, fit.model.layout.elevations
    sensors = np.unique(elevations)
    if len(sensors) < 2:
        return None  # frequencies alone would fit, whatever is wrong
    for elevation in sensors:
        channels = tuple(np.flatnonzero(elevations == elevation).tolist())
        end = fit.best(evidence.without_channels(channels), [peak.u], most_starts=FEW_STARTS)
        if end is not None and (best is None or end.misfit < best[1].misfit):
            best = channels, end
            if end.relative_cost <= good < LARGEST_COST < peak.relative_cost:
                break  # no mistake: as long as the wrong one is among them, the others do not fit
    return best if best is not None and best[1].relative_cost <= good else None
