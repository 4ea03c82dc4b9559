"""The turbines of a session, each with its sensors, its structure and an updating of its own."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

from pipeline.nodes.node import Node
from pipeline.nodes.updating import FoundationUpdaterNode, UpdatingInContext
from pipeline.runtime.snapshots import CheckpointedUpdating, CheckpointFolder
from pipeline.scenario import Scenario, farm_members
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import SensorLayout
from sensors.dynamics.modal_model import ModalModel


class Turbines:
    """What is known of every turbine beforehand: by the scenario's farm, or by its own layout."""

    def __init__(
        self,
        scenario: Scenario,
        layout: SensorLayout,
        layouts: Mapping[str, SensorLayout],
        checkpoints: Path | None,
    ) -> None:
        """
        layout        of a turbine that is neither in `layouts` nor in the scenario's farm
        layouts       turbine → its own, where it is not as the scenario's farm has it
        checkpoints   folder of the updating's states; None: every one begins anew
        """
        self._scenario = scenario
        self._layout = layout
        self._farm = {each.turbine.id: each for each in farm_members(scenario)}
        self._layouts = {name: each.layout for name, each in self._farm.items()} | dict(layouts)
        self._checkpoints = checkpoints
        self._joints: dict[object, JointInference | None] = {}  # likewise
        self._models: dict[object, ModalModel] = {}  # turbines alike share one: it never changes

    def updating(self) -> UpdatingInContext:
        """One node for all of them."""
        others = {
            turbine: (partial(self._updating_of_one, turbine, layout), layout)
            for turbine, layout in self._layouts.items()
            if turbine != self._layout.turbine
        }
        first = partial(self._updating_of_one, self._layout.turbine, self._layout)
        return UpdatingInContext(first, self._layout, self._scenario.operation, special=others)

    def _updating_of_one(self, turbine: str, layout: SensorLayout) -> Node:
        scenario = self._scenario
        member = self._farm.get(turbine, scenario)
        updater = FoundationUpdater(
            self._model(member, layout),
            layout,
            scenario.updating,
            seed=scenario.seed,
            population=scenario.population,
            joint=self._joint(member, layout),
        )
        if self._checkpoints is None:
            return FoundationUpdaterNode(updater)
        return CheckpointedUpdating(updater, CheckpointFolder(self._checkpoints), layout.turbine)

    def _model(self, member: Scenario, layout: SensorLayout) -> ModalModel:
        kind = (member.turbine.description, member.turbine.springs_sign, layout.channels)
        if kind not in self._models:
            self._models[kind] = ModalModel(member.structure, layout)
        return self._models[kind]

    def _joint(self, member: Scenario, layout: SensorLayout) -> JointInference | None:
        kind = (member.turbine.description, member.turbine.springs_sign, layout.channels)
        if kind not in self._joints:
            scenario = self._scenario
            self._joints[kind] = joint_inference(
                member.structure,
                layout,
                scenario.updating,
                seed=scenario.seed,
                population=scenario.population,
            )
        return self._joints[kind]
