"""The foundation's springs at another level."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sensors.arrays import FloatArray
from sensors.structure.foundation import SPRING_SIGNS, SpringSign, positive_definite, spring_matrix

from .errors import InputError


def springs_at(
    theta: ArrayLike,
    sign: SpringSign,
    *,
    rise: float,
    bending_rigidity: float,
    shear_rigidity: float = np.inf,
) -> FloatArray:
    """Return what springs and the tube on them are together at another level.

    Parameters
    ----------
    theta : ArrayLike, shape (..., 3)
        θ = (k11, k22, k12) [N/m, N·m/rad, N/rad].
    sign : str
        Convention of k12, at both levels.
    rise : float
        h: height of the other level above that of θ. Below it, h < 0, the tube between the two is
        taken out of the springs [m].
    bending_rigidity : float
        EI of the uniform tube between the two levels [N·m²]. Of several tubes, go from one to the
        next.
    shear_rigidity : float, optional
        κGA of a tube that deforms by shear, too [N].

    Returns
    -------
    ndarray, shape (..., 3)
        θ at the other level; k12 < 0 where its sign is there the other one.

    Raises
    ------
    InputError
        If the springs are not three numbers or not positive definite, the rise is not finite, or no
        springs at a lower level are as stiff as these: the tube alone may be softer.

    Notes
    -----
    With F = K⁻¹ and T = [[1, h], [0, 1]]:

        F' = T F Tᵀ + [[h³/3, h²/2], [h²/2, h]] / EI + [[h, 0], [0, 0]] / κGA

    This is statics, without the tube's mass, the water that moves along and the weight above: it
    holds for modes that are slow for the tube between the levels.
    """
    if sign not in SPRING_SIGNS:
        raise InputError(f"sign is {sign!r}; it is 'published' or 'embedded-pile'")
    if not (bending_rigidity > 0 and shear_rigidity > 0):
        raise InputError(
            f"the tube has EI = {bending_rigidity:g} N·m² and κGA = {shear_rigidity:g} N; both "
            "must be positive"
        )
    try:
        springs = np.asarray(theta, dtype=np.float64)
    except (TypeError, ValueError):
        springs = np.empty(0)
    if not springs.ndim or springs.shape[-1] != 3:
        raise InputError(f"springs are {theta!r}; they are three numbers, k11, k22 and k12")
    if not np.isfinite(rise):
        raise InputError(f"rise is {rise}; it is the height of the other level [m]")
    if not bool(np.all(positive_definite(springs))):
        raise InputError(
            f"springs {springs.tolist()} are not positive definite; k11·k22 must exceed k12²"
        )
    carried = np.array([[1.0, rise], [0.0, 1.0]])
    tube = np.array([[rise**3 / 3, rise**2 / 2], [rise**2 / 2, rise]]) / bending_rigidity
    tube[0, 0] += rise / shear_rigidity
    flexibility = carried @ np.linalg.inv(spring_matrix(springs, sign)) @ carried.T + tube
    stiffness = np.linalg.inv(flexibility)
    coupling = stiffness[..., 0, 1] if sign == "published" else -stiffness[..., 0, 1]
    found = np.stack([stiffness[..., 0, 0], stiffness[..., 1, 1], coupling], axis=-1)
    if not bool(np.all(positive_definite(found))):
        raise InputError(
            f"no springs {-rise:g} m below, under a tube of EI = {bending_rigidity:g} N·m², are as "
            "stiff as these"
        )
    return found
