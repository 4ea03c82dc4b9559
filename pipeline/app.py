"""START HERE: the whole system on one screen.

    source ──► AccelerationBlock ──► [identification] ──► ModalEstimate
    ModalEstimate ──► [updating] ──► FoundationPosterior
    every message ──► [recorder] → MCAP   and ──► [viewer] → Rerun

To change the identification, the updating, a sink or a view, change its line in `build`; what each
turbine's updating is made of stands in `runtime/updaters.py`.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.node import Node, Plan
from pipeline.nodes.updating import UpdatingNode
from pipeline.oma.ssi.ssi_cov import references_among
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.recording.writer import Metadata
from pipeline.runtime.snapshots import SnapshotFolder, recorded_past
from pipeline.runtime.updaters import Turbines
from pipeline.scenario import Scenario
from pipeline.viewer.outputs.outputs import ViewerOutput
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.layout import LayoutError, SensorLayout
from sensors.structure.description import bare_mast


@dataclass(frozen=True, slots=True)
class Outputs:
    """Where a session's results go."""

    recording: Path | None = None
    """MCAP file; None: nothing is recorded."""
    metadata: Metadata | None = None
    """Stored in the recording."""
    views: tuple[ViewerOutput, ...] = ()
    session: str = "pilewatch"
    """What the viewer calls it."""
    checkpoints: Path | None = None
    """Folder of the updating's snapshots; None: nothing is kept."""
    tracks: Path | None = None
    """Folder of the identification's snapshots."""
    earlier: tuple[Path, ...] = ()
    """Recordings in which it finds the samples of an open window."""
    epoch: int = 0
    """Number of the run that writes into the folders."""
    live: bool = False
    """The instruments measure now."""


def build(
    scenario: Scenario,
    layout: SensorLayout,
    outputs: Outputs,
    layouts: Mapping[str, SensorLayout] | None = None,
) -> tuple[Plan, ...]:
    """Return the nodes of a session in the order of the flow.

    Parameters
    ----------
    scenario : Scenario
        The whole experiment.
    layout : SensorLayout
        Of a turbine that is neither in `layouts` nor in the scenario's farm.
    outputs : Outputs
        Files and viewers of the session.
    layouts : mapping of str to SensorLayout, optional
        Turbine → its own, where it is not as the scenario's farm has it.

    Raises
    ------
    OmaSettingsError
        If the scenario names a reference channel that the layout lacks.
    LayoutError
        If its channels are not what the structural model is compared with.
    """
    references_among(layout.channel_names, scenario.oma)  # a wrong name ends the run here
    if scenario.has_structure:
        _require_accelerations(layout)
    turbines = Turbines(
        scenario,
        layout,
        layouts or {},
        outputs.checkpoints,
        epoch=outputs.epoch,
        earlier=outputs.earlier,
    )

    def identification() -> Node:
        if outputs.tracks is None:
            return IdentificationNode(scenario.oma, limits=scenario.limits)
        store = SnapshotFolder(outputs.tracks, "identification", epoch=outputs.epoch)
        past = recorded_past(outputs.earlier, scenario.oma)
        return IdentificationNode(
            scenario.oma,
            limits=scenario.limits,
            store=store,
            past=past,
            clock=time.thread_time,
        )

    def viewer() -> Node:
        known = scenario.has_structure
        drawn = scenario.structure if known else bare_mast(layout)
        return Viewer(outputs.views, drawn, session=outputs.session, has_structure=known)

    def recorder() -> Node:
        assert outputs.recording is not None
        return SessionRecorder(
            outputs.recording,
            metadata=outputs.metadata or {},
            clock=time.time_ns,
            settings=scenario.recording,
            live=outputs.live,
        )

    graph = [Plan(IdentificationNode, identification)]
    if scenario.has_structure:
        graph.append(Plan(UpdatingNode, turbines.updating))
    if outputs.views:
        graph.append(Plan(Viewer, viewer))
    if outputs.recording:
        graph.append(Plan(SessionRecorder, recorder))  # last: it receives what the others publish
    return tuple(graph)


def _require_accelerations(layout: SensorLayout) -> None:
    for channel in layout.channels:
        if channel.unit not in ("m/s²", ""):
            raise LayoutError(
                f"channel {channel.name} is in {channel.unit}; the structural model is compared "
                'with accelerations; a scenario with [turbine] description = "none" tracks modes'
            )
