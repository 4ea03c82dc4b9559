"""The alarm log: which alarms are open, how often they occurred, who acknowledged them.

    condition ──► raised ──► (again: counted) ──► reminder … ──► over for `settle` ──► ended
                                  └── acknowledged: no more reminders

A condition that returns within `settle` after its end is the same alarm, counted, with no further
message. One without an end of its own is closed by its acknowledgement. Pure: time is an argument,
and the log is a value that goes to a file and comes back.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, Literal

from pipeline.monitoring.alarms.alarm_rules import AlarmCondition
from pipeline.monitoring.alarms.settings import AlarmLogSettings
from sensors.acquisition.blocks import NANOSECONDS

Occasion = Literal["raised", "reminder", "ended"]
BEGINNINGS: dict[Occasion, str] = {"raised": "", "reminder": "still: ", "ended": "over: "}
CLOSED_KEPT = 200  # alarms that are over and still listed


@dataclass(frozen=True, slots=True)
class Alarm:
    """A condition that is or was wrong. Its field names are those of the file and of `ack`."""

    id: int
    """Counted from 1; what `pilewatch ack` takes."""
    key: str
    """The same condition has the same key."""
    kind: str
    """One of `settings.KINDS`."""
    turbine: str
    """That it concerns; "session" for the session itself."""
    text: str
    """The newest sentence."""
    first_ns: int
    """When it was first seen [ns since 1970-01-01 UTC]."""
    last_ns: int
    """When it was last seen [ns since 1970-01-01 UTC]."""
    count: int = 1
    """Occurrences that are this one alarm [-]."""
    told_ns: int = 0
    """When a message of it was last sent [ns since 1970-01-01 UTC]."""
    over_ns: int = 0
    """When it ended [ns since 1970-01-01 UTC]; 0: it lasts."""
    acknowledged_ns: int = 0
    """When it was acknowledged [ns since 1970-01-01 UTC]; 0: not yet."""
    acknowledged_by: str = ""
    """Name of the person."""
    lasting: bool = True
    """See `AlarmCondition`."""
    closed: bool = False
    """Whether it is over for good."""


@dataclass(frozen=True, slots=True)
class AlarmMessage:
    """What the channels deliver."""

    occasion: Occasion
    """Why the message is sent."""
    notice: Alarm
    """The alarm at that moment."""

    def as_json(self) -> dict[str, Any]:
        """As webhooks and brokers get it; names are stable. `text` can stand alone, as chats show
        it; `cause` is the condition's own sentence."""
        notice = self.notice
        return {
            "occasion": self.occasion,
            "id": notice.id,
            "kind": notice.kind,
            "turbine": notice.turbine,
            "text": f"{notice.turbine}: {BEGINNINGS[self.occasion]}{notice.text}",
            "cause": notice.text,
            "count": notice.count,
            "first_ns": notice.first_ns,
            "last_ns": notice.last_ns,
            "acknowledged": notice.acknowledged_ns > 0,
        }


class AlarmLog:
    """Every open alarm, and the latest that are over.

    Parameters
    ----------
    settings : AlarmLogSettings
        Reminders and settling time.
    notices : sequence of Alarm
        Of an earlier run.
    """

    def __init__(self, settings: AlarmLogSettings, notices: Sequence[Alarm] = ()) -> None:
        self._settings = settings
        self._open = {each.key: each for each in notices if not each.closed}
        self._closed = [each for each in notices if each.closed][-CLOSED_KEPT:]
        self._next_id = max((each.id for each in notices), default=0) + 1

    @property
    def notices(self) -> tuple[Alarm, ...]:
        """All of them by number."""
        return tuple(sorted([*self._closed, *self._open.values()], key=lambda each: each.id))

    @property
    def lasting(self) -> tuple[AlarmCondition, ...]:
        """The conditions of open alarms that have an end, as rules go on with them at a start."""
        return tuple(
            AlarmCondition(each.key, each.kind, each.turbine, each.text)
            for each in self._open.values()
            if each.lasting
        )

    def note(self, cause: AlarmCondition, now_ns: int) -> Iterator[AlarmMessage]:
        """Take a condition; yield the messages that it needs at once."""
        known = self._open.get(cause.key)
        if cause.over:
            if known is not None and known.lasting and not known.over_ns:
                self._open[cause.key] = replace(known, over_ns=now_ns)
            return
        if known is not None:
            yield from self._again(known, cause, now_ns)
            return
        notice = Alarm(
            id=self._next_id,
            key=cause.key,
            kind=cause.kind,
            turbine=cause.turbine,
            text=cause.text,
            first_ns=now_ns,
            last_ns=now_ns,
            told_ns=now_ns,
            lasting=cause.lasting,
        )
        self._next_id += 1
        self._open[cause.key] = notice
        yield AlarmMessage("raised", notice)

    def _again(self, known: Alarm, cause: AlarmCondition, now_ns: int) -> Iterator[AlarmMessage]:
        """A known condition; a new occurrence of one without an end is a message."""
        recurs = not known.lasting and _seconds(now_ns - known.last_ns) >= self._settings.settle
        self._open[cause.key] = notice = replace(
            known,
            text=cause.text,
            last_ns=now_ns,
            told_ns=now_ns if recurs else known.told_ns,
            over_ns=0,
            count=known.count + (cause.counted or known.over_ns > 0),
        )
        if recurs:
            yield AlarmMessage("raised", notice)

    def due(self, now_ns: int) -> Iterator[AlarmMessage]:
        """Yield the messages that time alone makes due: ends and reminders."""
        for notice in list(self._open.values()):
            if notice.over_ns:
                if _seconds(now_ns - notice.over_ns) >= self._settings.settle:
                    self._close(notice)
                    yield AlarmMessage("ended", notice)
            elif self._reminder_is_due(notice, now_ns):
                reminded = self._open[notice.key] = replace(notice, told_ns=now_ns)
                yield AlarmMessage("reminder", reminded)

    def _reminder_is_due(self, notice: Alarm, now_ns: int) -> bool:
        if not self._settings.reminder or notice.acknowledged_ns:
            return False
        if notice.kind not in self._settings.kinds:  # of an earlier session
            return False
        return _seconds(now_ns - notice.told_ns) >= self._settings.reminder

    def acknowledge(self, ids: Sequence[int], by: str, now_ns: int) -> tuple[int, ...]:
        """Acknowledge alarms. Returns the numbers of which no alarm is open."""
        open_ids = {each.id: each for each in self._open.values()}
        for number in ids:
            if number in open_ids:
                seen = replace(open_ids[number], acknowledged_ns=now_ns, acknowledged_by=by)
                self._open[seen.key] = seen
                if not seen.lasting:
                    self._close(seen)
        return tuple(number for number in ids if number not in open_ids)

    def _close(self, notice: Alarm) -> None:
        del self._open[notice.key]
        self._closed = [*self._closed, replace(notice, closed=True)][-CLOSED_KEPT:]


def _seconds(nanoseconds: int) -> float:
    return nanoseconds / NANOSECONDS


def encoded_notices(notices: Sequence[Alarm]) -> bytes:
    """Return alarms as the file of an alarm log."""
    return json.dumps([asdict(each) for each in notices], ensure_ascii=False, indent=1).encode()


def decoded_notices(content: bytes) -> tuple[Alarm, ...]:
    """Return the alarms of a log's file. Raises ValueError if it is none."""
    known = {field.name for field in fields(Alarm)}
    try:
        return tuple(
            Alarm(**{k: v for k, v in each.items() if k in known}) for each in json.loads(content)
        )
    except (AttributeError, TypeError) as error:
        raise ValueError(f"no alarm log: {error}") from error
