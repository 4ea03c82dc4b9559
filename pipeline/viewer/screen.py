"""TurbineScreen: everything shown of one turbine, message by message."""

import time
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    ModalEstimate,
    Mode,
    ModePair,
    NodeStatus,
    StabilisationDiagram,
    StreamGap,
    WindowRejected,
)
from pipeline.viewer import foundation_views, plane_views, tower_views, track_views
from pipeline.viewer.display_signals import DisplayDecimator, joined_runs
from pipeline.viewer.entities import FARM, at, turbine_path
from pipeline.viewer.mac_matrix import mac_matrix
from pipeline.viewer.panel import TurbinePanel
from pipeline.viewer.pile import pile_picture
from pipeline.viewer.scene import Deflection, deflection, outline, scaled_onto, swing_frames
from pipeline.viewer.spectrum import RecentSamples, spectrum_picture
from pipeline.viewer.stabilisation import stabilisation_picture
from pipeline.viewer.status import (
    SessionStatus,
    clock_time,
    frequencies_text,
    gap_text,
    posterior_text,
)
from sensors.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.layout import SensorLayout, joined_layout
from sensors.turbine.description import TurbineDescription

FloatArray = NDArray[np.float64]

NONE_FAULTY: frozenset[str] = frozenset()
MAX_MODES = 12  # plots of single modes, where the description names no reference modes


@dataclass(frozen=True, slots=True)
class Pace:
    """How often things are handed over; session time unless said otherwise."""

    signals: float  # accelerations gathered in one chunk [s]
    swing: float  # one swing of a mode shape, T [s]
    swing_chunk: float  # frames gathered in one chunk [s]
    nodes: float  # between two rows of a node whose losses do not grow [s]
    settling: float  # from a change of the layout to its views: others may follow it [s]
    rest: float = 0.0  # between two hand-overs, by the machine's clock [s]

    @property
    def playback_speed(self) -> float:
        """Session seconds a second of playing at which a shape swings every two seconds [-]."""
        return max(1.0, self.swing / 2.0)


# Large chunks: a small file.
TO_FILE = Pace(signals=60.0, swing=60.0, swing_chunk=600.0, nodes=60.0, settling=30.0)
# Small ones for a prompt picture, but four a second at most, however fast a replay is.
TO_VIEWER = Pace(signals=1.0, swing=18.0, swing_chunk=1.0, nodes=5.0, settling=1.0, rest=0.25)


@dataclass(slots=True)
class _Unit:
    """What is on its way to the screen from one acquisition unit."""

    decimator: DisplayDecimator
    sampling_rate: float  # [Hz]
    recent: RecentSamples = field(default_factory=RecentSamples)
    last_sequence: int = -1
    block_duration: float = 0.0  # [s]
    waiting: list[AccelerationBlock] = field(default_factory=list)
    faulty: frozenset[str] | None = None  # channels; None before the first block


class TurbineScreen:
    """Draws one turbine's messages. Remembers estimates until their posterior, and the truth."""

    def __init__(
        self,
        recording: rr.RecordingStream,
        turbine: str,
        description: TurbineDescription,
        *,
        pace: Pace,
    ) -> None:
        self._recording = recording
        self._turbine = turbine
        self._description = description
        self._root = turbine_path(turbine)
        self._outline = outline(description)
        self._pace = pace
        self._status = SessionStatus(turbine, title=description.title)
        self._layouts: dict[str, SensorLayout] = {}
        self._units: dict[str, _Unit] = {}
        self._modes = tuple(mode.name for mode in description.reference_modes)
        self._estimates: dict[int, ModalEstimate] = {}  # by window, those without a posterior yet
        self._found: tuple[int, list[float]] = (-1, [])  # newest window, its frequencies [Hz]
        self._truth: FoundationTruth | None = None
        self._changed = False  # a change was noticed
        self._sized = False  # and its size is known
        self._in_farm = False  # one of several turbines
        self._styled: set[str] = set()
        self._nodes: dict[str, int] = {}  # node → time of its latest row; has its style
        self._behind_most: dict[str, float] = {}  # node → most since its latest row [s]
        self._swings: dict[str, int] = {}  # shown shape → time until which its frames are out
        self._full_swing_ns: int | None = None  # end of the first window with a posterior
        self._now_ns = 0  # latest sensor time seen
        self._handed_over = -np.inf  # when, by the machine's clock [s]
        self._at_ns = 0  # sensor time of what is being drawn
        tower_views.log_tower(recording, self._root, self._outline)
        foundation_views.log_foundation_styles(recording, self._root)
        self._place_modes()

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
        layouts = tuple(self._layouts.values())
        return TurbinePanel(
            *(self._turbine, layouts, self._modes, middle, self._changed, self._sized)
        )

    def continued_on(self, recording: rr.RecordingStream) -> "TurbineScreen":
        """The same turbine on another recording, with what stands drawn there first."""
        screen = TurbineScreen(recording, self._turbine, self._description, pace=self._pace)
        screen._status, screen._truth = self._status, self._truth
        screen._estimates = self._estimates
        screen._now_ns = self._now_ns
        if screen._modes != self._modes:
            screen._modes = self._modes
            screen._place_modes()
        for layout in self._layouts.values():
            screen.show_layout(layout)
        if self._in_farm:
            screen.join_farm()
        return screen

    def show_layout(self, layout: SensorLayout) -> None:
        """Sensors on the tower, names on the signals."""
        self._layouts[layout.layout_id] = layout
        track_views.log_signal_style(self._recording, self._root, layout)
        tower_views.log_sensors(self._recording, self._root, layout)

    def show_block(self, block: AccelerationBlock) -> None:
        """Accelerations at display rate, gathered into chunks."""
        unit = self._units.get(block.unit)
        if unit is None:
            unit = self._units[block.unit] = _Unit(
                DisplayDecimator(block.sampling_rate), block.sampling_rate
            )
        unit.waiting.append(block)
        unit.recent.push(block)
        unit.last_sequence, unit.block_duration = block.sequence, block.duration
        end_ns = block.end_ns
        self._now_ns = max(self._now_ns, end_ns)
        is_due = end_ns - unit.waiting[0].start_ns >= self._pace.signals * NANOSECONDS
        if is_due and time.monotonic() - self._handed_over >= self._pace.rest:
            self._hand_over(block.unit, unit)
            self._swing_on(self._pace.swing_chunk)
            self._handed_over = time.monotonic()

    def show_estimate(self, estimate: ModalEstimate) -> None:
        """Identified frequencies; shapes and tracks follow with the posterior that pairs them."""
        self._estimates[estimate.window] = estimate
        layout = self._layout_named(estimate.layout_id)
        self._at(estimate.end_ns)
        track_views.log_estimate(self._recording, self._root, estimate, layout, styled=self._styled)
        frequencies = [mode.frequency for mode in estimate.modes]
        self._found = (estimate.window, frequencies)
        self._event(f"window {estimate.window}: {frequencies_text(frequencies)}")
        self._show_spectrum(estimate, layout)
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
        self._event(f"window {rejected.window} rejected: {rejected.reason}", level="WARN")
        self._status.take(rejected)
        self._show_status()

    def show_posterior(self, posterior: FoundationPosterior) -> None:
        """Bands, joint posterior, tracks and shapes of the paired modes."""
        if not self._modes:
            self._modes = tuple(pair.model for pair in posterior.pairs[:MAX_MODES])
            self._place_modes()
        self._at(posterior.time_ns)
        recording, root = self._recording, self._root
        foundation_views.log_posterior_bands(recording, root, posterior, self._truth)
        if self._in_farm:
            foundation_views.log_medians(recording, posterior)
        foundation_views.log_joint_posterior(recording, root, posterior, self._truth)
        foundation_views.log_learned(recording, root, posterior)
        picture = pile_picture(posterior, self._description, self._truth)
        foundation_views.log_pile(recording, root, picture)
        self._show_matrix(posterior)
        self._show_modes(posterior)
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
        if not self._changed:
            self._changed = True
            foundation_views.log_change_styles(self._recording, self._root)
        self._sized = self._sized or bool(event.changes)
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
        behind = max(self._behind(node.last_sequence), self._behind_most.get(node.node, 0.0))
        if self._is_due(node.node) or news:
            foundation_views.log_node(self._recording, self._root, node, behind=behind)
            behind = 0.0
        self._behind_most[node.node] = behind
        if news:
            self._event(f"node {node.node}: {node.state}, {node.lost} lost, {node.late} late")
            self._show_status()

    def _is_due(self, node: str) -> bool:
        """Whether a node's plots get their next row now; the first comes with their style."""
        if node not in self._nodes:
            slot = len(self._nodes)
            foundation_views.log_node_styles(self._recording, self._root, node, slot)
        elif self._now_ns - self._nodes[node] < self._pace.nodes * NANOSECONDS:
            return False
        self._nodes[node] = self._now_ns
        return True

    def finish(self) -> None:
        """Hand over what still waits."""
        for name, unit in self._units.items():
            self._hand_over(name, unit)
        self._swing_on(0.0)
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

    def _show_status(self) -> None:
        recording, root = self._recording, self._root
        foundation_views.log_status(recording, root, self._status.markdown())
        foundation_views.log_health(recording, root, self._status.health_markdown())
        plane_views.log_lamps(recording, root, self._status.lamps)

    def _behind(self, last_sequence: int) -> float:
        """Measured time between the block that a node took last and the newest one [s]."""
        if last_sequence < 0 or not self._units:
            return 0.0
        newest = max(self._units.values(), key=lambda unit: unit.last_sequence)
        return max(0, newest.last_sequence - last_sequence) * newest.block_duration

    def _show_spectrum(self, estimate: ModalEstimate, layout: SensorLayout | None) -> None:
        unit = None if layout is None else self._units.get(layout.unit)
        if unit is None or layout is None:
            return
        samples = unit.recent.between(estimate.start_ns, estimate.end_ns)
        if samples is None or samples.shape[1] != len(layout.channels):
            return
        frequencies = [mode.frequency for mode in estimate.modes]
        picture = spectrum_picture(samples, unit.sampling_rate, layout, frequencies)
        plane_views.log_spectrum(self._recording, self._root, picture)

    def _show_matrix(self, posterior: FoundationPosterior) -> None:
        estimate = self._estimates.get(posterior.window)
        layout = self._layout_of(posterior, estimate)
        matrix = None
        if estimate is not None and layout is not None:
            matrix = mac_matrix(estimate, posterior, layout)
        if matrix is not None:
            plane_views.log_mac_matrix(self._recording, self._root, matrix)

    def _hand_over(self, name: str, unit: _Unit) -> None:
        blocks, unit.waiting = unit.waiting, []
        if not blocks:
            return
        runs = list(joined_runs(blocks))
        stated = any(block.status for block in blocks)
        if stated or unit.faulty != NONE_FAULTY or not all(map(_is_whole, runs)):
            for block in blocks:
                self._show_faults(block, unit)
        signals = [unit.decimator.push(run) for run in runs]
        track_views.log_signal(self._recording, self._root, name, signals)

    def _show_faults(self, block: AccelerationBlock, unit: _Unit) -> None:
        layout = self._layouts.get(block.layout_id)
        if layout is None:
            return
        faulty = faulty_channels(block, layout)
        if faulty == unit.faulty:
            return
        self._at(block.start_ns)
        tower_views.log_sensor_health(self._recording, self._root, layout, faulty=faulty)
        if faulty or unit.faulty:
            names = ", ".join(sorted(faulty)) or "none any more"
            self._event(f"faulty channels of unit {block.unit}: {names}", level="WARN")
        unit.faulty = faulty

    def _place_modes(self) -> None:
        for slot, label in enumerate(self._modes):
            track_views.log_mode_styles(self._recording, self._root, label, slot)
            tower_views.log_shape_place(self._recording, self._root, label, slot, self._outline)

    def _show_modes(self, posterior: FoundationPosterior) -> None:
        estimate = self._estimate_of(posterior)
        layout = self._layout_of(posterior, estimate)
        pairs = {pair.model: pair for pair in posterior.pairs}
        for row, label in enumerate(posterior.model_labels):
            if label in self._modes:
                frequency = float(posterior.model_frequencies[row])
                track_views.log_model_frequency(self._recording, self._root, label, frequency)
                mode = _identified(pairs.get(label), estimate)
                if mode is not None:
                    track_views.log_identified(self._recording, self._root, label, mode)
                if layout is not None:
                    shape = posterior.model_shapes[row]
                    model = deflection(layout, layout.channel_names, shape)
                    tower_views.log_model_shape(self._recording, self._root, label, model)
                    self._show_identified_shape(label, shape, mode, estimate, layout)
                    self._caption(label, model, pairs.get(label))
                    self._swings.setdefault(label, posterior.time_ns)
        if self._full_swing_ns is None:
            self._full_swing_ns = posterior.time_ns
        self._swing_on(self._pace.swing_chunk)

    def _estimate_of(self, posterior: FoundationPosterior) -> ModalEstimate | None:
        """The estimate of the posterior's own window; it and earlier ones are then forgotten.

        In a fast replay the identification runs windows ahead of the updating.
        """
        estimate = self._estimates.get(posterior.window)
        for window in [each for each in self._estimates if each <= posterior.window]:
            del self._estimates[window]
        return estimate

    def _show_identified_shape(
        self,
        label: str,
        model_shape: FloatArray,
        mode: Mode | None,
        estimate: ModalEstimate | None,
        layout: SensorLayout,
    ) -> None:
        """The identified shape laid on the model's; none where the window lacks the mode."""
        identified = None
        if mode is not None and estimate is not None:
            columns = [layout.channel_names.index(name) for name in estimate.channels]
            scaled = scaled_onto(mode.shape, model_shape[columns])
            identified = deflection(layout, estimate.channels, scaled)
        tower_views.log_identified_shape(self._recording, self._root, label, identified)

    def _caption(self, label: str, model: Deflection, pair: ModePair | None) -> None:
        words = [model.direction]
        words += [f"{pair.frequency:.3g}", f"{pair.mac:.2f}"] if pair else ["–"]
        foot = self._outline.mudline - 8.0
        tower_views.log_shape_caption(self._recording, self._root, label, words, foot=foot)

    def _layout_of(
        self, posterior: FoundationPosterior, estimate: ModalEstimate | None
    ) -> SensorLayout | None:
        """The layout whose channels the model's shapes have: the estimate's, else any."""
        names = [estimate.layout_id] if estimate else list(self._layouts)
        layouts = [found for name in names if (found := self._layout_named(name)) is not None]
        n_channels = posterior.model_shapes.shape[1]
        return next((one for one in layouts if len(one.channels) == n_channels), None)

    def _layout_named(self, layout_id: str) -> SensorLayout | None:
        """A unit's layout, or that of all units together under their joined name."""
        if layout_id in self._layouts or not self._layouts:
            return self._layouts.get(layout_id)
        units = {layout.unit: layout for layout in self._layouts.values()}  # the last that was new
        joined = joined_layout([units[unit] for unit in sorted(units)])
        return joined if joined.layout_id == layout_id else None

    def _swing_on(self, at_least: float) -> None:
        """Frames of every shown shape up to now, where `at_least` [s] of them are due."""
        if self._full_swing_ns is None:
            return
        for label, until_ns in self._swings.items():
            if self._now_ns - until_ns < at_least * NANOSECONDS:
                continue
            frames = swing_frames(
                until_ns,
                self._now_ns + 1,
                full_swing_ns=self._full_swing_ns,
                period=self._pace.swing,
            )
            tower_views.log_swing(self._recording, self._root, label, frames)
            self._swings[label] = self._now_ns + 1


def _is_whole(block: AccelerationBlock) -> bool:
    return bool(np.isfinite(block.samples).all())


def faulty_channels(block: AccelerationBlock, layout: SensorLayout) -> frozenset[str]:
    """Channels with a sample that is not finite; all of them where the unit reports a fault."""
    if block.status & (BlockStatus.SENSOR_FAULT | BlockStatus.CLIPPED):
        return frozenset(layout.channel_names)
    broken = np.flatnonzero(~np.isfinite(block.samples).all(axis=0))
    return frozenset(layout.channel_names[channel] for channel in broken)


def _identified(pair: ModePair | None, estimate: ModalEstimate | None) -> Mode | None:
    """The pair's mode as this window has it; None where it lacks it. Of two modes that cannot be
    separated, "m1+m2", the first: both have the same frequency."""
    if pair is None or estimate is None:
        return None
    names = pair.identified.split("+")
    return next((mode for mode in estimate.modes if mode.name in names), None)
