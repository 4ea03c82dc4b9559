"""The scenario of each turbine of a farm."""

from dataclasses import replace

import numpy as np

from pipeline.scenario.settings import FarmMember, FarmSettings, Scenario, ScenarioError
from sensors.structure.foundation import positive_definite


def farm_members(scenario: Scenario) -> tuple[Scenario, ...]:
    """Return the scenario of each turbine.

    An id, a seed and, about the scenario's, a truth of its own.

    A farm of one is the scenario itself. Truths that are not positive definite are drawn again.
    """
    farm = scenario.farm
    if farm.size == 1 and not farm.members:
        return (scenario,)
    truths = np.random.default_rng([scenario.seed, farm.size])
    numbers = range(1, farm.size + 1)
    members = tuple(_member(scenario, number, truths) for number in numbers)
    ids = [member.turbine.id for member in members]
    for name in ids:
        if ids.count(name) > 1:
            raise ScenarioError(f"[farm] has {ids.count(name)} turbines called {name!r}")
    return members


def _member(scenario: Scenario, number: int, truths: np.random.Generator) -> Scenario:
    own = scenario.farm.member(number)
    turbine, sensors = scenario.turbine, scenario.sensors
    member = replace(
        scenario,
        seed=1000 * scenario.seed + number,
        turbine=replace(
            turbine,
            id=own.id or f"{turbine.id}-{number}",
            description=own.description or turbine.description,
            springs_sign=own.springs_sign or turbine.springs_sign,
        ),
        sensors=replace(
            sensors,
            unit=own.unit or sensors.unit,
            layout_id=own.layout_id or f"{sensors.layout_id}-{number}",
            elevations=own.elevations or sensors.elevations,
        ),
        farm=FarmSettings(),
    )
    if not scenario.has_structure:
        return member
    ratios = _true_ratios(member, scenario.farm, own, truths)
    return replace(member, simulation=replace(scenario.simulation, stiffness_ratios=ratios))


def _true_ratios(
    member: Scenario, farm: FarmSettings, own: FarmMember, truths: np.random.Generator
) -> tuple[float, float, float]:
    """k / nominal, drawn until positive definite."""
    nominal, centre = member.structure.nominal, np.array(member.simulation.stiffness_ratios)
    for _ in range(1000):
        even = 1.0 + truths.uniform(-farm.spread, farm.spread, 3)
        scatter = np.exp(farm.log_std * truths.standard_normal(3)) if farm.log_std else 1.0
        ratios = centre * own.stiffness * even * scatter
        if positive_definite(ratios * nominal):
            k11, k22, k12 = ratios.tolist()
            return k11, k22, k12
    raise ScenarioError(
        f"[farm] turbine {member.turbine.id}: of 1000 drawn foundations about "
        f"{(centre * own.stiffness).tolist()} times nominal none is positive definite"
    )
