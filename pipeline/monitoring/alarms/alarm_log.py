"""The book of notices: what is open, how often it was seen, what was told, who has acknowledged it.

    cause ──► raised ──► (again: counted) ──► reminder … ──► over, and quiet for `settle` ──► ended
                              └── acknowledged: no more reminders

A cause that comes back within `settle` after it was over is the same notice, counted, not told
anew. One that has no end of its own is closed by who acknowledges it. Pure: time is an argument,
and the book is a value that goes to a file and comes back.
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
CLOSED_KEPT = 200  # notices that are over and still listed


@dataclass(frozen=True, slots=True)
class Alarm:
    """One thing that is or was wrong."""

    id: int  # counted from 1; what `pilewatch ack` takes
    key: str
    kind: str
    turbine: str
    text: str  # as it was last said
    first_ns: int  # when it was first seen [ns since 1970-01-01 UTC]
    last_ns: int  # when it was last seen
    count: int = 1  # how often it came, those told as one
    told_ns: int = 0  # when it was last told
    over_ns: int = 0  # since when it is over; 0: it lasts
    acknowledged_ns: int = 0  # 0: not yet
    acknowledged_by: str = ""
    lasting: bool = True  # see Cause
    closed: bool = False


@dataclass(frozen=True, slots=True)
class AlarmMessage:
    """What goes out."""

    occasion: Occasion
    notice: Alarm

    def as_json(self) -> dict[str, Any]:
        """As webhooks and brokers get it; names are stable. `text` can stand alone, as chats show
        it; `cause` is what was said of the cause itself."""
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
    """Every notice that is open, and the latest that were.

    notices   of an earlier run
    """

    def __init__(self, settings: AlarmLogSettings, notices: Sequence[Alarm] = ()) -> None:
        self._settings = settings
        self._open = {each.key: each for each in notices if not each.closed}
        self._closed = [each for each in notices if each.closed][-CLOSED_KEPT:]
        self._next_id = max((each.id for each in notices), default=0) + 1

    @property
    def notices(self) -> tuple[Alarm, ...]:
        """All of them by their number."""
        return tuple(sorted([*self._closed, *self._open.values()], key=lambda each: each.id))

    def note(self, cause: AlarmCondition, now_ns: int) -> Iterator[AlarmMessage]:
        """Take a cause; give what is to be told of it at once."""
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
        """A cause that is in the book; a new occurrence of one without an end is told."""
        anew = not known.lasting and _seconds(now_ns - known.last_ns) >= self._settings.settle
        self._open[cause.key] = notice = replace(
            known,
            text=cause.text,
            last_ns=now_ns,
            told_ns=now_ns if anew else known.told_ns,
            over_ns=0,
            count=known.count + (cause.counted or known.over_ns > 0),
        )
        if anew:
            yield AlarmMessage("raised", notice)

    def due(self, now_ns: int) -> Iterator[AlarmMessage]:
        """What time alone makes worth telling: ends and reminders."""
        for notice in list(self._open.values()):
            if notice.over_ns:
                if _seconds(now_ns - notice.over_ns) >= self._settings.settle:
                    self._close(notice)
                    yield AlarmMessage("ended", notice)
            elif self._reminder_is_due(notice, now_ns):
                told = self._open[notice.key] = replace(notice, told_ns=now_ns)
                yield AlarmMessage("reminder", told)

    def _reminder_is_due(self, notice: Alarm, now_ns: int) -> bool:
        if not self._settings.reminder or notice.acknowledged_ns:
            return False
        return _seconds(now_ns - notice.told_ns) >= self._settings.reminder

    def acknowledge(self, ids: Sequence[int], by: str, now_ns: int) -> tuple[int, ...]:
        """Somebody has taken note. Gives the numbers that are no open notice's."""
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
    """As the file of a book."""
    return json.dumps([asdict(each) for each in notices], ensure_ascii=False, indent=1).encode()


def decoded_notices(content: bytes) -> tuple[Alarm, ...]:
    """Of a book's file. Raises ValueError where it is none."""
    known = {field.name for field in fields(Alarm)}
    try:
        return tuple(
            Alarm(**{k: v for k, v in each.items() if k in known}) for each in json.loads(content)
        )
    except (AttributeError, TypeError) as error:
        raise ValueError(f"no book of notices: {error}") from error
