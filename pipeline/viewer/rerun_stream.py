"""One Rerun recording stream with a view of every turbine of the session.

A file holds one day of the sensor clock (UTC): the first keeps its name, `session.rrd`, the next
is `session-2026-03-02.rrd`, and so on. A viewer is one stream for as long as it takes it.
"""

from dataclasses import replace
from datetime import UTC, datetime

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
from pipeline.viewer.drawing.entities import at
from pipeline.viewer.drawing.plots_2d import log_farm
from pipeline.viewer.outputs.connection import (
    FILE_TICK,
    close_recording,
    forget_unfinished,
    free_path,
    open_recording,
)
from pipeline.viewer.outputs.outputs import RrdFile, ViewerOutput
from pipeline.viewer.pictures.farm_overview import farm_markdown, status_indicators
from pipeline.viewer.session_views import SessionViews, send_views
from pipeline.viewer.turbine_view import TurbineView
from pipeline.viewer.update_rates import TO_FILE, TO_VIEWER
from pipeline.viewer.view_parameters import ViewParameters
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.structure.description import TurbineDescription

DAY_NS = 86_400 * NANOSECONDS  # [ns]
FILE_TIMEOUT = 60.0  # for the last of the session to be written [s]
VIEWER_TIMEOUT = 5.0  # to be taken by a viewer [s]


class RerunStream:
    """Draw messages on one output; sends a new blueprint when a turbine or unit appears.

    The first layout goes out with the first block, later ones when nothing has changed for
    `Pace.settling`: a farm's turbines appear one by one, and a layout has a size of its own
    (0.6 MB a turbine).

    Raises
    ------
    ViewerError
        If the output cannot be opened.
    """

    def __init__(
        self,
        output: ViewerOutput,
        description: TurbineDescription,
        *,
        session: str,
        has_structure: bool = True,
    ) -> None:
        to_file = isinstance(output, RrdFile)
        self._output = output
        self._session = session
        self._day: int | None = None  # of the file, counted from 1970; None before the first block
        self._description = description
        self._has_structure = has_structure
        self._rates = TO_FILE if to_file else TO_VIEWER
        self._timeout = FILE_TIMEOUT if to_file else VIEWER_TIMEOUT
        self._recording = open_recording(output, recording_id=session)
        self._views: dict[str, TurbineView] = {}
        self._parameters: dict[str, ViewParameters] = {}  # of the blueprint, as sent or due
        self._unsettled_ns: int | None = None  # since when the sent blueprint is out of date
        self._start_ns = 0  # of the file's first block
        self._now_ns = 0  # latest sensor time seen
        self._overview_ns = 0  # when the overview of all turbines was last drawn
        self._flushed_ns: int | None = None  # when the file was last flushed

    def take(self, message: Message) -> None:
        """Draw one message in its turbine's view."""
        if isinstance(message, AccelerationBlock):
            self._start_next_file(message.start_ns // DAY_NS)
            self._start_ns = self._start_ns or message.start_ns
            self._now_ns = max(self._now_ns, message.end_ns)
        view = self._view_of(message.turbine)
        match message:
            case AccelerationBlock():
                view.draw_block(message)
            case SensorLayout():
                view.draw_layout(message)
            case ModalEstimate():
                view.draw_estimate(message)
            case StabilisationDiagram():
                view.draw_diagram(message)
            case WindowRejected():
                view.draw_rejection(message)
            case FoundationPosterior():
                view.draw_posterior(message)
            case FoundationTruth():
                view.draw_truth(message)
            case StreamGap():
                view.draw_gap(message)
            case FoundationEvent():
                view.draw_event(message)
            case NodeStatus():
                view.draw_node(message)
                return  # a node reports before the first sample: no reason for a blueprint
        if message.turbine not in self._parameters or not isinstance(message, AccelerationBlock):
            self._update_parameters(message.turbine, view.parameters)
        self._draw_what_is_due()

    def finish(self) -> None:
        """Draw what is buffered and close the output."""
        for view in self._views.values():
            view.finish()
        if self._parameters and isinstance(self._output, RrdFile):
            self._send_blueprint((self._start_ns, self._now_ns))
        elif self._unsettled_ns is not None:
            self._send_blueprint()
        self._draw_overview()
        self.disconnect()

    def disconnect(self) -> None:
        """Close the output without drawing more."""
        close_recording(self._recording, timeout=self._timeout)

    def stop_waiting(self) -> None:
        """Let the process end without waiting for a viewer that does not respond."""
        forget_unfinished()

    def _start_next_file(self, day: int) -> None:
        """Start a new file where the block is the first of a later day."""
        if self._day is None:
            self._day = day
        if day <= self._day or not isinstance(self._output, RrdFile):
            return
        self._day = day
        self.finish()
        self._start_ns = 0
        first = self._output.path
        date = datetime.fromtimestamp(day * DAY_NS // NANOSECONDS, UTC).date()
        page = free_path(first.with_name(f"{first.stem}-{date}{first.suffix}"))
        self._recording = open_recording(
            replace(self._output, path=page), recording_id=f"{self._session} {date}"
        )
        self._views = {
            turbine: view.copy_to(self._recording) for turbine, view in self._views.items()
        }
        self._parameters = {turbine: view.parameters for turbine, view in self._views.items()}
        self._send_blueprint()

    def _view_of(self, turbine: str) -> TurbineView:
        if turbine not in self._views:
            self._views[turbine] = TurbineView(
                *(self._recording, turbine, self._description),
                rates=self._rates,
                has_structure=self._has_structure,
            )
            if len(self._views) > 1:
                for view in self._views.values():
                    view.join_farm()
        return self._views[turbine]

    def _update_parameters(self, turbine: str, parameters: ViewParameters) -> None:
        """Note that a blueprint is due where the parameters of a turbine's views changed."""
        if self._parameters.get(turbine) != parameters:
            self._parameters[turbine] = parameters
            self._unsettled_ns = self._now_ns  # 0 before the first block

    def _draw_what_is_due(self) -> None:
        """Draw and send what is due as sensor time passes."""
        if self._is_past(self._unsettled_ns, self._rates.settling):
            self._send_blueprint()
        if self._is_past(self._overview_ns, self._rates.signals):
            self._draw_overview()
        if isinstance(self._output, RrdFile):
            self._flush()

    def _is_past(self, since_ns: int | None, duration: float) -> bool:
        return since_ns is not None and self._now_ns - since_ns >= duration * NANOSECONDS

    def _send_blueprint(self, span_ns: tuple[int, int] | None = None) -> None:
        """Send the layout; with the span of a session that is over, plots get their margins."""
        self._unsettled_ns = None
        parameters = tuple(self._parameters.values())
        views = SessionViews(parameters, self._rates.playback_speed, span_ns)
        send_views(self._recording, self._output, views)

    def _draw_overview(self) -> None:
        """Draw the overview of a farm; a single turbine needs none."""
        self._overview_ns = self._now_ns
        if len(self._views) > 1 and self._now_ns:
            statuses = [view.status for view in self._views.values()]
            at(self._recording, self._now_ns)
            log_farm(self._recording, status_indicators(statuses), farm_markdown(statuses))

    def _flush(self) -> None:
        """Flush to the file at intervals of sensor time, so that the size of the file does not
        depend on the speed of a replay."""
        if self._flushed_ns is None:
            self._flushed_ns = self._now_ns
        if self._is_past(self._flushed_ns, FILE_TICK):
            self._flushed_ns = self._now_ns
            self._recording.flush(timeout_sec=0.0)
