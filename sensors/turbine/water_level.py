"""How modes follow the water: it moves along with the wetted tube as added mass."""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from sensors.layout import SensorLayout
from sensors.turbine.assembly import assemble
from sensors.turbine.description import TurbineDescription
from sensors.turbine.observation import Observation
from sensors.turbine.reference import ReferenceModes

FloatArray = NDArray[np.float64]


def modes_in_water(
    description: TurbineDescription,
    layout: SensorLayout,
    reference: ReferenceModes,
    frequencies: FloatArray,
    rise: float,
) -> tuple[FloatArray, FloatArray]:
    """Frequencies, (n_modes,) [Hz], and shapes as read, (n_modes, n_channels) [-], with the water
    risen above the description's level by so much [m]; as they are for a turbine on land.

    reference     modes at one θ, mass-normalised
    frequencies   of these modes at that θ, (n_modes,) [Hz]

    With the modes V as a basis, K = Λ and M = 1 + Vᵀ ΔM V. Of first order that is the perturbation
    Δ ln f = −½ φᵀ ΔM φ; the mixing of all visible modes gives the rest (of a few modes alone it is
    less exact): 2e-4 of f is left at 1.5 m.
    """
    model = assemble(description, stiffness=reference.theta)
    observation = Observation.of(model, layout).in_basis(reference.vectors)
    squares = (2 * np.pi * frequencies) ** 2
    if description.water is None or rise == 0:
        return frequencies, observation.shapes(np.eye(len(squares)), squares)
    risen = description.with_water_level(description.water.level + rise)
    mass = assemble(risen, stiffness=reference.theta).mass
    found, vectors = eigh(np.diag(squares), reference.vectors.T @ mass @ reference.vectors)
    following = np.argmax(vectors**2, axis=1)  # of each mode: nearly all of one solution's vector
    found, coordinates = found[following], vectors[:, following].T
    return np.sqrt(found) / (2 * np.pi), observation.shapes(coordinates, found)
