"""What in the messages is worth a notice, and what says that it is over."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from pipeline.health import Health
from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamGap,
    WindowRejected,
)
from pipeline.notices.settings import BookSettings
from sensors.blocks import NANOSECONDS

SENSOR = {  # codes of windows that speak of an instrument
    "constant": "a channel does not move",
    "clipped": "a channel is at its limit",
    "duplicate-channel": "two channels carry one signal",
    "swapped-channels": "two channels have changed place",
    "sensor-fault": "a unit reports a faulty channel",
    "missing-unit": "a unit is missing",
    "nan": "samples that are no numbers",
    "spikes": "spikes",
    "unsynchronised-clock": "a unit has lost its time reference",
    "unsynchronised-units": "units are not on one clock",
}
REFUSED = ("few-pairs", "pairing-cost", "no-paired-mode")  # codes of posteriors that were not made
SILENT_AFTER = 30.0  # without a block of a unit that has not said that it ends [s]
LOOKED_EVERY = 1.0  # at what is silent [s]


@dataclass(frozen=True, slots=True)
class Cause:
    """Something that is wrong, or no longer is."""

    key: str  # the same cause has the same key
    kind: str  # one of `settings.KINDS`
    turbine: str
    text: str  # one sentence for people; "" where it is over
    over: bool = False
    lasting: bool = True  # False: it has no end of its own; only who acknowledges it ends it
    counted: bool = True  # False: a state that is said again and again while it lasts


class CauseFinder:
    """Reads the messages of a session as they come.

    `now_ns` is always of the same clock [ns]: when a message came.
    """

    def __init__(self, settings: BookSettings) -> None:
        self._settings = settings
        self._health = Health()
        self._looked_ns = 0
        self._sensor_doubts: dict[str, set[str]] = {}  # by turbine: codes that are open

    def causes(self, message: Message, now_ns: int) -> Iterator[Cause]:
        """What one message says."""
        self._health.observe(message, now_ns)
        found: Iterable[Cause] = ()
        match message:
            case FoundationEvent():
                found = _change(message)
            case StreamGap():
                found = self._gap(message)
            case ModalEstimate():
                doubts = {each.code: each.text for each in message.warnings if each.code in SENSOR}
                found = self._sensor(message.turbine, doubts)
            case WindowRejected():
                found = self._rejected(message)
            case FoundationPosterior():
                found = _posterior(message)
            case NodeStatus():
                found = _status(message)
        for cause in (*found, *self._silences(now_ns)):
            if cause.kind in self._settings.kinds:
                yield cause

    def _gap(self, gap: StreamGap) -> Iterator[Cause]:
        seconds = (gap.end_ns - gap.start_ns) / NANOSECONDS
        if seconds < self._settings.shortest_gap:
            return
        text = f"{seconds:.0f} s of measurements of unit {gap.unit} are missing"
        key = f"{gap.turbine}/gap/{gap.unit}"
        yield Cause(key, "gap", gap.turbine, text)
        yield Cause(key, "gap", gap.turbine, "", over=True)  # samples have resumed

    def _sensor(self, turbine: str, doubts: dict[str, str]) -> Iterator[Cause]:
        """Doubts about instruments in a window; those that it does not share are over."""
        known = self._sensor_doubts.setdefault(turbine, set())
        for code, text in doubts.items():
            yield Cause(f"{turbine}/sensor/{code}", "sensor", turbine, f"{SENSOR[code]}: {text}")
        for code in sorted(known - doubts.keys()):
            yield Cause(f"{turbine}/sensor/{code}", "sensor", turbine, "", over=True)
        self._sensor_doubts[turbine] = set(doubts)

    def _rejected(self, window: WindowRejected) -> Iterator[Cause]:
        """A window that says nothing of instruments does not say that they are well."""
        if window.code in SENSOR:
            doubts = dict.fromkeys(self._sensor_doubts.get(window.turbine, ()), "")
            text = f"{SENSOR[window.code]}: {window.reason}"
            key = f"{window.turbine}/sensor/{window.code}"
            yield Cause(key, "sensor", window.turbine, text)
            self._sensor_doubts[window.turbine] = {*doubts, window.code}
        elif window.code in REFUSED:
            text = f"no posterior of window {window.window}: {window.reason}"
            yield Cause(f"{window.turbine}/refused", "refused", window.turbine, text)

    def _silences(self, now_ns: int) -> Iterator[Cause]:
        """Units and nodes from which nothing has come for too long, and those that are back."""
        if now_ns - self._looked_ns < LOOKED_EVERY * NANOSECONDS:
            return
        self._looked_ns = now_ns
        for stream in self._health.streams(now_ns):
            _, turbine, *unit = stream.key.split("/")
            if stream.key.endswith("/acceleration"):
                silent = stream.condition == "late" and stream.silence > SILENT_AFTER
                text = f"unit {unit[0]} has been silent for {stream.silence:.0f} s"
                yield _state(f"{turbine}/silence/{unit[0]}", "silence", turbine, text, silent)
        for node in self._health.nodes(now_ns):
            status, lost = node.status, node.condition == "late"
            text = f"node {status.node} has not been heard of for {node.silence:.0f} s"
            yield _state(f"{status.turbine}/node/{status.node}", "node", status.turbine, text, lost)


def _state(key: str, kind: str, turbine: str, text: str, wrong: bool) -> Cause:
    return Cause(key, kind, turbine, text if wrong else "", over=not wrong, counted=False)


def _change(event: FoundationEvent) -> Iterator[Cause]:
    key = f"{event.turbine}/change/{event.kind}"
    yield Cause(key, "change", event.turbine, event.text, lasting=False)


def _posterior(posterior: FoundationPosterior) -> Iterator[Cause]:
    turbine = posterior.turbine
    why = "; ".join(doubt.text for doubt in posterior.warnings)
    text = f"the posterior is not to be trusted: {why or 'the data contradict the model'}"
    yield _state(f"{turbine}/untrusted", "untrusted", turbine, text, not posterior.trusted)
    yield Cause(f"{turbine}/refused", "refused", turbine, "", over=True)


def _status(status: NodeStatus) -> Iterator[Cause]:
    stopped = [doubt for doubt in status.warnings if doubt.code == "recording-stopped"]
    text = stopped[0].text if stopped else ""
    key = f"{status.turbine}/recorder"
    if status.node == "recorder":
        yield _state(key, "recorder", status.turbine, text, bool(stopped))
