"""How frequencies follow the water: perturbation of the modes against the structure built anew."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.layout import biaxial_layout
from sensors.turbine.description import load_turbine
from sensors.turbine.modal import ModalModel
from sensors.turbine.whole import full_modes

LAYOUT = biaxial_layout(
    "tower-1", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)
TURBINE = load_turbine("iea15mw_monopile")
WATCHED = ("4", "5", "7", "9", "26", "28", "33")  # .2 to .9 % a metre


@pytest.fixture(scope="module")
def model():
    return ModalModel(TURBINE, LAYOUT)


@pytest.mark.parametrize("rise", [-1.5, 0.6, 1.5])
def test_the_parabola_is_what_a_structure_in_deeper_water_does(model, rise):
    """Every mode of the whole model, solved in the risen water."""
    slope, curvature = model.water_curves().T
    risen = full_modes(TURBINE.with_water_level(rise), LAYOUT)
    still = model.modal(model.nominal)
    for column in map(model.labels.index, WATCHED):
        f = still.frequencies[0, column]
        expected = np.log(f) + slope[column] * rise + curvature[column] * rise**2
        near = risen.frequencies[np.argmin(np.abs(np.log(risen.frequencies) - expected))]
        assert np.log(near) == pytest.approx(expected, abs=2e-4)


def test_higher_water_is_more_mass_and_lowers_every_frequency(model):
    assert np.all(model.water_curves()[:, 0] <= 0)


def test_a_turbine_on_land_does_not_know_the_water():
    dry = ModalModel(replace(TURBINE, water=None), LAYOUT)
    assert np.all(dry.water_curves() == 0)
