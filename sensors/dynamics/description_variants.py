"""The description with one figure off, for figures that are not known exactly.

rna_mass        masses and inertias of nacelle and hub; the blades keep theirs
steel_modulus   Young's modulus of every tube
added_mass      coefficient C_a of the water that moves along
"""

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.full_model_modes import solved_modes
from sensors.dynamics.reference_modes import ReferenceModes
from sensors.structure.assembly import assemble
from sensors.structure.description import RotorNacelle, TurbineDescription
from sensors.structure.foundation import TurbineError
from sensors.structure.sensor_readings import Observation

STEP = 0.005  # of a factor, for the differences [-]


def varied(description: TurbineDescription, name: str, factor: float) -> TurbineDescription:
    """Return the same turbine with one figure multiplied by a factor [-].

    Returns
    -------
    TurbineDescription

    Raises
    ------
    TurbineError
        No such figure, or one that the turbine does not have.
    """
    if name not in VARIATIONS:
        raise TurbineError(f"no figure {name!r} can be varied; there are {', '.join(VARIATIONS)}")
    return VARIATIONS[name](description, factor)


def _rna_mass(description: TurbineDescription, factor: float) -> TurbineDescription:
    nacelle: RotorNacelle = description.rotor_nacelle
    if not nacelle.bodies and not nacelle.hub_mass:
        raise TurbineError(f"{description.name} has no mass on its top that could be uncertain")
    bodies = tuple(
        replace(
            body,
            mass=factor * body.mass,
            inertia=(
                factor * body.inertia[0],
                factor * body.inertia[1],
                factor * body.inertia[2],
            ),
        )
        for body in nacelle.bodies
    )
    heavier = replace(
        nacelle,
        bodies=bodies,
        hub_mass=factor * nacelle.hub_mass,
        hub_inertia=factor * nacelle.hub_inertia,
    )
    return replace(description, rotor_nacelle=heavier)


def _steel_modulus(description: TurbineDescription, factor: float) -> TurbineDescription:
    tubes = tuple(
        replace(tube, youngs_modulus=factor * tube.youngs_modulus) for tube in description.tubes
    )
    return replace(description, tubes=tubes)


def _added_mass(description: TurbineDescription, factor: float) -> TurbineDescription:
    if description.water is None:
        raise TurbineError(f"{description.name} stands on land: no water moves along with it")
    coefficient = factor * description.water.added_mass_coefficient
    return replace(
        description, water=replace(description.water, added_mass_coefficient=coefficient)
    )


VARIATIONS: Mapping[str, Callable[[TurbineDescription, float], TurbineDescription]] = {
    "rna_mass": _rna_mass,
    "steel_modulus": _steel_modulus,
    "added_mass": _added_mass,
}


def modes_of_varied(
    description: TurbineDescription,
    layout: SensorLayout,
    reference: ReferenceModes,
    *,
    highest_frequency: float,
) -> tuple[FloatArray, FloatArray]:
    """Return the modes of another description at the reference's θ, in the reference's order.

    Frequencies, (n_modes,) [Hz], and shapes as read, (n_modes, n_channels) [-].

    Parameters
    ----------
    reference : ReferenceModes
        Modes of the description that was varied, mass-normalised.
    highest_frequency : float
        Highest frequency [Hz], beyond the highest mode of the reference.

    Returns
    -------
    tuple[ndarray, ndarray]
    """
    model = assemble(description, stiffness=reference.theta)
    modes = solved_modes(model, Observation.of(model, layout), highest_frequency=highest_frequency)
    overlap = reference.vectors.T @ model.mass @ modes.vectors
    following = np.argmax(overlap**2, axis=1)
    return modes.frequencies[following], modes.shapes[following]


def responses(
    description: TurbineDescription,
    layout: SensorLayout,
    reference: ReferenceModes,
    name: str,
    *,
    highest_frequency: float,
) -> tuple[FloatArray, FloatArray]:
    """Return derivatives of frequencies and shapes by a figure, by central differences.

    ∂ ln f / ∂ ln (figure), (n_modes,) [-], and ∂ φ / ∂ ln (figure), (n_modes, n_channels) [-]; the
    component of φ that is largest stays 1.

    Returns
    -------
    tuple[ndarray, ndarray]

    Raises
    ------
    TurbineError
        No such figure, or one that the turbine does not have.
    """
    more, less = (
        modes_of_varied(
            varied(description, name, factor),
            layout,
            reference,
            highest_frequency=highest_frequency,
        )
        for factor in (1 + STEP, 1 - STEP)
    )
    unit = np.argmax(np.abs(more[1]), axis=1)[:, None]
    shapes = [shape / np.take_along_axis(shape, unit, axis=1) for _, shape in (more, less)]
    return (
        np.log(more[0] / less[0]) / (2 * STEP),
        (shapes[0] - shapes[1]) / (2 * STEP),
    )
