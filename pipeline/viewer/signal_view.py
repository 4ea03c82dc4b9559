"""Draw the measured accelerations of one turbine, the health of its channels, their spectra."""

import time
from dataclasses import dataclass, field
from itertools import groupby

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from pipeline.messages import FoundationPosterior, ModalEstimate
from pipeline.viewer.drawing import plots_2d as plane_views
from pipeline.viewer.drawing import tower as tower_views
from pipeline.viewer.drawing import tracks as track_views
from pipeline.viewer.drawing.entities import at, signal_path, signal_paths
from pipeline.viewer.pictures.display_signals import DisplayDecimator, join_runs
from pipeline.viewer.pictures.spectrum import RecentSamples, spectrum_picture
from pipeline.viewer.update_rates import UpdateRates
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.layout import SensorLayout, joined_layout

NONE_FAULTY: frozenset[str] = frozenset()


class KnownLayouts:
    """Layouts by name, the newest of each unit last; also that of all units together."""

    def __init__(self) -> None:
        self._by_id: dict[str, SensorLayout] = {}

    def add(self, layout: SensorLayout) -> None:
        """Add a layout; it replaces an earlier one with the same id."""
        self._by_id[layout.layout_id] = layout

    @property
    def all(self) -> tuple[SensorLayout, ...]:
        """Every layout, in the order of arrival."""
        return tuple(self._by_id.values())

    def named(self, layout_id: str) -> SensorLayout | None:
        """Return a unit's layout, or that of all units together under their joined name."""
        units = self.units_of(layout_id)
        return joined_layout(units) if units else None

    def units_of(self, layout_id: str) -> tuple[SensorLayout, ...]:
        """Return the layouts of the units that a name stands for, in the order of its channels."""
        if layout_id in self._by_id:
            return (self._by_id[layout_id],)
        newest = {layout.unit: layout for layout in self.all}
        units = tuple(newest[unit] for unit in sorted(newest))
        return units if units and joined_layout(units).layout_id == layout_id else ()

    def of_posterior(
        self, posterior: FoundationPosterior, estimate: ModalEstimate | None
    ) -> SensorLayout | None:
        """Return the layout whose channels the model's shapes have: the estimate's.

        Where that is not known, the one that has as many channels, if no other one has.
        """
        n_channels = posterior.model_shapes.shape[1]
        if estimate is None:
            fitting = {each.channels: each for each in self.all if len(each.channels) == n_channels}
            return next(iter(fitting.values())) if len(fitting) == 1 else None
        layout = self.named(estimate.layout_id)
        if layout is None or not set(estimate.channels) <= set(layout.channel_names):
            return None
        return layout if len(estimate.channels) == n_channels else None


@dataclass(frozen=True, slots=True)
class FaultyChannels:
    """A change of the set of faulty channels of one acquisition unit."""

    time_ns: int
    """Start of the first block that shows it [ns, UTC]."""
    text: str
    """One line for the event list."""


@dataclass(slots=True)
class _Unit:
    """Blocks of one acquisition unit that are not drawn yet."""

    decimator: DisplayDecimator
    recent: RecentSamples = field(default_factory=RecentSamples)
    last_sequence: int = -1
    block_duration: float = 0.0
    """Duration of the latest block [s]."""
    waiting: list[AccelerationBlock] = field(default_factory=list)
    faulty: frozenset[str] | None = None
    """Names of faulty channels; None before the first block."""


class SignalView:
    """Draw accelerations at display rate, gathered into chunks as the update rates set."""

    def __init__(
        self, recording: rr.RecordingStream, root: str, layouts: KnownLayouts, *, rates: UpdateRates
    ) -> None:
        self._recording = recording
        self._root = root
        self._layouts = layouts
        self._rates = rates
        self._units: dict[str, _Unit] = {}
        self._handed_over = -np.inf  # when, by the machine's clock [s]

    def take(self, block: AccelerationBlock) -> bool:
        """Keep one block; return whether its unit's blocks are due to be drawn."""
        unit = self._units.get(block.unit)
        if unit is None:
            unit = self._units[block.unit] = _Unit(DisplayDecimator(block.sampling_rate))
        unit.waiting.append(block)
        unit.recent.push(block)
        unit.last_sequence, unit.block_duration = block.sequence, block.duration
        is_due = block.end_ns - unit.waiting[0].start_ns >= self._rates.signals * NANOSECONDS
        return is_due and time.monotonic() - self._handed_over >= self._rates.min_interval

    def hand_over(self, name: str) -> list[FaultyChannels]:
        """Draw the buffered blocks of one unit; return the faults among them."""
        unit = self._units[name]
        blocks, unit.waiting = unit.waiting, []
        if not blocks:
            return []
        runs = list(join_runs(blocks))
        faults: list[FaultyChannels] = []
        stated = any(block.status for block in blocks)
        if stated or unit.faulty != NONE_FAULTY or not all(map(_is_whole, runs)):
            faults = [fault for block in blocks for fault in self._faults_of(block, unit)]
        shown = [(self._signal_path(run), unit.decimator.push(run)) for run in runs]
        for (path, _), chunk in groupby(shown, lambda each: (each[0], each[1].samples.shape[1])):
            track_views.log_signal(self._recording, path, [signal for _, signal in chunk])
        self._handed_over = time.monotonic()
        return faults

    def _signal_path(self, block: AccelerationBlock) -> str:
        paths = signal_paths(self._root, self._layouts.all)
        later = (
            block.layout_id if any(each.unit == block.unit for each in self._layouts.all) else ""
        )
        return paths.get(block.layout_id) or signal_path(self._root, block.unit, later)

    def finish(self) -> list[FaultyChannels]:
        """Draw the buffered blocks of every unit; return the faults among them."""
        return [fault for name in self._units for fault in self.hand_over(name)]

    def behind(self, last_sequence: int) -> float:
        """Return the measured time between a node's last block and the newest one [s]."""
        if last_sequence < 0 or not self._units:
            return 0.0
        newest = max(self._units.values(), key=lambda unit: unit.last_sequence)
        return max(0, newest.last_sequence - last_sequence) * newest.block_duration

    def draw_spectrum(self, estimate: ModalEstimate) -> None:
        """Draw the spectra of the window's samples, of all of its units, as far as they are still
        in memory."""
        layouts = self._layouts.units_of(estimate.layout_id)
        parts: list[NDArray[np.float32]] = []
        rates: set[float] = set()
        for layout in layouts:
            unit = self._units.get(layout.unit)
            found = unit and unit.recent.between(estimate.start_ns, estimate.end_ns)
            if not found or found[0].shape[1] != len(layout.channels):
                return
            parts.append(found[0])
            rates.add(found[1])
        if len(rates) != 1:
            return
        length = min(map(len, parts))
        picture = spectrum_picture(
            np.hstack([part[-length:] for part in parts]),
            rates.pop(),
            layouts,
            [mode.frequency for mode in estimate.modes],
            duration=estimate.duration,
        )
        plane_views.log_spectrum(self._recording, self._root, picture)

    def _faults_of(self, block: AccelerationBlock, unit: _Unit) -> list[FaultyChannels]:
        """Colour the unit's sensors where their health changes with this block."""
        layout = self._layouts.named(block.layout_id)
        if layout is None or len(layout.channels) != block.samples.shape[1]:
            return []
        faulty, before = faulty_channels(block, layout), unit.faulty
        if faulty == before:
            return []
        unit.faulty = faulty
        at(self._recording, block.start_ns)
        tower_views.log_sensor_health(self._recording, self._root, layout, faulty=faulty)
        if not (faulty or before):
            return []
        names = ", ".join(sorted(faulty)) or "none"
        return [FaultyChannels(block.start_ns, f"faulty channels of unit {block.unit}: {names}")]


def faulty_channels(block: AccelerationBlock, layout: SensorLayout) -> frozenset[str]:
    """Return the channels with a sample that is not finite; all where the unit reports a fault."""
    if block.status & (BlockStatus.SENSOR_FAULT | BlockStatus.CLIPPED):
        return frozenset(layout.channel_names)
    broken = np.flatnonzero(~np.isfinite(block.samples).all(axis=0))
    return frozenset(layout.channel_names[channel] for channel in broken)


def _is_whole(block: AccelerationBlock) -> bool:
    return bool(np.isfinite(block.samples).all())
