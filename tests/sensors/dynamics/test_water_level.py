"""How frequencies follow the water: perturbation of the modes against the structure built again."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.full_model_modes import full_modes
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine

LAYOUT = biaxial_layout(
    "tower-1", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
TURBINE = load_turbine("iea15mw_monopile")
WATCHED = ("4", "5", "7", "9", "26", "28", "33")  # .2 to .9 % a metre


@pytest.fixture(scope="module")
def model():
    return ModalModel(TURBINE, LAYOUT)


@pytest.mark.parametrize("rise", [-1.5, 0.6, 1.5])
def test_modes_in_risen_water_are_those_of_a_structure_built_in_it(model, rise):
    """Every mode of the whole model, solved in the risen water: frequencies and shapes."""
    found = model.in_water([rise])
    built = full_modes(TURBINE.with_water_level(rise), LAYOUT)
    for column in map(model.labels.index, WATCHED):
        f = found.frequencies[0, column]
        near = int(np.argmin(np.abs(built.frequencies / f - 1)))
        assert built.frequencies[near] == pytest.approx(f, rel=2e-6)
        assert built.shapes[near] == pytest.approx(found.shapes[0, column], abs=0.01)


def test_water_turns_the_shapes_of_the_modes_that_bend_the_monopile(model):
    """By several hundredths of the largest component over the tide: it cannot be left out."""
    low, high = model.in_water([-1.5, 1.5]).shapes[:, model.labels.index("30")]
    assert np.abs(high - low).max() > 0.05


def test_still_water_leaves_the_modes_as_they_are(model):
    found, still = model.in_water([0.0]), model.modal(model.nominal)
    assert found.frequencies == pytest.approx(still.frequencies, rel=1e-9)
    assert found.shapes == pytest.approx(still.shapes, abs=1e-5)


def test_higher_water_is_more_mass_and_lowers_every_frequency(model):
    low, high = model.in_water([0.0, 1.0]).frequencies
    assert np.all(high <= low * (1 + 1e-12))


def test_a_turbine_on_land_does_not_know_the_water():
    dry = ModalModel(replace(TURBINE, water=None), LAYOUT)
    low, high = dry.in_water([-1.0, 1.0]).frequencies
    assert np.array_equal(low, high)


@pytest.mark.parametrize("rise", [3.0, -2.2])
def test_a_model_in_risen_water_is_the_one_that_is_built_there(model, rise):
    """The same modes under the same names, for other springs than those it was followed from."""
    found = model.with_water_risen(rise)
    built = ModalModel(TURBINE.with_water_level(rise), LAYOUT)
    assert found.water_level == pytest.approx(rise)
    assert found.labels == model.labels
    theta = model.nominal * [[1.0, 1.0, 1.0], [1.3, 0.9, 1.05], [0.7, 0.8, 0.75]]
    one, other = found.modal(theta), built.modal(theta)
    watched = [model.labels.index(label) for label in WATCHED]
    assert one.frequencies[:, watched] == pytest.approx(
        other.frequencies[:, [built.labels.index(label) for label in WATCHED]], rel=1e-5
    )


def test_a_model_on_land_stays_as_the_water_rises():
    dry = ModalModel(replace(TURBINE, water=None), LAYOUT)
    assert dry.with_water_risen(1.0) is dry
