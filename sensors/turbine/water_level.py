"""How natural frequencies follow the water: it moves along with the wetted tube as added mass."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from sensors.turbine.assembly import assemble
from sensors.turbine.description import TurbineDescription
from sensors.turbine.reference import ReferenceModes

FloatArray = NDArray[np.float64]

RISE = 1.0  # of the water, up and down, through which the parabola is laid [m]


def water_curves(
    description: TurbineDescription, reference: ReferenceModes, frequencies: FloatArray
) -> FloatArray:
    """Slope a and curvature b of every mode, ln f = ln f₀ + a l + b l², l the rise of the water
    above the description's level.

    reference     modes at one θ, mass-normalised
    frequencies   f₀ of these modes at that θ, (n_modes,) [Hz]
    returns       (n_modes, 2) [1/m, 1/m²]; zeros for a turbine on land

    With the modes V as a basis, K = Λ and M = 1 + Vᵀ ΔM(l) V at l = ±1 m: the slope is that of
    first-order perturbation, −½ φᵀ (∂M/∂l) φ, the curvature what the modes' mixing makes of it (of
    few modes alone it is less exact; of all visible ones 2e-4 of f is left at 1.5 m).
    """
    if description.water is None:
        return np.zeros((len(frequencies), 2))
    up, down = (_log_change(description, reference, frequencies, rise) for rise in (RISE, -RISE))
    return np.column_stack([(up - down) / (2 * RISE), (up + down) / (2 * RISE**2)])


def _log_change(
    description: TurbineDescription, reference: ReferenceModes, frequencies: FloatArray, rise: float
) -> FloatArray:
    """(n_modes,) ln f with the water risen less ln f without."""
    assert description.water is not None
    risen = description.with_water_level(description.water.level + rise)
    mass = assemble(risen, stiffness=reference.theta).mass
    squares = (2 * np.pi * frequencies) ** 2
    found, vectors = eigh(np.diag(squares), reference.vectors.T @ mass @ reference.vectors)
    following = np.argmax(vectors**2, axis=1)  # of each mode: nearly all of one solution's vector
    return np.asarray(0.5 * np.log(found[following] / squares))
