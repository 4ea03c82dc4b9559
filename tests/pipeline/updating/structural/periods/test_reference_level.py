"""Springs over those before an event, where the water stood at another level before it."""

from collections.abc import Sequence

import numpy as np
import pytest

from pipeline.messages import FoundationEvent, FoundationPosterior, ModalEstimate
from pipeline.scenario import scenario_from_text
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import parse_turbine
from tests.pipeline.updating.small_tower import drawn_mode

TOWER = """
name = "small"
title = "5 MW on a slender monopile"
gravity = 9.81
tubes = [
  { bottom = -20.0, top = -10.0, diameter = 6.0, thickness = 0.06, material = "steel" },
  { bottom = -10.0, top = 0.0, diameter = 6.0, thickness = 0.06, material = "steel" },
  { bottom = 0.0, top = 10.0, diameter = 6.0, thickness = 0.06, material = "steel" },
  { bottom = 10.0, top = 36.0, diameter = 5.7, thickness = 0.027, material = "steel" },
  { bottom = 36.0, top = 62.0, diameter = 5.0, thickness = 0.024, material = "steel" },
  { bottom = 62.0, top = 88.0, diameter = 4.3, thickness = 0.021, material = "steel" },
]
[foundation]
k11 = 2.57e9
k22 = 2.63e11
k12 = 2.25e10
sign = "embedded-pile"
[water]
level = 0.0
[materials.steel]
youngs_modulus = 210e9
density = 8500.0
[[rotor_nacelle.bodies]]
name = "nacelle"
mass = 350e3
centre = [-1.0, 0.0, 2.0]
inertia = [4e7, 2e7, 2e7]
"""
TURBINE = parse_turbine(TOWER, source="test")
LAYOUT = biaxial_layout("tower", turbine="t", unit="tower", elevations=[15.0, 40.0, 62.0, 85.0])
SCENARIO = scenario_from_text(
    '[structure.uncertain]\ntube_shear = "exact"\nflooding = "exact"\n', "test"
)
SCOURED = np.array([0.73, 0.94, 0.86])  # k11, k22, k12 over those before: 2 m less soil
TIDE = (1.5, 1.5, 0.0)  # levels of the windows before the event, again and again [m]
BEFORE, AFTER = 12, 4  # windows


def estimates(ratios: np.ndarray, levels: Sequence[float], first: int) -> list[ModalEstimate]:
    """Windows of the described tower on these springs, each in its water."""
    found, models = (
        [],
        {each: ModalModel(TURBINE.with_water_level(each), LAYOUT) for each in levels},
    )
    for number, level in enumerate(levels, first):
        modal = models[level].modal((ratios * models[level].nominal)[None])
        generator = np.random.default_rng([71, number])
        modes = tuple(
            drawn_mode(f, shape, generator, 5e-4, 5e-3, name=f"m{place}")
            for place, (f, shape) in enumerate(
                zip(modal.frequencies[0], modal.shapes[0], strict=True)
            )
            if f < 8.0 and np.abs(shape).max() > 0
        )
        start = number * 600_000_000_000
        found.append(
            ModalEstimate(
                turbine="t",
                window=number,
                start_ns=start,
                end_ns=start + 600_000_000_000,
                layout_id=LAYOUT.layout_id,
                channels=LAYOUT.channel_names,
                modes=modes,
                water_level=level,
            )
        )
    return found


def test_modes_that_move_far_lose_the_water_level_of_the_windows_before_an_event() -> None:
    """After scour at low water the modes of before, at high water, have no partner among the
    model's: with their level in them they contradicted the others, and scour was a rise."""
    settings = SCENARIO.updating
    joint = joint_inference(TURBINE, LAYOUT, settings, seed=1)
    updater = FoundationUpdater(ModalModel(TURBINE, LAYOUT), LAYOUT, settings, seed=1, joint=joint)
    state = updater.initial_state()
    before = estimates(np.ones(3), TIDE * (BEFORE // len(TIDE)), 0)
    for estimate in before[:-1]:
        state, _ = updater.accumulated(state, estimate)
    state, _ = updater.watched(state, before[-1])
    answers: list[object] = []
    for estimate in estimates(SCOURED, [0.0] * AFTER, BEFORE):
        state, given = updater.accumulated(state, estimate)
        answers.append(given)
    state, posterior = updater.refreshed(state, estimate)
    assert sum(isinstance(each, FoundationEvent) for each in answers) == 1
    assert isinstance(posterior, FoundationPosterior)
    assert posterior.relative
    for spring, true in zip(posterior.relative, SCOURED, strict=True):
        assert spring.p05 < true < spring.p95, spring.name
        assert spring.median == pytest.approx(true, rel=0.1), spring.name
