"""Cut ordered blocks into windows; identify each or reject it with a reason."""

import logging
import math
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import numpy as np

from pipeline.messages import (
    Message,
    ModalEstimate,
    QualityWarning,
    StreamGap,
    UnitOrigin,
    WindowRejected,
)
from pipeline.oma.data_quality.clock_offsets import NOTABLE, UNUSABLE, UnitOffset, unit_offset
from pipeline.oma.identification import Identification, identify
from pipeline.oma.preprocessing import MOST_MISSING
from pipeline.oma.settings import OmaSettings, OmaSettingsError
from pipeline.oma.ssi.ssi_cov import settings_for_channels
from pipeline.oma.ssi.stabilization import stabilisation_diagram
from pipeline.oma.tracking import ChannelPlaces, ModeTracker
from pipeline.oma.windows.unit_clock import (
    CLOCK_ERROR,
    ClockStep,
    text_of_step,
)
from pipeline.oma.windows.windowing import (
    Beginning,
    BlockOrder,
    MissingSamples,
    Window,
    WindowCutter,
)
from pipeline.oma.work_limit import CpuLimit, WorkLimitExceeded, working_within
from sensors.acquisition.blocks import AccelerationBlock, BlockStatus, parts_of
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

logger = logging.getLogger(__name__)

ColumnsOfUnits = dict[str, list[int]]  # which channels are a unit's, of several
Origins = Callable[[Window], tuple[UnitOrigin, ...]]
RotorSpeed = Callable[[int, int, int], FloatArray | None]
"""Start and end [ns], number of samples → speed at each sample, (n,) [rpm]; None: unknown."""

MOST_CLOCK_STEPS = 8  # of joined units' clocks that are reported with a window


@dataclass(frozen=True, slots=True)
class WindowContext:
    """What every window of a turbine has in common."""

    settings: OmaSettings
    rotor_speed: RotorSpeed
    """Of a window by SCADA."""
    limit: CpuLimit | None = None
    """What a window may cost; None: whatever it does."""
    unused: Counter[str] = field(default_factory=Counter)
    """Blocks of all sessions that came too late or twice: see `BlockOrder`."""

    def order(self, beginning: Beginning) -> BlockOrder:
        """Return the order of a unit's blocks from where they are expected to begin."""
        return BlockOrder(self.settings.lateness, beginning, self.unused)


class WindowIdentification:
    """Cuts ordered pieces into windows and answers each.

    Parameters
    ----------
    layouts : dict
        By their ids.
    origins : callable
        → where a window begins in its units' own counts.
    columns : dict, optional
        Which channels are a unit's, where several are joined.
    """

    def __init__(
        self,
        turbine: str,
        unit: str,
        layouts: dict[str, SensorLayout],
        context: WindowContext,
        *,
        origins: Origins,
        columns: ColumnsOfUnits | None = None,
    ) -> None:
        settings = context.settings
        self._limit = context.limit
        self._turbine, self._unit = turbine, unit
        self._origins_of = origins
        self._rotor_speed_of = context.rotor_speed
        self._unit_steps: list[tuple[str, ClockStep]] = []  # of joined units, since the last window
        self._cutter = WindowCutter(settings.window_duration, settings.hop)
        self._tracker = ModeTracker()
        self._settings = settings
        self._layouts = layouts
        self._columns = columns or {}

    @property
    def next_index(self) -> int:
        """Number of the next window."""
        return self._cutter.next_index

    @property
    def shift(self) -> int:
        """By how many samples it begins later than the nominal rate has it."""
        return self._cutter.shift

    def begin_at(self, index: int) -> None:
        """Begin with that window, those before having been answered."""
        self._cutter.begin_at(index)

    def note_step(self, unit: str, step: ClockStep) -> None:
        """Report with the next window that the stamps of a joined unit have stepped."""
        self._unit_steps = [*self._unit_steps, (unit, step)][-MOST_CLOCK_STEPS:]

    def push(self, piece: AccelerationBlock | MissingSamples) -> Iterator[Message]:
        """Take the next samples in order; give the answers to the windows that they close.

        A block longer than a hop is taken in parts, for what a window is identified from is not
        kept much longer than the window.
        """
        parts: Iterable[AccelerationBlock | MissingSamples]
        if isinstance(piece, MissingSamples):
            parts = (piece,)
        else:
            parts = parts_of(piece, math.ceil(self._settings.hop * piece.sampling_rate))
        for part in parts:
            for window in self._cutter.push(part):
                yield from self._answers(window)

    def finish(self) -> Iterator[Message]:
        """Give the answer to the window that the session ends in."""
        for window in self._cutter.finish():
            yield from self._answers(window)

    def recall(self, answer: ModalEstimate | WindowRejected) -> None:
        """Go on from the answer of an identification that has ended: modes keep their names."""
        if isinstance(answer, WindowRejected):
            self._tracker.missed()
            return
        layout = self._layouts.get(answer.layout_id)
        names = answer.channels if layout is None else layout.channel_names
        places = None
        if len(answer.channels) < len(names):
            columns = tuple(names.index(channel) for channel in answer.channels)
            places = ChannelPlaces(columns, len(names))
        self._tracker.recall(answer.modes, on=places)

    def gap(self, missing: MissingSamples, unit: str, session: str) -> StreamGap:
        """Return the message about samples of a unit that never came."""
        return StreamGap(
            turbine=self._turbine,
            unit=unit,
            session=session,
            start_ns=missing.start_ns,
            end_ns=missing.end_ns,
            first_sequence=missing.first_sequence,
            n_blocks=missing.n_blocks,
        )

    def _answers(self, window: Window) -> Iterator[Message]:
        """Yield a rejection; or an estimate, and the diagram behind it."""
        missing = self._missing_units(window)
        refusal = self._refusal(window, missing)
        if refusal is not None:
            yield self._rejected(window, refusal)
            return
        present = self._present(window, missing)
        names = self._names(window)
        try:
            with working_within(self._limit):
                result = self._identified(window, names, present if missing else None)
        except WorkLimitExceeded:
            yield self._rejected(window, self._too_much_work())
            return
        except OmaSettingsError as error:  # the scenario's, at this unit's rate
            yield self._rejected(window, QualityWarning("settings", str(error)))
            return
        except Exception as error:  # else it would end every window to come, at each start again
            logger.exception("window %d of %s", window.index, self._turbine)
            reason = f"the identification failed: {error!r}; the log has where"
            yield self._rejected(window, QualityWarning("failed", reason))
            return
        answer = self._answer(window, result, missing, present)
        yield answer
        if isinstance(answer, ModalEstimate):
            yield stabilisation_diagram(answer, result.diagrams, result.refused)

    def _too_much_work(self) -> QualityWarning:
        assert self._limit is not None
        return QualityWarning(
            "too-much-work",
            f"identification took more than {self._limit.seconds:g} s of CPU time and was given "
            "up ([limits] cpu_seconds): fewer channels, a lower rate or a higher limit are needed",
        )

    def _answer(
        self, window: Window, result: Identification, missing: dict[str, float], present: list[int]
    ) -> ModalEstimate | WindowRejected:
        """missing: units that lack samples [s]; present: channels that were identified."""
        names = self._names(window)
        if result.rejection is not None:
            return self._rejected(window, result.rejection)
        absent = tuple(
            QualityWarning("missing-unit", _missing_text({unit: span}, f"unit {unit}"))
            for unit, span in missing.items()
        )
        clocks = self._offset_warnings(window, result, missing) + self._step_warnings()
        unusable = next((each for each in clocks if each.code == "unsynchronised-units"), None)
        if unusable is not None:
            return self._rejected(window, unusable)
        places = ChannelPlaces(tuple(present), window.samples.shape[1]) if missing else None
        modes = self._tracker.named(result.modes, on=places)
        events = tuple(QualityWarning(f"mode-{e.kind}", e.text) for e in self._tracker.events)
        return ModalEstimate(
            turbine=self._turbine,
            window=window.index,
            start_ns=window.start_ns,
            end_ns=window.end_ns,
            layout_id=window.layout_id,
            channels=tuple(names[column] for column in present),
            modes=modes,
            weight=self._settings.hop / self._settings.window_duration,
            warnings=result.warnings + _status_warnings(window.status) + absent + clocks + events,
            origins=self._origins_of(window),
        )

    def _step_warnings(self) -> tuple[QualityWarning, ...]:
        steps, self._unit_steps = self._unit_steps, []
        return tuple(
            QualityWarning(
                "clock-step",
                f"the stamps of unit {unit} stepped by {step.seconds:+.3f} s against its sample "
                "count; it is left out until they agree with the others' again",
            )
            for unit, step in steps
        )

    def _present(self, window: Window, missing: Iterable[str]) -> list[int]:
        """Channels of the units that are there all the time."""
        absent = {column for unit in missing for column in self._columns[unit]}
        return [column for column in range(window.samples.shape[1]) if column not in absent]

    def _names(self, window: Window) -> tuple[str, ...]:
        n_channels = window.samples.shape[1]
        layout = self._layouts.get(window.layout_id)
        if layout is not None and len(layout.channels) == n_channels:
            return layout.channel_names
        return tuple(f"channel {i + 1}" for i in range(n_channels))

    def _identified(
        self, window: Window, names: tuple[str, ...], present: list[int] | None
    ) -> Identification:
        """present   channels to use where a unit is missing; None: all"""
        speed = self._rotor_speed_of(window.start_ns, window.end_ns, len(window.samples))
        samples = window.samples
        if present is not None:
            samples, names = samples[:, present], tuple(names[column] for column in present)
        settings = settings_for_channels(self._settings, names)
        return identify(
            samples, window.sampling_rate, settings, channel_names=names, rotor_speed=speed
        )

    def _missing_units(self, window: Window) -> dict[str, float]:
        """Units that lack samples on all of their channels, and for how long [s]."""
        if not window.samples.size:
            return {}
        absent = np.isnan(window.samples)
        lacking = {
            unit: int(absent[:, own].all(axis=1).sum()) for unit, own in self._columns.items()
        }
        most = MOST_MISSING * len(window.samples)
        return {
            unit: count / window.sampling_rate for unit, count in lacking.items() if count > most
        }

    def _offset_warnings(
        self, window: Window, result: Identification, missing: dict[str, float]
    ) -> tuple[QualityWarning, ...]:
        """Offsets of the units' clocks against the first one's, by the modes' phases."""
        if missing or len(self._columns) < 2:
            return ()
        (reference, first), *others = self._columns.items()
        warnings = []
        for unit, own in others:
            offset = unit_offset(window.samples, window.sampling_rate, result.modes, first, own)
            if offset is not None and offset.exceeds(NOTABLE):
                warnings.append(_offset_warning(unit, reference, offset))
        return tuple(warnings)

    def _refusal(self, window: Window, missing: dict[str, float]) -> QualityWarning | None:
        """Return why a window cannot be identified at all, before its samples are looked at."""
        if window.gaps and not window.samples.size:
            gap = max(window.gaps, key=lambda g: g.n_samples)
            others = f" ({len(window.gaps)} gaps in all)" if len(window.gaps) > 1 else ""
            return QualityWarning(
                "gap",
                f"gap of {gap.n_samples / window.sampling_rate:.3g} s in unit {self._unit} at "
                f"{gap.first_sample / window.sampling_rate:.3f} s{others}",
            )
        if window.complete and not window.samples.size:
            return QualityWarning("gap", f"no sample of unit {self._unit} is there for the window")
        if not window.complete:
            return QualityWarning(
                "short",
                f"the session of unit {self._unit} ended {window.duration:.6g} s into a window of "
                f"{self._settings.window_duration:g} s",
            )
        if window.steps:
            step = max(window.steps, key=lambda each: abs(each.seconds))
            more = f" ({len(window.steps)} steps in all)" if len(window.steps) > 1 else ""
            text = text_of_step(step, self._unit, window.first_sample, window.sampling_rate)
            return QualityWarning("clock-step", text + more)
        if window.clock is not None and window.clock.exceeds(CLOCK_ERROR):
            return QualityWarning(
                "clock-rate",
                f"the stamps of unit {self._unit} run {1e2 * window.clock.drift:+.2f} % against "
                "its sampling rate: one of them is wrong",
            )
        if window.status & BlockStatus.SENSOR_FAULT:
            return QualityWarning("sensor-fault", f"unit {self._unit} reports a faulty channel")
        if len(missing) == len(self._columns) > 0:
            return QualityWarning("gap", _missing_text(missing, "every unit"))
        return None

    def _rejected(self, window: Window, why: QualityWarning) -> WindowRejected:
        self._tracker.missed()
        before = window.passed_over
        return WindowRejected(
            turbine=self._turbine,
            window=window.index,
            start_ns=window.start_ns,
            end_ns=window.end_ns,
            code=why.code,
            reason=why.text
            + (f"; {before} windows before it lie in the same gap" if before else ""),
            origins=self._origins_of(window),
            windows_before=before,
        )


def _missing_text(missing: dict[str, float], who: str) -> str:
    longest = max(missing.values())
    return f"{who} is missing for {longest:.3g} s of the window; its channels are left out"


def _offset_warning(unit: str, reference: str, offset: UnitOffset) -> QualityWarning:
    apart = (
        f"the stamps of unit {unit} are {1e3 * offset.seconds:+.2f} ± {1e3 * offset.std:.2f} ms "
        f"off those of unit {reference} by the phase of the modes"
    )
    if offset.exceeds(UNUSABLE):
        return QualityWarning(
            "unsynchronised-units", f"{apart}; more than {1e3 * UNUSABLE:g} ms spoils the shapes"
        )
    return QualityWarning("unit-offset", f"{apart}; the shapes suffer above {1e3 * NOTABLE:g} ms")


def _status_warnings(status: BlockStatus) -> tuple[QualityWarning, ...]:
    """Return what the unit itself reported of the window's blocks."""
    warnings = []
    if status & BlockStatus.CLIPPED:
        warnings.append(
            QualityWarning("clipped", "the unit reports samples at its converter's limit")
        )
    if status & BlockStatus.CLOCK_UNSYNCHRONISED:
        warnings.append(
            QualityWarning(
                "unsynchronised-clock", "the unit reports that it has lost its time reference"
            )
        )
    return tuple(warnings)
