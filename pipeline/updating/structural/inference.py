"""The joint inference of one turbine from its description, layout and settings."""

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.structural.alternatives import (
    UNDESCRIBED_FLOODING,
    Alternative,
    JointInference,
)
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.prior import GaussianBelief, JointCoordinates, StructuralPrior
from pipeline.updating.structural.sensors.figures import SensorReadings, sensor_figures
from sensors.acquisition.layout import SensorLayout
from sensors.dynamics.figure_model import BladeMesh, FigureModel
from sensors.structure.description import TurbineDescription

if TYPE_CHECKING:
    from pipeline.updating.settings import UpdatingSettings

BELIEF_DRAWS = 2000  # of a farm's prior, for its Gaussian
SHAPE_FLOOR = 0.0035  # systematic, of shapes whose sensors' figures are inferred beside: less than
# the .5 % that stands for them where the structure is exact; tuned on seeds below 22000 [-]
SEARCH_SEED = 3  # beside the scenario's


def joint_inference(
    turbine: TurbineDescription,
    layout: SensorLayout,
    settings: "UpdatingSettings",
    *,
    seed: int = 0,
    population: StiffnessPopulation | None = None,
) -> JointInference | None:
    """Springs and figures of one turbine; None where its structure is taken as exact."""
    structure = settings.structure
    if structure.exact:
        return None
    prior = structure.prior(turbine)
    sensors = SensorReadings(
        sensor_figures(
            layout,
            gain=structure.std("sensor_gain", 0.01),
            heading=structure.std("sensor_heading", 2.0),
            height=structure.std("sensor_height", 0.2),
        ),
        len(layout.channels),
    )
    coordinates = JointCoordinates(
        turbine.nominal,
        prior.figures,
        prior.known_level_std,
        sensor_names=sensors.names,
    )
    if population is not None:
        coordinates = coordinates.with_belief(_belief(population, coordinates))
    floor = min(settings.likelihood.shape_floor, SHAPE_FLOOR)
    likelihood = replace(settings.likelihood, shape_floor=floor)
    fits = []
    for mesh, mesh_probability in _meshes(turbine, exact=structure.is_exact("blade_model")):
        model = _figure_model(turbine, layout, prior.names, mesh)
        for flooded, probability in _floodings(turbine, exact=structure.is_exact("flooding")):
            fit = JointFit(
                model.with_flooding(flooded),
                coordinates,
                likelihood=likelihood,
                pairing=settings.pairing,
                generator=np.random.default_rng([seed, SEARCH_SEED]),
                sensors=sensors,
            )
            name = _named(turbine, mesh, flooded)
            fits.append((Alternative(name, mesh_probability * probability), fit))
    return JointInference(
        fits,
        structure=turbine,
        layout=layout,
        prior=prior,
        highest_sigma=settings.prior.highest_sigma,
    )


@lru_cache(maxsize=4)
def _figure_model(
    turbine: TurbineDescription, layout: SensorLayout, names: tuple[str, ...], mesh: BladeMesh
) -> FigureModel:
    """Built once a process for each structure: sessions, refreshes and turbines of one type share
    it."""
    return FigureModel(turbine, layout, names, blades=mesh)


def _meshes(turbine: TurbineDescription, *, exact: bool) -> list[tuple[BladeMesh, float]]:
    """How the blades may behave, with prior probabilities."""
    if turbine.blades is None or exact:
        return [("described", 1.0)]
    return [("converged", 0.5), ("described", 0.5)]


def _floodings(turbine: TurbineDescription, *, exact: bool) -> list[tuple[bool, float]]:
    if turbine.water is None or exact:
        return [(turbine.water is not None and turbine.water.inside, 1.0)]
    described = turbine.water.inside
    return [(described, 1 - UNDESCRIBED_FLOODING), (not described, UNDESCRIBED_FLOODING)]


def _named(turbine: TurbineDescription, mesh: BladeMesh, flooded: bool) -> str:
    words = []
    if turbine.blades is not None:
        words.append(f"{mesh} blades")
    if turbine.water is not None and flooded != turbine.water.inside:
        words.append("flooded" if flooded else "not flooded")
    return ", ".join(words) or "as described"


def _belief(population: StiffnessPopulation, coordinates: JointCoordinates) -> GaussianBelief:
    """A farm's prior of the springs as one Gaussian, outlying turbines in its spread."""
    drawn = population.draws(BELIEF_DRAWS, np.random.default_rng(0))
    u = coordinates.of_ratios(drawn)
    return GaussianBelief(
        ("k11", "k22", "k12"), u.mean(axis=0), np.asarray(np.linalg.inv(np.cov(u, rowvar=False)))
    )


__all__ = ["StructuralPrior", "joint_inference"]
