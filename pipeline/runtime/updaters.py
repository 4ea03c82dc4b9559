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
        """Remember what every turbine's updater is made of.

        Parameters
        ----------
        scenario : Scenario
            The whole experiment.
        layout : SensorLayout
            Of a turbine that is neither in `layouts` nor in the scenario's farm.
        layouts : mapping of str to SensorLayout
            Turbine → its own, where it is not as the scenario's farm has it.
        checkpoints : Path or None
            Folder of the updating's snapshots; None: nothing is kept.
        epoch : int, optional
            Number of the run that writes them.
        earlier : sequence of Path, optional
            Recordings with estimates that may not have been answered.
        """
        self._scenario = scenario
        self._layout = layout
        self._farm = {each.turbine.id: each for each in farm_members(scenario)}
        of_farm = {name: each.layout for name, each in self._farm.items()}
        self._layouts = of_farm | dict(layouts) | {layout.turbine: layout}
        self._store = None if checkpoints is None else SnapshotFolder(checkpoints, epoch=epoch)
        self._earlier = earlier
        # turbines alike share one: it never changes
        self._structures: dict[object, tuple[ModalModel, JointInference | None]] = {}

    def updating(self) -> UpdatingNode:
        """One node for all of them, the first turbine's updating made before a window waits for it.

        Raises CheckpointError for a snapshot that does not fit.
        """
        past = () if self._store is None else latest_estimates(self._earlier, MOST_UNANSWERED)
        node = UpdatingNode(self._made, store=self._store, past=past)
        node.begin(self._layout.turbine)
        return node

    def _made(self, turbine: str) -> TurbineUpdating:
        scenario, layout = self._scenario, self._layouts.get(turbine, self._layout)
        model, joint = self._structure(self._farm.get(turbine, scenario), layout)
        updater = FoundationUpdater(
            model,
            layout,
            scenario.updating,
            seed=scenario.seed,
            population=scenario.population,
            joint=joint,
        )
        return TurbineUpdating(updater, layout, scenario.operation)

    def _structure(
        self, member: Scenario, layout: SensorLayout
    ) -> tuple[ModalModel, JointInference | None]:
        kind = (member.turbine.description, member.turbine.springs_sign, layout.channels)
        if kind not in self._structures:
            scenario = self._scenario
            with one_blas_thread():  # else its basis, and every draw, depends on the cores
                joint = joint_inference(
                    member.structure,
                    layout,
                    scenario.updating,
                    seed=scenario.seed,
                    population=scenario.population,
                )
                self._structures[kind] = ModalModel(member.structure, layout), joint
        return self._structures[kind]
