"""A show: one recording stream on which every turbine of the session has its screen.

A file holds one day of the sensor clock (UTC): the first keeps its name, `session.rrd`, the next
is `session-2026-03-02.rrd`, and so on. A viewer is one stream for as long as it takes it.
"""

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
from pipeline.viewer.blueprint import session_blueprint
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
from pipeline.viewer.panel import TurbinePanel
from pipeline.viewer.pictures.farm_overview import farm_markdown, lamp_board
from pipeline.viewer.turbine_view import TurbineView
from pipeline.viewer.update_rates import TO_FILE, TO_VIEWER
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.structure.description import TurbineDescription

DAY = 86_400 * NANOSECONDS  # [ns]
PATIENCE_WITH_FILE = 60.0  # for the last of the session to be written [s]
PATIENCE_WITH_VIEWER = 5.0  # to be taken by a viewer [s]


class RerunStream:
    """Draws messages on one output; lays the views out anew when a turbine or unit appears.

    The first layout goes out with the first block, later ones when nothing has changed for
    `Pace.settling`: a farm's turbines appear one by one, and a layout has a size of its own
    (0.6 MB a turbine).

    Raises ViewerError where the output cannot be had.
    """

    def __init__(
        self, output: ViewerOutput, description: TurbineDescription, *, session: str
    ) -> None:
        to_file = isinstance(output, RrdFile)
        self._output = output
        self._session = session
        self._day: int | None = None  # of the file, counted from 1970; None before the first block
        self._description = description
        self._pace = TO_FILE if to_file else TO_VIEWER
        self._patience = PATIENCE_WITH_FILE if to_file else PATIENCE_WITH_VIEWER
        self._recording = open_recording(output, recording_id=session)
        self._screens: dict[str, TurbineView] = {}
        self._panels: dict[str, TurbinePanel] = {}  # as the views are, or will be, laid out
        self._unsettled_ns: int | None = None  # since when the views are not laid out like that
        self._now_ns = 0  # latest sensor time seen
        self._said_ns = 0  # when all turbines were last told of
        self._handed_over_ns: int | None = None  # when a file last got all there was

    def take(self, message: Message) -> None:
        """Draw one message on its turbine's screen."""
        if isinstance(message, AccelerationBlock):
            self._turn_the_page(message.start_ns // DAY)
            self._now_ns = max(self._now_ns, message.end_ns)
        screen = self._screen_of(message.turbine)
        match message:
            case AccelerationBlock():
                screen.show_block(message)
            case SensorLayout():
                screen.show_layout(message)
            case ModalEstimate():
                screen.show_estimate(message)
            case StabilisationDiagram():
                screen.show_diagram(message)
            case WindowRejected():
                screen.show_rejection(message)
            case FoundationPosterior():
                screen.show_posterior(message)
            case FoundationTruth():
                screen.show_truth(message)
            case StreamGap():
                screen.show_gap(message)
            case FoundationEvent():
                screen.show_event(message)
            case NodeStatus():
                screen.show_node(message)
                return  # nodes speak before the sensors do: not yet a reason to lay out anything
        if message.turbine not in self._panels or not isinstance(message, AccelerationBlock):
            self._note_panel(message.turbine, screen.panel)
        self._go_on()

    def finish(self) -> None:
        """Hand over what waits and let go of the output."""
        for screen in self._screens.values():
            screen.finish()
        if self._unsettled_ns is not None:
            self._lay_out()
        self._tell_of_all()
        self.abandon()

    def abandon(self) -> None:
        """Let go of the output without drawing more."""
        close_recording(self._recording, patience=self._patience)

    def leave_behind(self) -> None:
        """Let the process end without waiting for a viewer that takes nothing."""
        forget_unfinished()

    def _turn_the_page(self, day: int) -> None:
        """A new file where the block is the first of a later day."""
        if self._day is None:
            self._day = day
        if day <= self._day or not isinstance(self._output, RrdFile):
            return
        self._day = day
        self.finish()
        first = self._output.path
        date = datetime.fromtimestamp(day * DAY // NANOSECONDS, UTC).date()
        page = free_path(first.with_name(f"{first.stem}-{date}{first.suffix}"))
        self._recording = open_recording(RrdFile(page), recording_id=f"{self._session} {date}")
        self._screens = {
            turbine: screen.continued_on(self._recording)
            for turbine, screen in self._screens.items()
        }
        self._panels = {turbine: screen.panel for turbine, screen in self._screens.items()}
        self._lay_out()

    def _screen_of(self, turbine: str) -> TurbineView:
        if turbine not in self._screens:
            self._screens[turbine] = TurbineView(
                self._recording, turbine, self._description, pace=self._pace
            )
            if len(self._screens) > 1:
                for screen in self._screens.values():
                    screen.join_farm()
        return self._screens[turbine]

    def _note_panel(self, turbine: str, panel: TurbinePanel) -> None:
        """Remember that the views are to be laid out anew where a turbine's have changed."""
        if self._panels.get(turbine) != panel:
            self._panels[turbine] = panel
            self._unsettled_ns = self._now_ns  # 0 before the first block

    def _go_on(self) -> None:
        """What is due as sensor time passes."""
        if self._is_past(self._unsettled_ns, self._pace.settling):
            self._lay_out()
        if self._is_past(self._said_ns, self._pace.signals):
            self._tell_of_all()
        if isinstance(self._output, RrdFile):
            self._hand_over()

    def _is_past(self, since_ns: int | None, duration: float) -> bool:
        return since_ns is not None and self._now_ns - since_ns >= duration * NANOSECONDS

    def _lay_out(self) -> None:
        self._unsettled_ns = None
        panels = list(self._panels.values())
        blueprint = session_blueprint(panels, playback_speed=self._pace.playback_speed)
        self._recording.send_blueprint(blueprint)

    def _tell_of_all(self) -> None:
        """The overview of a farm; one turbine's own is enough for one."""
        self._said_ns = self._now_ns
        if len(self._screens) > 1 and self._now_ns:
            statuses = [screen.status for screen in self._screens.values()]
            at(self._recording, self._now_ns)
            log_farm(self._recording, lamp_board(statuses), farm_markdown(statuses))

    def _hand_over(self) -> None:
        """What waits for others of its entity goes to the file, so often in sensor time: however
        fast a session is replayed, its file is as large."""
        if self._handed_over_ns is None:
            self._handed_over_ns = self._now_ns
        if self._is_past(self._handed_over_ns, FILE_TICK):
            self._handed_over_ns = self._now_ns
            self._recording.flush(timeout_sec=0.0)
