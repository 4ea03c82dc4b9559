"""Rules: which messages raise an alarm, and which end it."""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamGap,
    WindowRejected,
)
from pipeline.monitoring.alarms.settings import THRESHOLDS, AlarmLogSettings
from pipeline.state.posterior_json import ratios
from pipeline.state.run_state import RunState
from sensors.acquisition.blocks import NANOSECONDS
from sensors.bounded_dict import BoundedDict

SENSOR = (  # codes of windows that concern an instrument
    "constant",
    "clipped",
    "duplicate-channel",
    "swapped-channels",
    "sensor-fault",
    "silent-channel",
    "missing-unit",
    "nan",
    "spikes",
    "unsynchronised-clock",
    "unsynchronised-units",
)
CLOCK = ("clock-unset", "clock-step", "clock-rate", "clock-drift")  # of windows, their stamps
KIND_OF_CODE = dict.fromkeys(SENSOR, "sensor") | dict.fromkeys(CLOCK, "clock")
OF_WINDOWS = ("sensor", "clock")  # kinds that a window without them ends
OF_BOOKS = ("books", "no-posterior")  # kinds of `BooksAlarm`
REFUSAL_CODES = ("few-pairs", "pairing-cost", "no-paired-mode")  # of posteriors that were not made
SILENT_AFTER = 30.0  # without a block of a unit whose stream has not ended [s]
LOST_AFTER = 60.0  # without a status of a node; one that works on a window has no time for any [s]
LINK = ("link-down", "quiet")  # codes of a feed that explain the silence of its unit
LOOKED_EVERY = 1.0  # time between two checks of silence [s]
WHOLE_SESSION = "session"  # in place of a turbine, for alarms about the session itself


@dataclass(frozen=True, slots=True)
class AlarmCondition:
    """A condition that is wrong, or no longer is."""

    key: str
    """The same condition has the same key."""
    kind: str
    """One of `settings.KINDS`."""
    turbine: str
    """That it concerns; "session" for the session itself."""
    text: str
    """One sentence for people; "" if it is over."""
    over: bool = False
    """Whether it has ended."""
    lasting: bool = True
    """False: it has no end of its own; its acknowledgement ends it."""
    counted: bool = True
    """False: a state that is repeated while it lasts, not an occurrence."""


class AlarmRules:
    """Finds the conditions in the messages of a session as they come.

    Parameters
    ----------
    settings : AlarmLogSettings
        Kinds and thresholds.
    lasting : iterable of AlarmCondition
        That an earlier session found and that have not ended, as `AlarmLog.lasting` has them.

    Notes
    -----
    `now_ns` is always of one clock [ns]: when a message came.
    """

    def __init__(self, settings: AlarmLogSettings, lasting: Iterable[AlarmCondition] = ()) -> None:
        self._settings = settings
        self._run = RunState(kept=1)
        self._looked_ns = 0
        # by turbine: key → kind of what lasts; names that are made up drive out each other
        self._window_keys = BoundedDict[str, dict[str, str]]()
        self._books_alarms = BoundedDict[str, AlarmCondition]()  # that last, by key
        for each in lasting:
            if each.key.startswith(tuple(f"{each.turbine}/{kind}/" for kind in OF_WINDOWS)):
                self._window_keys.setdefault(each.turbine, {})[each.key] = each.kind
            elif each.kind in OF_BOOKS:
                self._books_alarms.put(each.key, each)

    def watches(self, condition: AlarmCondition) -> bool:
        """Return whether the settings ask for a condition, so that its end would be found."""
        if condition.kind == "threshold":
            least = f"{condition.key.rpartition('/')[2]}_below"
            if least not in THRESHOLDS or getattr(self._settings, least) <= 0:
                return False
        return condition.kind in self._settings.kinds

    def conditions(self, message: Message, now_ns: int) -> Iterator[AlarmCondition]:
        """Yield the conditions that one message starts or ends."""
        self._run.fold(message, now_ns)
        found: Iterable[AlarmCondition] = ()
        match message:
            case FoundationEvent():
                found = _change(message)
            case StreamGap():
                found = self._gap(message)
            case ModalEstimate():
                found = self._instruments(message)
            case WindowRejected():
                found = self._rejected(message)
            case FoundationPosterior():
                found = (*_posterior(message), *self._thresholds(message))
            case NodeStatus():
                found = _recorder(message)
        answered = isinstance(message, ModalEstimate | WindowRejected | FoundationPosterior)
        of_books = self._of_books(message) if answered else ()
        for condition in (*found, *of_books, *self._silences(now_ns)):
            if condition.kind in self._settings.kinds:
                yield condition

    def _of_books(self, answer: Message) -> Iterator[AlarmCondition]:
        """Books that do not balance and posteriors that do not come, until they do."""
        alarms = self._run.books.alarms(self._settings.windows_without_posterior)
        found = {f"{each.turbine}/{each.kind}": each for each in alarms}
        for key, alarm in found.items():
            condition = AlarmCondition(key, alarm.kind, alarm.turbine, alarm.text, counted=False)
            self._books_alarms.put(key, condition)
            yield condition
        past = [each for key, each in self._books_alarms.items() if key not in found]
        for condition in past:
            if self._is_over(condition, answer):
                del self._books_alarms[condition.key]
                yield replace(condition, text="", over=True)

    def _is_over(self, condition: AlarmCondition, answer: Message) -> bool:
        """Whether an answer ends a condition of the books.

        They begin empty at every start: that they have no alarm is then no end by itself.
        """
        if answer.turbine != condition.turbine:
            return False
        if condition.kind == "no-posterior":
            return isinstance(answer, FoundationPosterior)
        return not self._run.books.violations(condition.turbine)

    def _gap(self, gap: StreamGap) -> Iterator[AlarmCondition]:
        if gap.duration < self._settings.shortest_gap:
            return
        begin = moment_text(gap.start_ns)
        length = _duration_text(gap.duration)
        text = f"{length} of measurements of unit {gap.unit} are missing, from {begin} on"
        key = f"{gap.turbine}/gap/{gap.unit}"
        yield AlarmCondition(key, "gap", gap.turbine, text)
        yield AlarmCondition(key, "gap", gap.turbine, "", over=True)  # samples have resumed

    def _instruments(self, estimate: ModalEstimate) -> Iterator[AlarmCondition]:
        """Warnings about instruments in a window; those that it does not repeat are over."""
        turbine = estimate.turbine
        found = {
            self._instrument_key(turbine, each.code, each.text): each
            for each in estimate.warnings
            if each.code in KIND_OF_CODE
        }
        begin = _window_from(estimate.start_ns)
        for key, each in found.items():
            yield AlarmCondition(key, KIND_OF_CODE[each.code], turbine, f"{each.text} ({begin})")
        lasting = self._window_keys.get(turbine, {})
        for key in sorted(lasting.keys() - found.keys()):
            yield AlarmCondition(key, lasting[key], turbine, "", over=True)
        kinds = {key: KIND_OF_CODE[each.code] for key, each in found.items()}
        self._window_keys.put(turbine, kinds)

    def _rejected(self, window: WindowRejected) -> Iterator[AlarmCondition]:
        """A window that is rejected for another reason ends no instrument's condition."""
        turbine, begin = window.turbine, _window_from(window.start_ns)
        if window.code in KIND_OF_CODE:
            kind = KIND_OF_CODE[window.code]
            key = self._instrument_key(turbine, window.code, window.reason)
            yield AlarmCondition(key, kind, turbine, f"{window.reason} ({begin}, not used)")
            self._window_keys.setdefault(turbine, {})[key] = kind
        elif window.code in REFUSAL_CODES:
            text = f"no posterior of the {begin}: {window.reason}"
            yield AlarmCondition(f"{turbine}/refused", "refused", turbine, text)

    def _thresholds(self, posterior: FoundationPosterior) -> Iterator[AlarmCondition]:
        """Springs below their thresholds; a posterior that is not trusted changes nothing."""
        if not posterior.trusted:
            return
        for name in THRESHOLDS:
            spring, least = name.removesuffix("_below"), getattr(self._settings, name)
            if least > 0:
                ratio, low, high = ratios(posterior.parameter(spring))
                text = (
                    f"{spring} is {ratio:.3f} of nominal (90 % interval {low:.3f} to {high:.3f}), "
                    f"below {least:g}"
                )
                key = f"{posterior.turbine}/threshold/{spring}"
                yield _state(key, "threshold", posterior.turbine, text, ratio < least)

    def _instrument_key(self, turbine: str, code: str, text: str) -> str:
        """One fault of certain channels; the same fault of another channel has another key."""
        layouts = self._run.turbine(turbine).layouts.values()
        channels = {channel.name for layout in layouts for channel in layout.channels}
        named = sorted({name for name in _NAME.findall(text) if name in channels})
        return "/".join([turbine, KIND_OF_CODE[code], code, *named])

    def _silences(self, now_ns: int) -> Iterator[AlarmCondition]:
        """Units and nodes from which nothing has come for too long, and those that are back."""
        if now_ns - self._looked_ns < LOOKED_EVERY * NANOSECONDS:
            return
        self._looked_ns = now_ns
        for stream in self._run.health.streams(now_ns):
            _, turbine, *unit = stream.key.split("/")
            if stream.key.endswith("/acceleration"):
                silent = stream.condition == "late" and stream.silence > SILENT_AFTER
                link = _link(self._run.turbine(turbine).statuses.get(f"feed-{unit[0]}"))
                why = f"; its feed says: {link}" if link else ""
                text = f"unit {unit[0]} has been silent for {_duration_text(stream.silence)}{why}"
                yield _state(f"{turbine}/silence/{unit[0]}", "silence", turbine, text, silent)
        for node in self._run.health.nodes(now_ns):
            status = node.status
            lost = node.condition == "late" and node.silence > LOST_AFTER
            text = f"node {status.node} has sent no status for {_duration_text(node.silence)}"
            yield _state(f"{status.turbine}/node/{status.node}", "node", status.turbine, text, lost)


def _link(feed: NodeStatus | None) -> str:
    """Return why a feed is silent, in its own words; "" where it gives no reason."""
    warnings = () if feed is None else feed.warnings
    return "; ".join(each.text for each in warnings if each.code in LINK)


def _recorder(status: NodeStatus) -> Iterator[AlarmCondition]:
    """A recording that has stopped, and clocks of units that differ from the recorder's."""
    if status.node != "recorder":
        return
    for kind, code in (("recorder", "recording-stopped"), ("clock", "clock-off")):
        text = "; ".join(each.text for each in status.warnings if each.code == code)
        yield _state(f"{status.turbine}/{kind}", kind, status.turbine, text, bool(text))


_NAME = re.compile(r"[^\s,;:()]+")  # what may be the name of a channel


def _window_from(start_ns: int) -> str:
    return f"window from {moment_text(start_ns)}"


def moment_text(time_ns: int) -> str:
    """Return "2026-03-01 12:00:00 UTC"."""
    return f"{datetime.fromtimestamp(time_ns // NANOSECONDS, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _duration_text(seconds: float) -> str:
    """Return a duration in words."""
    for unit, length in (("days", 86_400), ("hours", 3600), ("minutes", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.0f} {unit}"
    return f"{seconds:.0f} s"


def _state(key: str, kind: str, turbine: str, text: str, wrong: bool) -> AlarmCondition:
    return AlarmCondition(key, kind, turbine, text if wrong else "", over=not wrong, counted=False)


def _change(event: FoundationEvent) -> Iterator[AlarmCondition]:
    key = f"{event.turbine}/change/{event.kind}"
    yield AlarmCondition(key, "change", event.turbine, event.text, lasting=False)


def _posterior(posterior: FoundationPosterior) -> Iterator[AlarmCondition]:
    turbine = posterior.turbine
    why = "; ".join(each.text for each in posterior.warnings)
    text = f"the posterior is not to be trusted: {why or 'the data contradict the model'}"
    yield _state(f"{turbine}/untrusted", "untrusted", turbine, text, not posterior.trusted)
    yield AlarmCondition(f"{turbine}/refused", "refused", turbine, "", over=True)
