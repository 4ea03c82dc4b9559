"""The outside model of the tower on its springs against pyBModes, where it is installed."""

from dataclasses import replace

import numpy as np
import pytest

from tests.outside.figures import Figures
from tests.outside.model import NOMINAL, SpringSign, assemble
from tests.outside.peers import lumped_description, pybmodes_frequencies
from tests.outside.sections import MUDLINE


@pytest.mark.peer
@pytest.mark.parametrize("sign", ["published", "embedded-pile"])
@pytest.mark.parametrize(
    ("gravity", "height", "level"),
    [(0.0, 4.2, 1.5), (9.81, 0.0, MUDLINE)],
    ids=["in water, weightless", "in air, heavy"],
)
def test_tower_monopile_and_springs_have_the_frequencies_pybmodes_finds(
    sign: SpringSign, gravity: float, height: float, level: float
) -> None:
    pybmodes = pytest.importorskip("pybmodes")
    described = lumped_description(gravity=gravity, height=height)
    theirs = pybmodes_frequencies(pybmodes, described, NOMINAL, sign, water_level=level)
    bending = theirs[np.append(False, np.diff(theirs) < 1e-5 * theirs[1:])]  # of two planes alike
    figures = replace(Figures(), water_level=level, added_mass=float(level > MUDLINE))
    mine = assemble(figures, described).modes(NOMINAL, sign, 20.0).frequencies
    nearest = mine[np.abs(mine[:, None] / bending - 1).argmin(axis=0)]
    assert len(bending) >= 6
    assert nearest == pytest.approx(bending, rel=1e-5)
