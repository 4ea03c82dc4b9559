"""Draw one turbine, message by message.

Signals and modes are drawn in `signal_view` and `mode_view`.
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
from pipeline.viewer.drawing.entities import FARM, at, signal_paths, turbine_path
from pipeline.viewer.mode_view import ModeView
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
from pipeline.viewer.signal_view import FaultyChannels, KnownLayouts, SignalView
from pipeline.viewer.update_rates import UpdateRates
from pipeline.viewer.view_parameters import ViewParameters
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.bounded_dict import BoundedDict
from sensors.structure.description import TurbineDescription

MOST_AHEAD = 20  # windows that the identification may be ahead; of a session that only tracks
# modes no estimate is answered


class NodeView:
    """Draw a node's state at most every `period` [s], with the worst value since the last row."""

    def __init__(self, recording: rr.RecordingStream, root: str, *, period: float) -> None:
        self._recording = recording
        self._root = root
        self._period = period
        self._rows: dict[str, int] = {}  # node → time of its latest row; has its style
        self._behind_most: dict[str, float] = {}  # node → most since its latest row [s]

    def show(self, node: NodeStatus, now_ns: int, *, behind: float, changed: bool) -> None:
        """Draw a row where one is due or the state changed; `behind` the newest block [s]."""
        behind = max(behind, self._behind_most.get(node.node, 0.0))
        if self._is_due(node.node, now_ns) or changed:
            foundation_views.log_node(self._recording, self._root, node, behind=behind)
            behind = 0.0
        self._behind_most[node.node] = behind

    def _is_due(self, node: str, now_ns: int) -> bool:
        """Return whether a node's next row is due; the first writes its style."""
        if node not in self._rows:
            slot = len(self._rows)
            foundation_views.log_node_styles(self._recording, self._root, node, slot)
        elif now_ns - self._rows[node] < self._period * NANOSECONDS:
            return False
        self._rows[node] = now_ns
        return True


class TurbineView:
    """Draws one turbine's messages. Remembers estimates until their posterior."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        turbine: str,
        description: TurbineDescription,
        *,
        rates: UpdateRates,
        labels: tuple[str, ...] | None = None,
        has_structure: bool = True,
    ) -> None:
        """Draw the static parts.

        Parameters
        ----------
        labels : tuple[str, ...] | None, optional
            Labels of the modes to draw; None: those of the description.
        has_structure : bool, optional
            False: no structural model; the identified modes are drawn by themselves.
        """
        self._recording = recording
        self._turbine = turbine
        self._description = description
        self._root = turbine_path(turbine)
        self._has_structure = has_structure
        self._outline = outline(description)
        self._rates = rates
        described = tuple(mode.name for mode in description.reference_modes)
        root = self._root
        self._layouts = KnownLayouts()
        self._signals = SignalView(recording, root, self._layouts, rates=rates)
        tower_views.log_tower(recording, root, self._outline)
        foundation_views.log_foundation_styles(recording, root)
        self._modes = ModeView(
            recording,
            root,
            self._outline,
            labels=described if labels is None else labels,
            follows=has_structure and not described,
            rates=rates,
        )
        self._nodes = NodeView(recording, root, period=rates.nodes)
        self._status = SessionStatus(turbine, title=description.title, has_structure=has_structure)
        self._estimates = BoundedDict[int, ModalEstimate](MOST_AHEAD)
        """By the end of their window [ns]: without a posterior, and of the last posterior."""
        self._found: tuple[int, list[float]] = (-1, [])  # newest window, its frequencies [Hz]
        self._sized = False  # a change of known size was detected
        self._in_farm = False  # one of several turbines
        self._styled: set[str] = set()
        self._first_frequencies: dict[str, float] = {}  # of the session, by track [Hz]
        self._warned: frozenset[str] = frozenset()  # codes of the latest window's warnings
        self._now_ns = 0  # latest sensor time seen
        self._at_ns = 0  # sensor time of what is being drawn

    def join_farm(self) -> None:
        """Mark the turbine as one of several: its medians and warnings join the farm's tab."""
        if not self._in_farm:
            self._in_farm = True
            foundation_views.log_median_styles(self._recording, self._turbine)

    @property
    def status(self) -> SessionStatus:
        """The state of the turbine."""
        return self._status

    @property
    def parameters(self) -> ViewParameters:
        """What the blueprint depends on; changes with layouts, events, the first posterior."""
        middle = (self._outline.mudline + self._outline.tower_top) / 2
        return ViewParameters(
            *(self._turbine, self._layouts.all, self._modes.labels, middle),
            self._sized,
            self._has_structure,
            bool(self._status.state.truths),
            self._status.lists_nodes,
        )

    def copy_to(self, recording: rr.RecordingStream) -> "TurbineView":
        """Return a view of the same turbine on another recording stream, static parts drawn."""
        view = TurbineView(
            *(recording, self._turbine, self._description),
            rates=self._rates,
            labels=self._modes.labels,
            has_structure=self._has_structure,
        )
        view._status, view._estimates = self._status, self._estimates
        view._now_ns = self._now_ns
        view._first_frequencies = dict(self._first_frequencies)
        if self._sized:
            view._show_sizes()
        for layout in self._layouts.all:
            view.draw_layout(layout)
        if self._in_farm:
            view.join_farm()
        return view

    def draw_layout(self, layout: SensorLayout) -> None:
        """Draw the sensors on the tower and name the signals."""
        self._layouts.add(layout)
        path = signal_paths(self._root, self._layouts.all)[layout.layout_id]
        track_views.log_signal_style(self._recording, path, layout)
        tower_views.log_sensors(self._recording, self._root, layout, self._outline)

    def draw_block(self, block: AccelerationBlock) -> None:
        """Draw accelerations at display rate, gathered into chunks."""
        self._now_ns = max(self._now_ns, block.end_ns)
        if self._signals.take(block):
            self._draw_faults(self._signals.hand_over(block.unit))
            self._modes.extend_motion(self._now_ns, at_least=self._rates.swing_chunk)

    def draw_estimate(self, estimate: ModalEstimate) -> None:
        """Draw identified frequencies; the posterior adds shapes and tracks."""
        self._estimates.put(estimate.end_ns, estimate)
        layout = self._layouts.named(estimate.layout_id)
        self._at(estimate.end_ns)
        track_views.log_estimate(
            *(self._recording, self._root, estimate, layout),
            styled=self._styled,
            first=self._first_frequencies,
        )
        frequencies = [mode.frequency for mode in estimate.modes]
        self._found = (estimate.window, frequencies)
        self._event(f"window {estimate.window}: {frequencies_text(frequencies)}")
        self._draw_warnings(estimate)
        self._signals.draw_spectrum(estimate)
        if not self._has_structure:
            self._modes.draw_estimate(estimate, layout)
            self._modes.extend_motion(self._now_ns, at_least=self._rates.swing_chunk)
        self._status.take(estimate)
        self._draw_status()

    def draw_diagram(self, diagram: StabilisationDiagram) -> None:
        """Draw the poles among which the window's modes were found."""
        if diagram.window == self._found[0]:
            self._at(diagram.end_ns)
            picture = stabilisation_picture(diagram, self._found[1])
            plane_views.log_stabilisation(self._recording, self._root, picture)

    def draw_rejection(self, rejected: WindowRejected) -> None:
        """Draw a rejected window and its reason."""
        self._at(rejected.end_ns)
        level = "INFO" if rejected.code == CUT_SHORT else "WARN"
        self._event(f"window {rejected.window} rejected: {rejected.reason}", level=level)
        self._status.take(rejected)
        self._draw_status()

    def draw_posterior(self, posterior: FoundationPosterior) -> None:
        """Draw bands, joint posterior, tracks and shapes of the paired modes."""
        self._at(posterior.time_ns)
        recording, root = self._recording, self._root
        truth = self._status.state.truth_until(posterior.time_ns)
        foundation_views.log_posterior_bands(recording, root, posterior, truth)
        if self._in_farm:
            foundation_views.log_medians(recording, posterior)
        foundation_views.log_joint_posterior(recording, root, posterior, truth)
        foundation_views.log_posterior_widths(recording, root, posterior)
        foundation_views.log_change_probability(recording, root, posterior)
        if self._sized:
            foundation_views.log_revised_sizes(recording, root, posterior)
        picture = pile_picture(posterior, self._description, truth)
        foundation_views.log_pile(recording, root, picture)
        estimate = self._estimate_of(posterior)
        layout = self._layouts.of_posterior(posterior, estimate)
        self._modes.show(posterior, estimate, layout)
        self._modes.extend_motion(self._now_ns, at_least=self._rates.swing_chunk)
        level = "INFO" if posterior.trusted else "ERROR"
        self._event(posterior_text(posterior), level=level)
        self._status.take(posterior)
        self._draw_status()

    def draw_truth(self, truth: FoundationTruth) -> None:
        """Keep the true stiffness; its line is drawn with the posterior's bands."""
        self._status.take(truth)
        self._at(truth.time_ns)
        drawn = "known, drawn in green" if self._has_structure else "known"
        self._event(f"simulated turbine: true stiffness {drawn}")

    def draw_gap(self, gap: StreamGap) -> None:
        """Draw missing blocks."""
        self._at(gap.end_ns)
        self._event(f"gap: {gap_text(gap)}", level="WARN")
        self._status.take(gap)
        self._draw_status()

    def draw_event(self, event: FoundationEvent) -> None:
        """Draw a change of the foundation or of the modes."""
        self._at(event.time_ns)
        if event.changes and not self._sized:
            self._show_sizes()
        foundation_views.log_change(self._recording, self._root, event)
        self._event(event.text, level="WARN")
        self._status.take(event)
        self._draw_status()

    def _show_sizes(self) -> None:
        self._sized = True
        foundation_views.log_change_styles(self._recording, self._root)

    def draw_node(self, node: NodeStatus) -> None:
        """Draw a node's state at the latest sensor time, since its own clock is the machine's.

        A node reports that it is ready before the first sample: that is kept for the status text
        and makes no event (at time 0 it would stretch every plot to 1970).
        """
        changed = self._status.take_node(node)
        if not self._now_ns:
            return
        self._at(self._now_ns)
        behind = self._signals.behind(node.last_sequence)
        self._nodes.show(node, self._now_ns, behind=behind, changed=changed)
        if changed:
            self._event(f"node {node.node}: {node.state}, {node.lost} lost, {node.late} late")
            self._draw_status()

    def finish(self) -> None:
        """Draw what is buffered."""
        self._draw_faults(self._signals.finish())
        self._modes.extend_motion(self._now_ns, at_least=0.0)
        if self._now_ns:
            self._at(self._now_ns)
            self._draw_status()

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

    def _draw_warnings(self, estimate: ModalEstimate) -> None:
        """Draw the first warning of each code that the window before did not have."""
        first = {warning.code: warning.text for warning in reversed(estimate.warnings)}
        for code, text in first.items():
            if code not in self._warned:
                self._event(f"{code}: {text}", level="WARN")
        self._warned = frozenset(first)

    def _draw_faults(self, faults: list[FaultyChannels]) -> None:
        for fault in faults:
            self._at(fault.time_ns)
            self._event(fault.text, level="WARN")

    def _draw_status(self) -> None:
        recording, root = self._recording, self._root
        foundation_views.log_status(recording, root, self._status.markdown())
        foundation_views.log_health(recording, root, self._status.health_markdown())
        plane_views.log_indicators(recording, root, self._status.indicators)

    def _estimate_of(self, posterior: FoundationPosterior) -> ModalEstimate | None:
        """Return the estimate of the posterior's window; earlier ones are then dropped.

        In a fast replay the identification runs windows ahead of the updating. It stays for a
        posterior that comes again, as of an updating that was killed; an identification that was
        counts its windows from 0 again.
        """
        for end_ns in [each for each in self._estimates if each < posterior.time_ns]:
            del self._estimates[end_ns]
        return self._estimates.get(posterior.time_ns)
