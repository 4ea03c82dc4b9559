"""The joint inference of one turbine from its description, layout and settings."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit

from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.prior import UpdatingError
from pipeline.updating.structural.alternatives import (
    UNDESCRIBED_FLOODING,
    Alternative,
    JointInference,
)
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.prior import (
    N_SPRINGS,
    GaussianBelief,
    JointCoordinates,
    StructuralPrior,
)
from pipeline.updating.structural.sensors.figures import (
    GAIN_STD,
    HEADING_STD,
    HEIGHT_STD,
    SensorReadings,
    sensor_figures,
)
from pipeline.updating.structural.settings import StructureSettings
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.figure_model import BladeMesh, FigureModel
from sensors.structure.calibration import Calibration
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import SPRING_SIGNS

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
    """Springs and figures of one turbine; None where its structure is taken as exact.

    Parameters
    ----------
    turbine : TurbineDescription
        One with a calibration begins with what that reports of the figures.
    layout : SensorLayout
        Where the sensors are.
    settings : UpdatingSettings
        With the priors of springs and figures.
    seed : int, optional
        Of the starts of the fits.
    population : StiffnessPopulation, optional
        What a farm's other turbines imply of this one's springs; None: the turbine alone.

    Raises
    ------
    UpdatingError
        If the calibration was made with other priors, springs or alternatives.
    """
    structure = settings.structure
    if structure.exact:
        return None
    prior = structure.prior(turbine)
    sensors = SensorReadings(
        sensor_figures(
            layout,
            gain=structure.std("sensor_gain", GAIN_STD),
            heading=structure.std("sensor_heading", HEADING_STD),
            height=structure.std("sensor_height", HEIGHT_STD),
        ),
        len(layout.channels),
    )
    coordinates = JointCoordinates(
        turbine.nominal,
        prior.figures,
        prior.known_level_std,
        sensor_names=sensors.names,
    )
    calibration, turbine = turbine.calibration, replace(turbine, calibration=None)
    floor = min(settings.likelihood.shape_floor, SHAPE_FLOOR)
    likelihood = replace(settings.likelihood, shape_floor=floor)
    if calibration is not None:
        _check(calibration, prior_stds(prior, sensors), turbine)
    fits, structures = [], {}

    def fit_of(each: _Structure, described: TurbineDescription) -> JointFit:
        if each.shear != described.has_shear:
            described = described.with_shear(each.shear)
        model = _figure_model(described, layout, prior.names, each.mesh)
        return JointFit(
            model.with_flooding(each.flooded),
            coordinates.with_belief(each.belief),
            likelihood=likelihood,
            pairing=settings.pairing,
            generator=np.random.default_rng([seed, SEARCH_SEED]),
            sensors=sensors,
        )

    for each in _structures(turbine, structure):
        alternative, belief = each.alternative, None
        if calibration is not None:
            weight, belief = _calibrated(calibration, alternative.name, coordinates)
            if belief is None:
                continue
            alternative = replace(alternative, probability=weight)
        if population is not None:
            belief = _with_population(population, coordinates, belief)
        structures[alternative.name] = known = replace(each, belief=belief)
        fits.append((alternative, fit_of(known, turbine)))
    if not fits:
        raise UpdatingError(
            f"{turbine.name}: the calibration is of no structure that the scenario allows: "
            "calibrate with the scenario's [structure.uncertain]"
        )
    return JointInference(
        fits,
        structure=turbine,
        layout=layout,
        prior=prior,
        highest_sigma=settings.prior.highest_sigma,
        other_sign=lambda name: fit_of(structures[name], _mirrored(turbine)),
    )


def _mirrored(turbine: TurbineDescription) -> TurbineDescription:
    """The same turbine with k12 of the other sign."""
    (other,) = (sign for sign in SPRING_SIGNS if sign != turbine.foundation.sign)
    return turbine.with_sign(other)


@lru_cache(maxsize=8)
def _figure_model(
    turbine: TurbineDescription, layout: SensorLayout, names: tuple[str, ...], mesh: BladeMesh
) -> FigureModel:
    """Built once a process for each structure: sessions, refreshes and turbines of one type share
    it."""
    return FigureModel(turbine, layout, names, blades=mesh)


@dataclass(frozen=True, slots=True)
class _Structure:
    """One of the structures that a description may stand for."""

    alternative: Alternative
    mesh: BladeMesh
    flooded: bool
    shear: bool
    belief: GaussianBelief | None = None
    """What a calibration or a farm knows of its figures"""


def _structures(turbine: TurbineDescription, settings: StructureSettings) -> list[_Structure]:
    """Every combination of how the tubes and the blades may behave and of water inside."""
    return [
        _Structure(
            Alternative(
                _named(turbine, mesh, flooded, shear),
                share * probability * of_theory,
                _support(turbine, flooded, shear),
            ),
            mesh,
            flooded,
            shear,
        )
        for shear, of_theory in _theories(turbine, exact=settings.is_exact("tube_shear"))
        for mesh, share in _meshes(turbine, exact=settings.is_exact("blade_model"))
        for flooded, probability in _floodings(turbine, exact=settings.is_exact("flooding"))
    ]


def _theories(turbine: TurbineDescription, *, exact: bool) -> list[tuple[bool, float]]:
    """Whether the tubes deform by shear, with prior probabilities: a real tube does, many a
    program's model does not."""
    described = turbine.has_shear
    return [(described, 1.0)] if exact else [(described, 0.5), (not described, 0.5)]


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


def _named(turbine: TurbineDescription, mesh: BladeMesh, flooded: bool, shear: bool) -> str:
    blades = "" if turbine.blades is None else f"{mesh} blades"
    return ", ".join(filter(None, (blades, _support(turbine, flooded, shear)))) or "as described"


def _support(turbine: TurbineDescription, flooded: bool, shear: bool) -> str:
    words = []
    if turbine.water is not None and flooded != turbine.water.inside:
        words.append("flooded" if flooded else "not flooded")
    if shear != turbine.has_shear:
        words.append("tubes with shear" if shear else "tubes without shear")
    return ", ".join(words)


def _with_population(
    population: StiffnessPopulation, coordinates: JointCoordinates, figures: GaussianBelief | None
) -> GaussianBelief:
    """A farm's prior of the springs beside what is known of the figures.

    The farm has u − Lᵀ z, the springs less what errors z of the description make, as one Gaussian
    N(μ, S), outlying turbines in its spread: with R = (I, −Lᵀ) the precision Rᵀ S⁻¹ R is added to
    the figures'. Errors that are none of the coordinates widen S.
    """
    drawn = coordinates.of_ratios(population.as_described(BELIEF_DRAWS, np.random.default_rng(0)))
    rho = np.sqrt(expit(drawn[:, 2].mean()))
    common = population.common * np.array([1.0, 1.0, 2 / rho])  # d logit ρ² = 2 / ρ d atanh ρ
    effects = dict(zip(population.figures, common, strict=True))
    others = [row for name, row in effects.items() if name not in coordinates.names]
    shared = GaussianBelief((), np.empty(0), np.empty((0, 0))) if figures is None else figures
    names = dict.fromkeys((*shared.names, *(n for n in effects if n in coordinates.names)))
    rows = np.hstack([np.eye(N_SPRINGS), *(-_column(effects.get(name)) for name in names)])
    known = slice(N_SPRINGS, N_SPRINGS + len(shared.names))
    mean, precision = np.zeros(rows.shape[1]), np.diag([0.0] * N_SPRINGS + [1.0] * len(names))
    mean[known], precision[known, known] = shared.mean, shared.precision
    mean[:N_SPRINGS] = drawn.mean(axis=0) - rows[:, N_SPRINGS:] @ mean[N_SPRINGS:]
    covariance = np.cov(drawn, rowvar=False) + sum(np.outer(row, row) for row in others)
    precision += rows.T @ np.linalg.solve(covariance, rows)
    return GaussianBelief(("k11", "k22", "k12", *names), mean, precision)


def _column(effect: FloatArray | None) -> FloatArray:
    """(3, 1) of a figure's effect on the springs; zeros for a figure that the farm has exact."""
    return np.zeros((N_SPRINGS, 1)) if effect is None else effect[:, None]


# ---- a calibration -----------------------------------------------------------------------------


def prior_stds(prior: StructuralPrior, sensors: SensorReadings) -> dict[str, float]:
    """Standard deviation of every figure's prior, in its unit, by the coordinate's name."""
    figures = {figure.name: figure.std for figure in prior.figures}
    return figures | {figure.name: figure.std for figure in sensors.figures}


def _check(
    calibration: Calibration, stds: Mapping[str, float], turbine: TurbineDescription
) -> None:
    """Raise UpdatingError where the calibration's coordinates are not the scenario's."""
    sign = turbine.foundation.sign
    if calibration.springs_sign != sign:
        raise UpdatingError(
            f"{turbine.name}: calibrated with springs of sign {calibration.springs_sign!r}, used "
            f"with {sign!r}: calibrate again"
        )
    for name, std in zip(calibration.names, calibration.stds, strict=True):
        if name in stds and not np.isclose(std, stds[name]):
            raise UpdatingError(
                f"{turbine.name}: calibrated with a prior of std {std:g} for {name}, used with "
                f"{stds[name]:g}: leave [structure.uncertain] as it was, or calibrate again"
            )


def _calibrated(
    calibration: Calibration, name: str, coordinates: JointCoordinates
) -> tuple[float, GaussianBelief | None]:
    """Weight and belief of one alternative; None where the calibration has ruled it out.

    Figures that the session does not have, such as those of other sensors, are left out.
    """
    found = next((each for each in calibration.alternatives if each.name == name), None)
    if found is None:
        return 0.0, None
    names = coordinates.names
    kept = [i for i, figure in enumerate(calibration.names) if figure in names]
    return found.weight, GaussianBelief(
        tuple(calibration.names[i] for i in kept),
        np.array(found.mean)[kept],
        np.asarray(np.linalg.inv(found.matrix[np.ix_(kept, kept)])),
    )
