"""What a posterior says of the structure's figures: in their unit, narrowed against their prior."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.updating.structural.joint_message import (
    HALF_NORMAL_90,
    NORMAL_90,
    _figures,
    _unstated_inertia,
    _unstated_mass,
)
from pipeline.updating.structural.prior import UncertainFigure
from pipeline.updating.structural.sensors.figures import SensorFigure
from sensors.structure.components import RigidBody, RotorNacelle, Vector
from sensors.structure.foundation import FoundationSprings, SpringSign


def test_figures_level_and_sensors_stand_in_their_units_narrowed_against_their_priors() -> None:
    """Every value is spread as its prior has it, but the first: it is known ten times better."""
    z = np.linspace(-1.645, 1.645, 2001)  # its 5 and 95 % quantiles lie 10 % further in
    figures = (UncertainFigure("rna_mass", 0.02), UncertainFigure("transition_piece", 150e3))
    sensors = (SensorFigure("heading", "80 m", "deg", 2.0, (0, 1)),)
    coordinates = SimpleNamespace(
        figures=figures,
        level_std=0.1,
        departures=lambda u: np.column_stack([0.002 * u, 150e3 * np.abs(u)]),
        level=lambda u: 0.1 * u,
        sensors=lambda u: u[:, None],
    )
    fit = SimpleNamespace(coordinates=coordinates, sensors=SimpleNamespace(figures=sensors))
    found = SimpleNamespace(best=SimpleNamespace(fit=fit), u=z)
    rna, piece, level, heading = _figures(found)  # type: ignore[arg-type]
    assert [each.name for each in (rna, piece, level, heading)] == [
        *("rna_mass", "transition_piece"), "water_level", "heading 80 m",
    ]  # fmt: skip
    assert [each.unit for each in (rna, piece, level, heading)] == ["-", "kg", "m", "deg"]
    assert [rna.nominal, rna.median] == pytest.approx([1.0, 1.0])
    assert [piece.nominal, level.nominal, heading.nominal] == [0.0, 0.0, 0.0]
    reach = 0.9 * 1.645
    assert (rna.p05, rna.p95) == pytest.approx((1 - 0.002 * reach, 1 + 0.002 * reach))
    assert (level.p05, level.p95) == pytest.approx((-0.1 * reach, 0.1 * reach))
    assert (heading.p05, heading.p95) == pytest.approx((-2 * reach, 2 * reach))
    assert rna.contraction == pytest.approx(1 - 0.1 * 2 * reach / NORMAL_90)
    assert level.contraction == heading.contraction == pytest.approx(1 - 2 * reach / NORMAL_90)
    assert piece.contraction == pytest.approx(1 - 0.9 * 1.645 / HALF_NORMAL_90, abs=1e-3)
    assert pytest.approx(2 * 1.6449, abs=1e-4) == NORMAL_90
    assert pytest.approx(1.95996 - 0.06271, abs=1e-4) == HALF_NORMAL_90


@pytest.mark.parametrize(
    ("sign", "moving_mass", "codes"),
    [
        ("embedded-pile", None, ["pile-mass"]),
        ("embedded-pile", 0.0, []),
        ("embedded-pile", 2e4, []),
        ("published", None, []),
    ],
)
def test_a_pile_whose_mass_nobody_stated_is_warned_of(
    sign: SpringSign, moving_mass: float | None, codes: list[str]
) -> None:
    foundation = FoundationSprings(1e10, 8e11, 6e10, sign, moving_mass=moving_mass)
    assert [warning.code for warning in _unstated_mass(foundation)] == codes


@pytest.mark.parametrize(
    ("mass", "inertia", "codes"),
    [
        (240e3, (0.0, 0.0, 0.0), ["nacelle-inertia"]),
        (240e3, (0.0, 0.0, 2e6), []),
        (0.0, (0.0, 0.0, 0.0), []),
    ],
)
def test_a_nacelle_whose_inertia_is_not_stated_is_warned_of(
    mass: float, inertia: Vector, codes: list[str]
) -> None:
    top = RotorNacelle((RigidBody("nacelle", mass, inertia=inertia),), hub_mass=5e4)
    assert [warning.code for warning in _unstated_inertia(top)] == codes
