"""Draw the modes of one turbine, identified and modelled: tracks, moving shapes, MAC."""

from collections.abc import Container, Sequence

import numpy as np
import rerun as rr

from pipeline.messages import FoundationPosterior, ModalEstimate, Mode, ModePair
from pipeline.state.phrases import in_hertz
from pipeline.state.run_modes import SeenMode, pairs_by_track
from pipeline.viewer.drawing import plots_2d as plane_views
from pipeline.viewer.drawing import tower as tower_views
from pipeline.viewer.drawing import tracks as track_views
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.mac_matrix import mac_matrix
from pipeline.viewer.pictures.scene import (
    Deflection,
    Outline,
    deflection,
    scale_onto,
    swing_frames,
)
from pipeline.viewer.update_rates import UpdateRates
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

MAX_MODES = 12  # plots of single modes, where the description names no reference modes
CAPTION_DEPTH = 8.0  # of the text below a shape, under the mudline [m]


class ModeView:
    """Draw each posterior's modes beside those identified in its window, and move the shapes.

    Parameters
    ----------
    labels : tuple[str, ...]
        Model modes that have a track and a shape.
    follows : bool
        Whether further model modes get a track and a shape as soon as a mode is paired with them,
        up to MAX_MODES: of a description that names none itself.
    """

    def __init__(
        self,
        recording: rr.RecordingStream,
        root: str,
        outline: Outline,
        *,
        labels: tuple[str, ...],
        follows: bool,
        rates: UpdateRates,
    ) -> None:
        self._follows = follows
        self._recording = recording
        self._root = root
        self._outline = outline
        self._rates = rates
        self._labels = labels
        self._drawn_until_ns: dict[
            str, int
        ] = {}  # shown shape → time until which its frames are out
        self._shapes: dict[str, FloatArray] = {}  # latest identified shape, without a model
        self._full_swing_ns: int | None = None  # end of the first window with a posterior
        self._log_places()

    @property
    def labels(self) -> tuple[str, ...]:
        """Model modes that have a track and a shape."""
        return self._labels

    def show(
        self,
        posterior: FoundationPosterior,
        estimate: ModalEstimate | None,
        layout: SensorLayout | None,
    ) -> None:
        """Tracks, shapes and MAC of a posterior and its own window, where that is known."""
        paired = _paired(posterior, estimate)
        if self._follows:
            self._follow(posterior.model_labels, paired)
        if estimate is not None:
            matrix = mac_matrix(estimate, posterior)
            if matrix is not None:
                plane_views.log_mac_matrix(self._recording, self._root, matrix)
        for row, label in enumerate(posterior.model_labels):
            if label in self._labels:
                pair, mode = paired.get(label, (None, None))
                self._draw_track(label, _model_frequency(posterior, row, pair), mode)
                if layout is not None:
                    channels = layout.channel_names if estimate is None else estimate.channels
                    shape = posterior.model_shapes[row]
                    model = deflection(layout, channels, shape).scaled(self._outline.scale)
                    tower_views.log_model_shape(self._recording, self._root, label, model)
                    self._draw_identified_shape(label, shape, mode, channels, layout)
                    self._caption(label, model, pair)
                    self._drawn_until_ns.setdefault(label, posterior.time_ns)
        if self._full_swing_ns is None:
            self._full_swing_ns = posterior.time_ns

    def draw_estimate(self, estimate: ModalEstimate, layout: SensorLayout | None) -> None:
        """Draw the tracks and shapes of identified modes where there is no model."""
        names = [mode.name for mode in estimate.modes if mode.name]
        self._add_labels(names)
        for mode in estimate.modes:
            if mode.name in self._labels:
                track_views.log_identified(self._recording, self._root, mode.name, mode)
                if layout is not None:
                    self._draw_measured_shape(mode, estimate, layout)
        for label in self._shapes:
            if label not in names:
                self._clear_measured_shape(label)
        if self._full_swing_ns is None:
            self._full_swing_ns = estimate.end_ns

    def _follow(self, model_labels: Sequence[str], paired: Container[str]) -> None:
        """Give the model modes that have a partner now a place, in the model's order.

        One whose partner is not found any more keeps its place; without a free place nothing
        changes: a place that changed hands would show two modes as one over time.
        """
        new = [name for name in model_labels if name in paired and name not in self._labels]
        if new := new[: MAX_MODES - len(self._labels)]:
            shown = {*self._labels, *new}
            self._labels = tuple(name for name in model_labels if name in shown)
            self._log_places()

    def _add_labels(self, names: list[str]) -> None:
        new = [name for name in names if name not in self._labels]
        if new:
            self._labels = (*self._labels, *new)[:MAX_MODES]
            self._log_places(colours.MEASURED)

    def _draw_measured_shape(
        self, mode: Mode, estimate: ModalEstimate, layout: SensorLayout
    ) -> None:
        """Draw an identified shape at its sensors, largest component 1, in a steady sign."""
        shape = mode.shape / np.abs(mode.shape).max()
        before = self._shapes.get(mode.name)
        if before is not None and before.shape == shape.shape and before @ shape < 0:
            shape = -shape
        self._shapes[mode.name] = shape
        drawn = deflection(layout, estimate.channels, shape).scaled(self._outline.scale)
        tower_views.log_model_shape(self._recording, self._root, mode.name, drawn)
        tower_views.log_identified_shape(self._recording, self._root, mode.name, drawn)
        foot = self._outline.mudline - CAPTION_DEPTH
        lines = [drawn.direction, in_hertz(mode.frequency)]
        tower_views.log_shape_caption(self._recording, self._root, mode.name, lines, foot=foot)
        self._drawn_until_ns.setdefault(mode.name, estimate.end_ns)

    def _clear_measured_shape(self, label: str) -> None:
        """Draw no shape of a mode that this window lacks, not an earlier window's."""
        tower_views.log_model_shape(self._recording, self._root, label, None)
        tower_views.log_identified_shape(self._recording, self._root, label, None)
        foot = self._outline.mudline - CAPTION_DEPTH
        tower_views.log_shape_caption(self._recording, self._root, label, ["–"], foot=foot)

    def extend_motion(self, now_ns: int, *, at_least: float) -> None:
        """Frames of every shown shape up to `now_ns`, where `at_least` [s] of them are due."""
        if self._full_swing_ns is None:
            return
        for label, until_ns in self._drawn_until_ns.items():
            if now_ns - until_ns < at_least * NANOSECONDS:
                continue
            frames = swing_frames(
                *(until_ns, now_ns + 1),
                full_swing_ns=self._full_swing_ns,
                period=self._rates.swing,
            )
            tower_views.log_swing(self._recording, self._root, label, frames)
            self._drawn_until_ns[label] = now_ns + 1

    def _log_places(self, colour: colours.Colour = colours.MODEL) -> None:
        for slot, label in enumerate(self._labels):
            track_views.log_mode_styles(self._recording, self._root, label, slot)
            tower_views.log_shape_place(
                *(self._recording, self._root, label, slot, self._outline), colour=colour
            )

    def _draw_track(self, label: str, frequency: float, mode: Mode | None) -> None:
        track_views.log_model_frequency(self._recording, self._root, label, frequency)
        if mode is not None:
            track_views.log_identified(self._recording, self._root, label, mode)

    def _draw_identified_shape(
        self,
        label: str,
        model_shape: FloatArray,
        mode: Mode | None,
        channels: Sequence[str],
        layout: SensorLayout,
    ) -> None:
        """Draw the identified shape scaled to the model's; none where the window lacks the mode."""
        identified = None
        if mode is not None:
            scaled = scale_onto(mode.shape, model_shape)
            identified = deflection(layout, channels, scaled).scaled(self._outline.scale)
        tower_views.log_identified_shape(self._recording, self._root, label, identified)

    def _caption(self, label: str, model: Deflection, pair: ModePair | None) -> None:
        mean = " ≈" if pair and "+" in pair.identified else ""  # here: figures fill their room
        lines = [f"{model.direction}{mean}"]
        lines += [in_hertz(pair.frequency), f"{pair.mac:.2f}"] if pair else ["–"]
        foot = self._outline.mudline - CAPTION_DEPTH
        tower_views.log_shape_caption(self._recording, self._root, label, lines, foot=foot)


def _model_frequency(posterior: FoundationPosterior, row: int, pair: ModePair | None) -> float:
    """Return a model mode's frequency [Hz], as the tables have it.

    That of the pair is of the structure with its inferred figures; the posterior's own list is of
    the structure as described, which is another one where figures are inferred: NaN, a gap.
    """
    if pair is not None:
        return pair.model_frequency
    as_described = float(posterior.model_frequencies[row])
    return as_described if posterior.structure != "uncertain" else float("nan")


def _paired(
    posterior: FoundationPosterior, estimate: ModalEstimate | None
) -> dict[str, tuple[ModePair, Mode | None]]:
    """Return each model mode's pair with what was identified of it in this window, or None.

    Two modes that cannot be separated, "m1+m2", stand at the model modes whose shapes they have, as
    in the table of a run's modes.
    """
    modes = {} if estimate is None else {mode.name: mode for mode in estimate.modes}
    found = {pair.model: (pair, modes.get(pair.identified)) for pair in posterior.pairs}
    channels = () if estimate is None else estimate.channels
    seen = {name: SeenMode(mode, channels) for name, mode in modes.items()}
    for name, pair in pairs_by_track(seen, posterior, channels).items():
        if name in modes:
            found[pair.model] = (pair, modes[name])
    return found
