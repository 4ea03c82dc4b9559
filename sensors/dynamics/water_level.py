"""How modes follow the water: it moves along with the wetted tube as added mass."""

import numpy as np
from scipy.linalg import eigh

from sensors.arrays import FloatArray
from sensors.dynamics.full_model_modes import ReferenceModes
from sensors.structure.assembly import assemble
from sensors.structure.sensor_readings import ChannelReadings
from sensors.structure.structural_model import StructuralModel


def modes_in_water(
    model: StructuralModel,
    observation: ChannelReadings,
    reference: ReferenceModes,
    frequencies: FloatArray,
    rise: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the modes with the water risen above the description's level by so much [m].

    Frequencies, (n_modes,) [Hz], and shapes as read, (n_modes, n_channels) [-]; unchanged on land.

    Parameters
    ----------
    model : StructuralModel
        On its springs θ.
    reference : ReferenceModes
        Modes at that θ, mass-normalised.
    frequencies : ndarray, shape (n_modes,)
        Frequencies of these modes at that θ [Hz].

    Notes
    -----
    The basis is that of the modes V and of the static responses to a force on each degree of
    freedom whose mass changes. Of first order the change is Δ ln f = −½ φᵀ ΔM φ; shapes mix.
    """
    description = model.description
    squares = (2 * np.pi * frequencies) ** 2
    if description.water is None or rise == 0:
        return frequencies, observation.shapes(reference.vectors.T, squares)
    risen = description.with_water_level(description.water.level + rise)
    mass = assemble(risen).mass
    basis = np.hstack([reference.vectors, _static_responses(model, mass, reference.vectors)])
    found, coordinates = eigh(basis.T @ model.stiffness @ basis, basis.T @ mass @ basis)
    overlap = reference.vectors.T @ model.mass @ basis @ coordinates
    following = np.argmax(overlap**2, axis=1)
    found, vectors = found[following], basis @ coordinates[:, following]
    return np.sqrt(found) / (2 * np.pi), observation.shapes(vectors.T, found)


def _static_responses(model: StructuralModel, mass: FloatArray, modes: FloatArray) -> FloatArray:
    """Return responses to forces where `mass` differs from the model's, (n_dofs, n).

    The modes' part of them is taken out; they are independent of each other.
    """
    changed = np.flatnonzero(np.abs(mass - model.mass).max(axis=0) > 0)
    forces = np.zeros((len(mass), len(changed)))
    forces[changed, np.arange(len(changed))] = 1.0
    responses = np.linalg.solve(model.stiffness, forces)
    responses -= modes @ (modes.T @ model.mass @ responses)
    responses /= np.sqrt(np.einsum("ij,ij->j", responses, model.mass @ responses))
    independent, strength, _ = np.linalg.svd(responses, full_matrices=False)
    return np.asarray(independent[:, strength > 1e-6 * strength[0]])
