"""What a figure of the description that is off does to the modes."""

import numpy as np
import pytest

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.description_variants import VARIATIONS, varied
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.foundation import TurbineError

LAYOUT = biaxial_layout(
    "tower-1", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)


@pytest.fixture(scope="module")
def model():
    return ModalModel(load_turbine("iea15mw_monopile"), LAYOUT)


@pytest.mark.parametrize("name", VARIATIONS)
def test_frequencies_answer_by_the_energy_that_the_figure_has_a_share_in(model, name):
    """Rayleigh: d ln f = ½ (φᵀ dK φ / ω² − φᵀ dM φ) of a mass-normalised mode."""
    step = 1e-3
    other = varied(model.description, name, 1 + step)
    changed, still = assemble(other), assemble(model.description)
    vectors = model._reference.vectors
    squares = (2 * np.pi * model.modal(model.nominal).frequencies[0]) ** 2
    stiffer = np.einsum("im,ij,jm->m", vectors, changed.stiffness - still.stiffness, vectors)
    heavier = np.einsum("im,ij,jm->m", vectors, changed.mass - still.mass, vectors)
    expected = (stiffer / squares - heavier) / 2 / step
    found, _ = model.responses(name)
    assert found == pytest.approx(expected, abs=2e-3)


def test_a_stiffer_steel_raises_the_elastic_modes_by_less_than_its_root(model):
    """f ~ √E where the tubes alone bend; blades, foundation and gravity share in every mode."""
    answers, _ = model.responses("steel_modulus")
    assert np.all((answers > -1e-6) & (answers < 0.5))
    assert answers[:2] == pytest.approx(0.4, abs=0.1)


def test_shapes_answer_as_the_model_of_the_other_turbine_has_them(model):
    factor = 1.03
    other = ModalModel(varied(model.description, "rna_mass", factor), LAYOUT)
    of_table = [model.labels.index(str(n)) for n in range(1, 12)]
    theirs = [other.labels.index(str(n)) for n in range(1, 12)]
    here = model.modal(model.nominal).shapes[0, of_table]
    there = other.modal(model.nominal).shapes[0, theirs]
    _, slopes = model.responses("rna_mass")
    predicted = here + (factor - 1) * slopes[of_table]
    moved, left = np.abs(there - here).max(axis=1), np.abs(there - predicted).max(axis=1)
    assert np.all(left < 0.1 * moved + 1e-4)


def test_scour_softens_every_spring_and_most_the_lateral_one(model):
    softer = model.scoured(np.tile(model.nominal, (3, 1)), [0.0, 2.0, 5.0]) / model.nominal
    assert softer[0] == pytest.approx(1.0)
    assert np.all(np.diff(softer, axis=0) < 0)
    assert np.all((softer[1:, 0] < softer[1:, 2]) & (softer[1:, 2] < softer[1:, 1]))


def test_what_a_turbine_does_not_have_cannot_be_uncertain(model):
    with pytest.raises(TurbineError, match=r"no figure 'paint' can be varied; there are rna_mass"):
        model.responses("paint")
    with pytest.raises(TurbineError, match="scour needs the pile's embedded_length"):
        ModalModel(load_turbine("iea15mw_detailed"), LAYOUT).scoured(model.nominal[None], [1.0])
