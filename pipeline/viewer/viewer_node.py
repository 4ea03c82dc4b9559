"""The node that draws a session in Rerun while it runs, or writes it to a .rrd file."""

from collections.abc import Callable, Iterable, Sequence

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
from pipeline.nodes.node import Sink
from pipeline.viewer.outputs.drawing_thread import DirectDrawing, Drawing, DrawingThread
from pipeline.viewer.outputs.outputs import (
    ConnectedViewer,
    RrdFile,
    SpawnedViewer,
    ViewerOutput,
    prepare_rerun,
    require_rerun,
)
from pipeline.viewer.outputs.reconnecting_viewer import ReconnectingViewer
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.structure.description import TurbineDescription


class Viewer(Sink):
    """Draw every message; produce none, and fail with none.

    Parameters
    ----------
    outputs : Sequence[ViewerOutput]
        Files and viewers; each has a recording stream of its own, so that a viewer that hangs
        holds neither a file nor the session. A viewer may come late and come back.
    description : TurbineDescription
        The turbine's geometry and its reference modes.
    session : str
        Names the recording in the viewer.
    has_structure : bool, optional
        False: modes only; the description is drawn but stands for no structural model.
    wait_for_viewer : bool, optional
        True: a viewer, which must be there, is waited for as a file is, so that nothing is left
        out. Only where no measurement can be held up: a recording that is drawn afterwards.
    strict : bool, optional
        True (tests): an exception while drawing to a file goes to the caller; else it is logged
        once and that output stays as it is.

    Raises
    ------
    ViewerError
        If rerun is missing or an output cannot be opened. One line.
    """

    name = "viewer"
    inputs = (
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
        has_structure: bool = True,
        wait_for_viewer: bool = False,
        strict: bool = False,
    ) -> None:
        require_rerun(tuple(outputs))
        prepare_rerun(outputs)
        from pipeline.viewer.rerun_stream import (
            RerunStream,  # here, so that all but pictures runs without rerun
        )

        def stream(to: ViewerOutput) -> RerunStream:
            return RerunStream(to, description, session=session, has_structure=has_structure)

        self._drawings: tuple[DirectDrawing | DrawingThread, ...] = tuple(
            DirectDrawing(stream(output), strict=strict)
            if wait_for_viewer or isinstance(output, RrdFile)
            else DrawingThread(_reconnecting_viewer(output, stream))
            for output in outputs
        )

    def handle(self, message: Message) -> Iterable[Message]:
        """Draw one message, or queue it to be drawn; return no message."""
        for drawing in self._drawings:
            drawing.take(message)
        return ()

    def close(self) -> None:
        """Draw what is buffered and close files and viewers; a second call does nothing."""
        drawings, self._drawings = self._drawings, ()
        for drawing in drawings:
            drawing.close()


def _reconnecting_viewer(
    output: SpawnedViewer | ConnectedViewer, stream: Callable[[ViewerOutput], Drawing]
) -> ReconnectingViewer:
    """Return a drawing on a viewer that may disconnect; one to be started is started here, once."""
    from pipeline.viewer.outputs.viewer_process import spawn_viewer

    if isinstance(output, SpawnedViewer):
        output = ConnectedViewer(spawn_viewer(output.port))
    connected = output
    return ReconnectingViewer(connected.url, lambda: stream(connected))
