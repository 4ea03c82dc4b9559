"""One TOML file is the whole experiment: turbine, sensors, simulation, identification, updating.

settings.py      what a scenario may set, a type for each section
loading.py       scenarios from names, files and recordings; what a recording stores of one
farm_members.py  the scenario of each turbine of a farm
differences.py   in what two scenarios would give other results

Shipped scenarios live in `pipeline/scenarios`; a path to a file of one's own works wherever a
name does. The text of the scenario is stored in every recording, so that any recording can be
run again.
"""

from pipeline.scenario.farm_members import farm_members
from pipeline.scenario.loading import (
    MODES_ONLY,
    load_scenario,
    modes_only,
    require_stated_structure,
    scenario_from_metadata,
    scenario_from_text,
    scenario_metadata,
    shipped_scenarios,
    with_overrides,
    with_sampler,
    with_structure,
)
from pipeline.scenario.settings import (
    DEFAULT_SCENARIO,
    NO_STRUCTURE,
    Scenario,
    ScenarioError,
    TurbineSettings,
)

__all__ = [
    "DEFAULT_SCENARIO",
    "MODES_ONLY",
    "NO_STRUCTURE",
    "Scenario",
    "ScenarioError",
    "TurbineSettings",
    "farm_members",
    "load_scenario",
    "modes_only",
    "require_stated_structure",
    "scenario_from_metadata",
    "scenario_from_text",
    "scenario_metadata",
    "shipped_scenarios",
    "with_overrides",
    "with_sampler",
    "with_structure",
]
