"""Modes for many departures of the figures: against the full model, and by differences."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.figure_model import FigureModel, converged, tabulated_levels
from sensors.dynamics.full_model_modes import full_modes, solved_modes
from sensors.structure.assembly import assemble
from sensors.structure.components import PointMass, Tube, Water
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.figures import BY_NAME, LEVEL, figures_of, varied
from sensors.structure.foundation import FoundationSprings, TurbineError, positive_definite
from sensors.structure.sensor_readings import ChannelReadings

LAYOUT = biaxial_layout("t", turbine="t", unit="u", elevations=(41.0, 80.0, 106.0, 145.0))
PARKED = load_turbine("iea15mw_monopile")
TURBINE = replace(
    PARKED,
    foundation=replace(PARKED.foundation, moving_mass=3e4),
    tubes=(*PARKED.tubes[:-1], replace(PARKED.tubes[-1], attached_mass=900.0)),
    point_masses=(PointMass("transition piece", 15.0, 200e3), PointMass("damper", 130.0, 10e3)),
)
NAMES = [figure.name for figure in figures_of(TURBINE)]


@pytest.fixture(scope="module")
def model() -> FigureModel:
    return FigureModel(TURBINE, LAYOUT, NAMES)


def drawn_points(n: int, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Springs over the prior box, figures and levels from their priors."""
    rng = np.random.default_rng(seed)
    theta = TURBINE.nominal * np.exp(rng.uniform(np.log(0.25), np.log(4.0), (6 * n, 3)))
    theta = theta[positive_definite(theta)][:n]
    z = rng.standard_normal((n, len(NAMES)))
    half = np.array([BY_NAME[name].distribution == "half-normal" for name in NAMES])
    stds = np.array([BY_NAME[name].std for name in NAMES])
    return theta, np.where(half, np.abs(z), z) * stds, rng.normal(0.0, 1.0, n)


@pytest.mark.parametrize(("flooded", "most_off"), [(False, 1e-5), (True, 5e-5)])
def test_every_mode_is_that_of_the_full_model_with_the_same_departures(
    model: FigureModel, flooded: bool, most_off: float
) -> None:
    """One basis serves both; it is spanned a third by flooded structures."""
    assert TURBINE.water is not None
    turbine = replace(TURBINE, water=replace(TURBINE.water, inside=flooded))
    theta, departures, levels = drawn_points(5, seed=3)
    found = model.with_flooding(flooded).modes(theta, departures, levels)
    for row in np.flatnonzero(found.admissible):
        off = dict(zip(NAMES, departures[row], strict=True)) | {LEVEL: float(levels[row])}
        full = assemble(converged(varied(turbine, off)), stiffness=theta[row])
        modes = solved_modes(full, ChannelReadings.of(full, LAYOUT), highest_frequency=12.6)
        frequencies = found.frequencies[row][np.isfinite(found.frequencies[row])]
        nearest = np.abs(modes.frequencies / frequencies[:, None] - 1).min(axis=1)
        assert nearest.max() < most_off


def test_derivatives_are_those_of_differences(model: FigureModel) -> None:
    theta, departures, levels = (each[2] for each in drawn_points(3, seed=4))
    here = model.linearised(theta, departures, float(levels))
    assert here is not None
    point = np.concatenate([theta, departures, [levels]])
    scales = np.concatenate([0.1 * theta, [BY_NAME[name].std for name in NAMES], [1.0]])
    for column, scale in enumerate(scales):
        step = np.zeros(len(point))
        step[column] = 1e-4 * scale
        ends = [point + step, point - step]
        more, less = (model.linearised(x[:3], x[3:-1], float(x[-1])) for x in ends)
        assert more is not None
        assert less is not None
        slope = np.log(more.frequencies / less.frequencies) / 2e-4
        expected = here.log_frequency_slopes[:, column] * scale
        np.testing.assert_allclose(slope, expected, atol=2e-4 * np.abs(expected).max() + 2e-5)


def test_a_tower_on_land_has_no_figure_of_the_water() -> None:
    names = {figure.name for figure in figures_of(replace(TURBINE, water=None))}
    assert not names & {"added_mass", "marine_growth"}


def test_every_mode_on_land_is_that_of_the_full_model() -> None:
    """Where there is no water, its matrices have no entry at all."""
    land = replace(PARKED, water=None)
    names = [figure.name for figure in figures_of(land)]
    model = FigureModel(land, LAYOUT, names, blades="described")
    theta, nothing = land.nominal * [1.2, 0.8, 0.9], np.zeros((1, len(names)))
    found = model.modes(theta[None], nothing, np.zeros(1)).frequencies[0]
    full = assemble(converged(land, "described"), stiffness=theta)
    modes = solved_modes(full, ChannelReadings.of(full, LAYOUT), highest_frequency=12.6)
    nearest = np.abs(modes.frequencies / found[np.isfinite(found)][:, None] - 1).min(axis=1)
    assert len(nearest) > 20
    assert nearest.max() < 1e-5


def mast(bottom: float, top: float, level: float, thickness: float = 0.003) -> TurbineDescription:
    """A pipe of .2 m in water that ends where a tower would not."""
    tube = Tube(bottom, top, 0.2, thickness, youngs_modulus=210e9, density=7850.0)
    springs = FoundationSprings(k11=1e7, k22=1e7, k12=1e5)
    return TurbineDescription("m", (tube,), springs, water=Water(level=level)).meshed()


SHORT_OR_DRY = [
    pytest.param(mast(-10.0, 5.0, 0.0), id="it ends less than 6 m above the water"),
    pytest.param(mast(-0.6, 2.0, 0.0), id="it stands in a flume"),
    pytest.param(mast(-0.6, 2.0, 1.9), id="it is almost under water"),
    pytest.param(mast(-20.0, 10.0, -25.0), id="the sea is below the foot"),
    pytest.param(mast(4.6, 20.0, 0.0), id="waves only reach the foot"),
    pytest.param(mast(5.9, 20.0, 0.0), id="the highest level only reaches the foot"),
    pytest.param(mast(-5.0, 10.0, 0.0, thickness=0.1), id="it is a solid rod"),
]


@pytest.mark.parametrize("turbine", SHORT_OR_DRY)
def test_structures_unlike_towers_have_the_modes_of_the_full_model(
    turbine: TurbineDescription,
) -> None:
    layout = biaxial_layout("t", turbine="m", unit="u", elevations=(turbine.tower_top,))
    names = [figure.name for figure in figures_of(turbine)]
    model = FigureModel(turbine, layout, names, highest_frequency=60.0)
    point = turbine.nominal[None], np.zeros((1, len(names))), np.zeros(1)
    found = model.modes(*point).frequencies[0]
    full = full_modes(converged(turbine), layout, highest_frequency=61.0).frequencies
    nearest = np.abs(full / found[np.isfinite(found)][:, None] - 1).min(axis=1)
    assert len(nearest) >= 2
    assert nearest.max() < 2e-4


def test_a_structure_too_short_for_three_levels_of_the_water_is_refused() -> None:
    with pytest.raises(TurbineError, match="in water is 1 m or more tall; this"):
        tabulated_levels(mast(-0.3, 0.2, 0.0))
