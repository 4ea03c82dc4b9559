"""The turbines of a session, each with its sensors, its structure and an updating of its own."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from pipeline.nodes.updating import TurbineUpdating, UpdatingNode
from pipeline.recording.latest_messages import latest_estimates
from pipeline.runtime.snapshots import SnapshotFolder
from pipeline.scenario import Scenario, farm_members
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import one_blas_thread
from sensors.dynamics.modal_model import ModalModel

MOST_UNANSWERED = 100  # windows by which an updating may be behind when it is killed


class Turbines:
    """What is known of every turbine beforehand: by the scenario's farm, or by its own layout."""

    def __init__(
        self,
        scenario: Scenario,
        layout: SensorLayout,
        layouts: Mapping[str, SensorLayout],
        checkpoints: Path | None,
        *,
        epoch: int = 0,
        earlier: Sequence[Path] = (),
    ) -> None:
        """
        layout        of a turbine that is neither in `layouts` nor in the scenario's farm
        layouts       turbine → its own, where it is not as the scenario's farm has it
        checkpoints   folder of the updating's snapshots; None: nothing is kept
        epoch         number of the run that writes them
        earlier       recordings with estimates that may not have been answered
        """
        self._scenario = scenario
        self._layout = layout
        self._farm = {each.turbine.id: each for each in farm_members(scenario)}
        self._layouts = {name: each.layout for name, each in self._farm.items()} | dict(layouts)
        self._store = None if checkpoints is None else SnapshotFolder(checkpoints, epoch=epoch)
        self._earlier = earlier
        self._joints: dict[object, JointInference | None] = {}  # likewise
        self._models: dict[object, ModalModel] = {}  # turbines alike share one: it never changes
        self._spare: TurbineUpdating | None = None  # made before the first window waits for it

    def updating(self) -> UpdatingNode:
        """One node for all of them. Raises CheckpointError for a snapshot that does not fit."""
        past = () if self._store is None else latest_estimates(self._earlier, MOST_UNANSWERED)
        node = UpdatingNode(self._made, store=self._store, past=past)
        self._spare = self._updating_of(self._layout.turbine, self._layout)
        if self._store is not None:
            node.begin(self._layout.turbine)
        return node

    def _made(self, turbine: str) -> TurbineUpdating:
        layout = self._layouts.get(turbine, self._layout)
        if turbine == self._layout.turbine or turbine not in self._layouts:
            layout = self._layout
            spare, self._spare = self._spare, None
            if spare is not None:
                return spare
        return self._updating_of(turbine, layout)

    def _updating_of(self, turbine: str, layout: SensorLayout) -> TurbineUpdating:
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
        return TurbineUpdating(updater, layout, scenario.operation)

    def _model(self, member: Scenario, layout: SensorLayout) -> ModalModel:
        kind = (member.turbine.description, member.turbine.springs_sign, layout.channels)
        if kind not in self._models:
            with one_blas_thread():
                self._models[kind] = ModalModel(member.structure, layout)
        return self._models[kind]

    def _joint(self, member: Scenario, layout: SensorLayout) -> JointInference | None:
        kind = (member.turbine.description, member.turbine.springs_sign, layout.channels)
        if kind not in self._joints:
            scenario = self._scenario
            with one_blas_thread():  # else its basis, and every draw, depends on the cores
                self._joints[kind] = joint_inference(
                    member.structure,
                    layout,
                    scenario.updating,
                    seed=scenario.seed,
                    population=scenario.population,
                )
        return self._joints[kind]
