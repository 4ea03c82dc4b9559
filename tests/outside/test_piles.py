"""The pile below the mudline: what it is at rest, and that without mass it is its springs."""

from dataclasses import replace

import numpy as np

from tests.benchmarks.piles import STEEL, drawn_pile
from tests.outside.model import NOMINAL, assemble, converged
from tests.outside.piles import Pile, modes_on

RIGIDITY = 4.46e12  # of a tube of 10 m with a wall of 55 mm [N·m²]
LONG = Pile(length=120.0, rigidity=RIGIDITY, moving_mass=13.5e3, bed=3e8, power=0.0)


def test_springs_of_a_long_pile_on_an_even_bed_are_the_closed_form() -> None:
    """k11 = 4 E I β³, k22 = 2 E I β, k12 = 2 E I β² with β⁴ = bed / (4 E I).

    Source: M. Hetényi, "Beams on Elastic Foundation", 1946, of the semi-infinite beam.
    """
    beta = (LONG.bed / (4 * RIGIDITY)) ** 0.25
    expected = RIGIDITY * np.array([4 * beta**3, 2 * beta, 2 * beta**2])
    np.testing.assert_allclose(LONG.springs, expected, rtol=1e-3)


def test_without_mass_a_pile_is_its_springs() -> None:
    structure = assemble(description=converged())
    massless = replace(LONG, length=35.0, power=1.0, bed=1e9, moving_mass=0.0)
    found = modes_on(replace(massless, moving_mass=1e-3), structure)
    expected = structure.modes(massless.springs, "embedded-pile")
    np.testing.assert_allclose(found.frequencies, expected.frequencies, rtol=1e-7)
    common = found.vectors.T @ structure.mass @ expected.vectors
    np.testing.assert_allclose(np.abs(np.diag(common)), 1.0, rtol=1e-6)


def test_mass_lowers_every_mode_that_moves_the_mudline() -> None:
    structure = assemble(description=converged())
    pile = replace(LONG, length=35.0, power=1.0, bed=1e9)
    heavy = modes_on(pile, structure).frequencies
    light = modes_on(replace(pile, moving_mass=1e-3), structure).frequencies
    lowest = heavy[light < 8]
    assert (lowest < light[light < 8] * (1 + 1e-9)).all()
    assert (lowest / light[light < 8]).min() < 0.998


def test_drawn_piles_have_springs_about_the_nominal_rotation_and_more_mass_than_steel() -> None:
    drawn = [drawn_pile(np.random.default_rng(seed)) for seed in range(20)]
    rotation = np.array([pile.springs[1] for pile, _ in drawn]) / NOMINAL[1]
    assert (rotation > 0.8 * (1 - 1e-6)).all()
    assert (rotation < 1.25 * (1 + 1e-6)).all()
    off = np.array([pile.moving_mass / stated - 1 for pile, stated in drawn])
    assert 0.15 < off.std() < 0.45
    assert all(STEEL <= stated <= 2 * STEEL for _, stated in drawn)
