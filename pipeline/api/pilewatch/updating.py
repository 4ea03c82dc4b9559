"""What `update` is made of: a session's settings, its updating node, without a session."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sensors.acquisition.layout import SensorLayout

from .structure import Structure

if TYPE_CHECKING:
    from pipeline.messages import ModalEstimate
    from pipeline.nodes.updating import Answer
    from pipeline.scenario import Scenario


def chosen_scenario(
    scenario: str | os.PathLike[str] | None, *, exact: bool, seed: int | None
) -> Scenario:
    """The settings of an updating: a scenario's, or the defaults of one that sets nothing.

    Raises
    ------
    InputError
        If there is no such scenario, or the recording holds none.
    """
    from pipeline.scenario import load_scenario, scenario_from_text, with_overrides, with_structure
    from pipeline.sources.sources import replayed
    from pipeline.updating.structural.settings import StructureSettings

    if scenario is None:
        chosen = scenario_from_text("", "pilewatch.update")
    elif Path(scenario).suffix == ".mcap":
        chosen = replayed(Path(scenario)).scenario
    else:
        chosen = load_scenario(os.fspath(scenario))
    if exact:
        chosen = with_structure(chosen, StructureSettings(exact=True))
    return with_overrides(chosen, seed=seed)


def updated(
    estimates: Sequence[ModalEstimate],
    structure: Structure,
    layout: SensorLayout,
    scenario: Scenario,
) -> list[Answer]:
    """Every posterior, event and rejected window, in order, as a session of these gives them."""
    from pipeline.nodes.updating import TurbineUpdating
    from pipeline.runtime.runner import one_blas_thread
    from pipeline.updating.structural.inference import joint_inference
    from pipeline.updating.updater import FoundationUpdater

    settings, population = scenario.updating, scenario.population
    with one_blas_thread():
        joint = joint_inference(
            structure.description, layout, settings, seed=scenario.seed, population=population
        )
        updater = FoundationUpdater(
            structure.model(layout),
            layout,
            settings,
            seed=scenario.seed,
            population=population,
            joint=joint,
        )
        node = TurbineUpdating(updater, layout, scenario.operation)
        return [answer for estimate in estimates for answer in node.handle(estimate)]
