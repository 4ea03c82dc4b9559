"""The known water levels of the windows taken out of the evidence, by the model's own modes."""

from math import ceil

import numpy as np
from numpy.typing import NDArray

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.joint_model import continued
from sensors.arrays import FloatArray
from sensors.dynamics.figure_modes import Linearisation

LEVEL_TOLERANCE = 0.008  # of the pairing before [-]
NEAR_LEVEL = 0.5  # of the mean above or below the model's level, within which modes are paired with
# the model's own water: half a metre moves a mode by up to .42 %, about FINEST_TOLERANCE; of the 5
# and the IEA 15 MW tower [m]
FOLLOWED_STEP = 0.5  # by which modes are followed from one water level to another: shapes and order
# of neighbours change little in it [m]


def at_model_level(measured: ModalEvidence, fit: JointFit, u: FloatArray) -> ModalEvidence:
    """Take the windows' water levels out of the evidence, by the modes at a point.

    Modes are paired in the water in which they were measured, and their partners followed from
    there to the model's level.

    Parameters
    ----------
    measured : ModalEvidence
        With the windows' water levels in it.
    fit : JointFit
        At the model's level.
    u : ndarray, shape (n_dim,)
        Springs, figures and level at which the modes move with the water.

    Returns
    -------
    ModalEvidence
        As if every window had had the model's water level; as it came where nothing can be compared
        at the point.
    """
    there = fit.with_rise(pairing_rise(measured))
    found = there.compared(
        measured, there.targets(measured), u, max(LEVEL_TOLERANCE, fit.tolerance)
    )
    followed = None if found is None else _followed(there, u, found.linearisation)
    if found is None or followed is None:
        return measured
    modes, places = followed
    partners = fit.partners_in_water(u, modes)
    return measured.at_model_level(
        [partners[places[mode]] if mode >= 0 else None for mode in found.pairing.model_modes]
    )


def pairing_rise(measured: ModalEvidence) -> float:
    """Return the water above the model's level in which modes are paired [m].

    The mean of the windows where that is far from the model's level, else 0: nearer, modes find the
    same partners with the model's own water.
    """
    mean = measured.mean_rise
    return mean if abs(mean) > NEAR_LEVEL else 0.0


def _followed(
    there: JointFit, u: FloatArray, modes: Linearisation
) -> tuple[Linearisation, NDArray[np.intp]] | None:
    """The modes at the model's level, and (n_modes,) which of them continues each of those at
    another level; None where the structure cannot stand on the way."""
    places = np.arange(len(modes.frequencies))
    steps = ceil(abs(there.rise) / FOLLOWED_STEP)
    for left in reversed(range(steps)):
        nearer = there.with_rise(there.rise * left / steps).linearised(u)
        if nearer is None:
            return None
        places = continued(modes, nearer)[places]
        modes = nearer
    return modes, places
