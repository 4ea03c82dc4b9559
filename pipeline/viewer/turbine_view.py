"""TurbineView: everything shown of one turbine, message by message.

What a message changes on the screen is here; how signals, modes and nodes are drawn is told in
signal_screen, mode_screen and node_screen.
"""

import rerun as rr

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    ModalEstimate,
    NodeStatus,
    StabilisationDiagram,
    StreamGap,
    WindowRejected,
)
from pipeline.viewer.drawing import foundation as foundation_views
from pipeline.viewer.drawing import plots_2d as plane_views
from pipeline.viewer.drawing import tower as tower_views
from pipeline.viewer.drawing import tracks as track_views
from pipeline.viewer.drawing.entities import FARM, at, turbine_path
from pipeline.viewer.known_layouts import KnownLayouts
from pipeline.viewer.mode_view import ModeView
from pipeline.viewer.panel import TurbinePanel
from pipeline.viewer.pictures.pile import pile_picture
from pipeline.viewer.pictures.scene import outline
from pipeline.viewer.pictures.stabilisation import stabilisation_picture
from pipeline.viewer.pictures.status_text import (
    CUT_SHORT,
    SessionStatus,
    clock_time,
    frequencies_text,
    gap_text,
    posterior_text,
)
from pipeline.viewer.signal_view import Fault, SignalView
from pipeline.viewer.update_rates import Pace
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.structure.description import TurbineDescription


class NodeView:
    """Draws a row of a node at most every `period` [s], with the worst since the last one."""

    def __init__(self, recording: rr.RecordingStream, root: str, *, period: float) -> None:
        self._recording = recording
        self._root = root
        self._period = period
        self._rows: dict[str, int] = {}  # node → time of its latest row; has its style
        self._behind_most: dict[str, float] = {}  # node → most since its latest row [s]

    def show(self, node: NodeStatus, now_ns: int, *, behind: float, news: bool) -> None:
        """A row where one is due, or where there is news; `behind` the newest block [s]."""
        behind = max(behind, self._behind_most.get(node.node, 0.0))
        if self._is_due(node.node, now_ns) or news:
            foundation_views.log_node(self._recording, self._root, node, behind=behind)
            behind = 0.0
        self._behind_most[node.node] = behind

    def _is_due(self, node: str, now_ns: int) -> bool:
        """Whether a node's plots get their next row now; the first comes with their style."""
        if node not in self._rows:
            slot = len(self._rows)
            foundation_views.log_node_styles(self._recording, self._root, node, slot)
        elif now_ns - self._rows[node] < self._period * NANOSECONDS:
            return False
        self._rows[node] = now_ns
        return True


class TurbineView:
    """Draws one turbine's messages. Remembers estimates until their posterior, and the truth."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        turbine: str,
        description: TurbineDescription,
        *,
        pace: Pace,
        labels: tuple[str, ...] | None = None,
    ) -> None:
        """labels: of the modes to show, where another screen knew them; else the description's."""
        self._recording = recording
        self._turbine = turbine
        self._description = description
        self._root = turbine_path(turbine)
        self._outline = outline(description)
        self._pace = pace
        if labels is None:
            labels = tuple(mode.name for mode in description.reference_modes)
        root = self._root
        self._layouts = KnownLayouts()
        self._signals = SignalView(recording, root, self._layouts, pace=pace)
        tower_views.log_tower(recording, root, self._outline)
        foundation_views.log_foundation_styles(recording, root)
        self._modes = ModeView(recording, root, self._outline, labels=labels, pace=pace)
        self._nodes = NodeView(recording, root, period=pace.nodes)
        self._status = SessionStatus(turbine, title=description.title)
        self._estimates: dict[int, ModalEstimate] = {}  # by window, those without a posterior yet
        self._found: tuple[int, list[float]] = (-1, [])  # newest window, its frequencies [Hz]
        self._truth: FoundationTruth | None = None
        self._sized = False  # a change was noticed whose size is known
        self._in_farm = False  # one of several turbines
        self._styled: set[str] = set()
        self._now_ns = 0  # latest sensor time seen
        self._at_ns = 0  # sensor time of what is being drawn

    def join_farm(self) -> None:
        """From now on the turbine is one of several: what matters is told among all, too."""
        if not self._in_farm:
            self._in_farm = True
            foundation_views.log_median_styles(self._recording, self._turbine)

    @property
    def status(self) -> SessionStatus:
        """What can be said of the turbine."""
        return self._status

    @property
    def panel(self) -> TurbinePanel:
        """What the blueprint needs; new with a layout, a change, maybe the first posterior."""
        middle = (self._outline.mudline + self._outline.tower_top) / 2
        return TurbinePanel(
            *(self._turbine, self._layouts.all, self._modes.labels, middle),
            self._sized,
        )

    def continued_on(self, recording: rr.RecordingStream) -> "TurbineView":
        """The same turbine on another recording, with what stands drawn there first."""
        screen = TurbineView(
            *(recording, self._turbine, self._description),
            pace=self._pace,
            labels=self._modes.labels,
        )
        screen._status, screen._truth = self._status, self._truth
        screen._estimates = self._estimates
        screen._now_ns = self._now_ns
        for layout in self._layouts.all:
            screen.show_layout(layout)
        if self._in_farm:
            screen.join_farm()
        return screen

    def show_layout(self, layout: SensorLayout) -> None:
        """Sensors on the tower, names on the signals."""
        self._layouts.add(layout)
        track_views.log_signal_style(self._recording, self._root, layout)
        tower_views.log_sensors(self._recording, self._root, layout)

    def show_block(self, block: AccelerationBlock) -> None:
        """Accelerations at display rate, gathered into chunks."""
        self._now_ns = max(self._now_ns, block.end_ns)
        if self._signals.take(block):
            self._tell_faults(self._signals.hand_over(block.unit))
            self._modes.swing_on(self._now_ns, at_least=self._pace.swing_chunk)

    def show_estimate(self, estimate: ModalEstimate) -> None:
        """Identified frequencies; shapes and tracks follow with the posterior that pairs them."""
        self._estimates[estimate.window] = estimate
        layout = self._layouts.named(estimate.layout_id)
        self._at(estimate.end_ns)
        track_views.log_estimate(self._recording, self._root, estimate, layout, styled=self._styled)
        frequencies = [mode.frequency for mode in estimate.modes]
        self._found = (estimate.window, frequencies)
        self._event(f"window {estimate.window}: {frequencies_text(frequencies)}")
        self._signals.show_spectrum(estimate)
        self._status.take(estimate)
        self._show_status()

    def show_diagram(self, diagram: StabilisationDiagram) -> None:
        """The poles among which the window's modes were found."""
        if diagram.window == self._found[0]:
            self._at(diagram.end_ns)
            picture = stabilisation_picture(diagram, self._found[1])
            plane_views.log_stabilisation(self._recording, self._root, picture)

    def show_rejection(self, rejected: WindowRejected) -> None:
        """A window that gave no estimate, and why."""
        self._at(rejected.end_ns)
        level = "INFO" if rejected.code == CUT_SHORT else "WARN"
        self._event(f"window {rejected.window} rejected: {rejected.reason}", level=level)
        self._status.take(rejected)
        self._show_status()

    def show_posterior(self, posterior: FoundationPosterior) -> None:
        """Bands, joint posterior, tracks and shapes of the paired modes."""
        self._at(posterior.time_ns)
        recording, root = self._recording, self._root
        foundation_views.log_posterior_bands(recording, root, posterior, self._truth)
        if self._in_farm:
            foundation_views.log_medians(recording, posterior)
        foundation_views.log_joint_posterior(recording, root, posterior, self._truth)
        foundation_views.log_learned(recording, root, posterior)
        foundation_views.log_change_probability(recording, root, posterior)
        picture = pile_picture(posterior, self._description, self._truth)
        foundation_views.log_pile(recording, root, picture)
        estimate = self._estimate_of(posterior)
        layout = self._layouts.of_posterior(posterior, estimate)
        self._modes.show(posterior, estimate, layout)
        self._modes.swing_on(self._now_ns, at_least=self._pace.swing_chunk)
        level = "INFO" if posterior.trusted else "ERROR"
        self._event(posterior_text(posterior), level=level)
        self._status.take(posterior)
        self._show_status()

    def show_truth(self, truth: FoundationTruth) -> None:
        """The true stiffness; its line is drawn along with the posterior's bands."""
        self._truth = truth
        self._status.take(truth)
        self._at(truth.time_ns)
        self._event("simulated turbine: the true stiffness is known and drawn in green")

    def show_gap(self, gap: StreamGap) -> None:
        """Blocks that are missing."""
        self._at(gap.end_ns)
        self._event(f"gap: {gap_text(gap)}", level="WARN")
        self._status.take(gap)
        self._show_status()

    def show_event(self, event: FoundationEvent) -> None:
        """A change of the foundation or of the modes."""
        self._at(event.time_ns)
        if event.changes and not self._sized:
            self._sized = True
            foundation_views.log_change_styles(self._recording, self._root)
        foundation_views.log_change(self._recording, self._root, event)
        self._event(event.text, level="WARN")
        self._status.take(event)
        self._show_status()

    def show_node(self, node: NodeStatus) -> None:
        """A node's state; shown at the latest sensor time, since its own clock is the machine's.

        Nodes say that they are ready before the sensors say what time it is: that much is kept for
        the status text, and makes no event of its own (at 0 it would stretch every plot to 1970).
        """
        news = self._status.take_node(node)
        if not self._now_ns:
            return
        self._at(self._now_ns)
        behind = self._signals.behind(node.last_sequence)
        self._nodes.show(node, self._now_ns, behind=behind, news=news)
        if news:
            self._event(f"node {node.node}: {node.state}, {node.lost} lost, {node.late} late")
            self._show_status()

    def finish(self) -> None:
        """Hand over what still waits."""
        self._tell_faults(self._signals.finish())
        self._modes.swing_on(self._now_ns, at_least=0.0)
        if self._now_ns:
            self._at(self._now_ns)
            self._show_status()

    def _at(self, time_ns: int) -> None:
        self._now_ns = max(self._now_ns, time_ns)
        self._at_ns = time_ns
        at(self._recording, time_ns)

    def _event(self, text: str, *, level: str = "INFO") -> None:
        line = f"{clock_time(self._at_ns)}  {text}"
        foundation_views.log_event(self._recording, self._root, line, level=level)
        if self._in_farm and level != "INFO":
            named = f"{clock_time(self._at_ns)}  {self._turbine}: {text}"
            foundation_views.log_event(self._recording, FARM, named, level=level)

    def _tell_faults(self, faults: list[Fault]) -> None:
        for fault in faults:
            self._at(fault.time_ns)
            self._event(fault.text, level="WARN")

    def _show_status(self) -> None:
        recording, root = self._recording, self._root
        foundation_views.log_status(recording, root, self._status.markdown())
        foundation_views.log_health(recording, root, self._status.health_markdown())
        plane_views.log_lamps(recording, root, self._status.lamps)

    def _estimate_of(self, posterior: FoundationPosterior) -> ModalEstimate | None:
        """The estimate of the posterior's own window; it and earlier ones are then forgotten.

        In a fast replay the identification runs windows ahead of the updating.
        """
        estimate = self._estimates.get(posterior.window)
        for window in [each for each in self._estimates if each <= posterior.window]:
            del self._estimates[window]
        return estimate
