"""IdentificationNode: acceleration blocks in, one modal estimate a window out."""

from collections.abc import Iterable, Iterator

from pipeline.messages import (
    Message,
    ModalEstimate,
    StreamEnd,
    StreamGap,
    Warning,  # noqa: A004  # the field's word
    WindowRejected,
)
from pipeline.oma.identification import Identification
from pipeline.oma.settings import OmaSettings
from pipeline.oma.streaming import StreamingIdentifier
from pipeline.oma.tracking import ModeTracker
from pipeline.oma.windowing import BlockOrder, MissingSamples, Window, WindowCutter
from sensors.blocks import AccelerationBlock, BlockStatus
from sensors.layout import SensorLayout


class IdentificationNode:
    """Cuts each unit's blocks into windows and identifies them.

    Answers every window with a ModalEstimate or a WindowRejected, and every gap with a StreamGap.
    Windows begin with the session's first sample; a new session begins anew.
    """

    name = "identification"
    inputs: tuple[type, ...] = (SensorLayout, AccelerationBlock, StreamEnd)

    def __init__(self, settings: OmaSettings | None = None):
        self._settings = settings or OmaSettings()
        self._layouts: dict[str, SensorLayout] = {}
        self._sessions: dict[tuple[str, str], _Session] = {}  # by turbine and unit
        self._ends: dict[tuple[str, str, str], StreamEnd] = {}  # announced, blocks still missing

    def handle(self, message: Message) -> Iterable[Message]:
        match message:
            case SensorLayout():
                self._layouts[message.layout_id] = message
            case AccelerationBlock():
                yield from self._take(message)
            case StreamEnd():
                self._ends[message.turbine, message.unit, message.session] = message
                yield from self._finish_if_complete(message.turbine, message.unit)

    def close(self) -> None:
        """Nothing is held."""

    def _take(self, block: AccelerationBlock) -> Iterator[Message]:
        key = (block.turbine, block.unit)
        session = self._sessions.get(key)
        if session is None or session.session != block.session:
            if session is not None:
                yield from session.finish()
            session = self._sessions[key] = _Session(block, self._settings, self._layouts)
        yield from session.push(block)
        yield from self._finish_if_complete(block.turbine, block.unit)

    def _finish_if_complete(self, turbine: str, unit: str) -> Iterator[Message]:
        """Finish a session whose end and last block are both here, whichever came first: they
        travel on different keys, so an end may overtake blocks that had to be fetched again."""
        session = self._sessions.get((turbine, unit))
        if session is None:
            return
        end = self._ends.get((turbine, unit, session.session))
        if end is not None and session.newest_ns >= end.time_ns:
            del self._ends[turbine, unit, session.session], self._sessions[turbine, unit]
            yield from session.finish()

    @property
    def late(self) -> int:
        """Blocks of the present sessions that came too late to be used."""
        return sum(session.order.late for session in self._sessions.values())

    @property
    def duplicate(self) -> int:
        """Blocks of the present sessions that came twice."""
        return sum(session.order.duplicate for session in self._sessions.values())


class _Session:
    """What must be remembered of one unit's running session."""

    def __init__(
        self,
        first: AccelerationBlock,
        settings: OmaSettings,
        layouts: dict[str, SensorLayout],
    ):
        self.turbine, self.unit, self.session = first.turbine, first.unit, first.session
        self.order = BlockOrder(settings.lateness)
        self.newest_ns = 0  # end of the newest block [ns]
        self._cutter = WindowCutter(settings.window_duration, settings.hop)
        self._tracker = ModeTracker()
        self._stretch: StreamingIdentifier | None = None  # since the last gap
        self._origin = 0  # the stretch's first sample, where a window begins
        self._settings = settings
        self._layouts = layouts

    def push(self, block: AccelerationBlock) -> Iterator[Message]:
        self.newest_ns = max(self.newest_ns, block.end_ns)
        yield from self._cut(self.order.push(block))

    def finish(self) -> Iterator[Message]:
        yield from self._cut(self.order.flush())
        for window in self._cutter.finish():
            yield self._answer(window)

    def _cut(self, pieces: Iterable[AccelerationBlock | MissingSamples]) -> Iterator[Message]:
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                self._stretch = None
                yield self._gap(piece)
            else:
                self._feed(piece)
            for window in self._cutter.push(piece):
                yield self._answer(window)

    def _feed(self, block: AccelerationBlock) -> None:
        """Into the running stretch, which after a gap begins with the next window's start."""
        if self._stretch is None:
            self._stretch = StreamingIdentifier(
                block.sampling_rate, block.samples.shape[1], self._settings
            )
            hop = self._stretch.hop_samples
            self._origin = -(-block.first_sample // hop) * hop
        before = max(0, self._origin - block.first_sample)
        self._stretch.push(block.samples[before:])

    def _identified(self, window: Window, names: tuple[str, ...]) -> Identification:
        assert self._stretch is not None  # a window without a gap lies in the running stretch
        hops = window.index - self._origin // self._stretch.hop_samples
        return self._stretch.identify(hops, window.samples, channel_names=names)

    def _gap(self, missing: MissingSamples) -> StreamGap:
        return StreamGap(
            turbine=self.turbine,
            unit=self.unit,
            session=self.session,
            start_ns=missing.start_ns,
            end_ns=missing.end_ns,
            first_sequence=missing.first_sequence,
            n_blocks=missing.n_blocks,
        )

    def _answer(self, window: Window) -> ModalEstimate | WindowRejected:
        refusal = self._refusal(window)
        if refusal is not None:
            return self._rejected(window, refusal)
        layout = self._layouts.get(window.layout_id)
        names = (
            layout.channel_names
            if layout is not None and len(layout.channels) == window.samples.shape[1]
            else tuple(f"channel {i + 1}" for i in range(window.samples.shape[1]))
        )
        result = self._identified(window, names)
        if result.rejection is not None:
            return self._rejected(window, result.rejection)
        modes = self._tracker.named(result.modes)
        events = tuple(Warning(f"mode-{e.kind}", e.text) for e in self._tracker.events)
        return ModalEstimate(
            turbine=self.turbine,
            window=window.index,
            start_ns=window.start_ns,
            end_ns=window.end_ns,
            layout_id=window.layout_id,
            channels=names,
            modes=modes,
            weight=self._settings.hop / self._settings.window_duration,
            warnings=result.warnings + _status_warnings(window.status) + events,
        )

    def _refusal(self, window: Window) -> Warning | None:
        """Why a window cannot be identified at all, before its samples are looked at."""
        if window.gaps:
            gap = max(window.gaps, key=lambda g: g.n_samples)
            others = f" ({len(window.gaps)} gaps in all)" if len(window.gaps) > 1 else ""
            return Warning(
                "gap",
                f"gap of {gap.n_samples / window.sampling_rate:.3g} s in unit {self.unit} at "
                f"{gap.first_sample / window.sampling_rate:.3f} s{others}",
            )
        if not window.complete:
            return Warning(
                "short",
                f"the session of unit {self.unit} ended {window.duration:.3g} s into a window of "
                f"{self._settings.window_duration:g} s",
            )
        if window.status & BlockStatus.SENSOR_FAULT:
            return Warning("sensor-fault", f"unit {self.unit} reports a faulty channel")
        return None

    def _rejected(self, window: Window, why: Warning) -> WindowRejected:
        self._tracker.missed()
        return WindowRejected(
            turbine=self.turbine,
            window=window.index,
            start_ns=window.start_ns,
            end_ns=window.end_ns,
            code=why.code,
            reason=why.text,
        )


def _status_warnings(status: BlockStatus) -> tuple[Warning, ...]:
    """What the unit itself said of the window's blocks."""
    warnings = []
    if status & BlockStatus.CLIPPED:
        warnings.append(Warning("clipped", "the unit reports samples at its converter's limit"))
    if status & BlockStatus.CLOCK_UNSYNCHRONISED:
        warnings.append(
            Warning("unsynchronised-clock", "the unit reports that it has lost its time reference")
        )
    return tuple(warnings)
