"""Viewer: the sink node that shows a session in Rerun while it runs, or writes it to a .rrd."""

from collections.abc import Iterable, Sequence

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    StabilisationDiagram,
    StreamGap,
    WindowRejected,
)
from pipeline.viewer.outputs import RrdFile, ViewerOutput, require_rerun
from pipeline.viewer.stages import DirectStage, ThreadedStage
from sensors.blocks import AccelerationBlock
from sensors.layout import SensorLayout
from sensors.turbine.description import TurbineDescription


class Viewer:
    """Shows every message; answers with none, and fails with none.

    outputs       files and viewers; each has a recording stream of its own, so that a viewer that
                  hangs holds neither a file nor the session
    description   the turbine's geometry and its reference modes
    session       names the recording in the viewer
    unhurried     True: a viewer is waited for as a file is, so that nothing is left out. Only
                  where no measurement can be held up: a recording that is drawn afterwards
    strict        True (tests): an exception while drawing to a file goes to the caller; else it
                  is logged once and that output stays as it is

    Raises ViewerError, one line, where rerun is missing or an output cannot be had.
    """

    name = "viewer"
    inputs: tuple[type, ...] = (
        AccelerationBlock,
        SensorLayout,
        ModalEstimate,
        StabilisationDiagram,
        WindowRejected,
        FoundationPosterior,
        FoundationTruth,
        StreamGap,
        FoundationEvent,
        NodeStatus,
    )

    def __init__(
        self,
        outputs: Sequence[ViewerOutput],
        description: TurbineDescription,
        *,
        session: str,
        unhurried: bool = False,
        strict: bool = False,
    ) -> None:
        require_rerun(tuple(outputs))
        from pipeline.viewer.show import Show  # here, so that all but pictures runs without rerun

        shows = [(output, Show(output, description, session=session)) for output in outputs]
        self._stages: tuple[DirectStage | ThreadedStage, ...] = tuple(
            DirectStage(show, strict=strict)
            if unhurried or isinstance(output, RrdFile)
            else ThreadedStage(show)
            for output, show in shows
        )

    def handle(self, message: Message) -> Iterable[Message]:
        """Draw one message, or leave it to be drawn; returns nothing."""
        for stage in self._stages:
            stage.take(message)
        return ()

    def close(self) -> None:
        """Draw what waits and let go of files and viewers; a second call does nothing."""
        stages, self._stages = self._stages, ()
        for stage in stages:
            stage.close()
