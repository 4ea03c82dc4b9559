"""One cause is one notice: told when it comes, as long as nobody has seen it, and when it ends."""

from hypothesis import given
from hypothesis import strategies as st

from pipeline.monitoring.alarms.alarm_log import (
    AlarmLog,
    AlarmMessage,
    decoded_notices,
    encoded_notices,
)
from pipeline.monitoring.alarms.alarm_rules import AlarmCondition
from pipeline.monitoring.alarms.settings import AlarmLogSettings
from sensors.acquisition.blocks import NANOSECONDS

SETTINGS = AlarmLogSettings(reminder=3600.0, settle=600.0)
SILENT = AlarmCondition("t1/silence/tower", "silence", "t1", "unit tower is silent", counted=False)
BACK = AlarmCondition("t1/silence/tower", "silence", "t1", "", over=True)
CHANGE = AlarmCondition("t1/change/foundation", "change", "t1", "k22 fell", lasting=False)


def at(
    book: AlarmLog, seconds: float, cause: AlarmCondition | None = None
) -> list[tuple[str, int]]:
    """What is told at a time, as (occasion, number)."""
    now_ns = round(seconds * NANOSECONDS) + 1
    told: list[AlarmMessage] = [] if cause is None else list(book.note(cause, now_ns))
    told += book.due(now_ns)
    return [(each.occasion, each.notice.id) for each in told]


def test_a_cause_is_told_once_however_often_it_is_seen() -> None:
    book = AlarmLog(SETTINGS)

    assert at(book, 0, SILENT) == [("raised", 1)]
    assert [at(book, seconds, SILENT) for seconds in range(1, 100)] == [[]] * 99


def test_it_is_told_again_after_the_reminder_and_when_it_is_over() -> None:
    book = AlarmLog(SETTINGS)
    at(book, 0, SILENT)

    assert at(book, 3599) == []
    assert at(book, 3600) == [("reminder", 1)]
    assert at(book, 4000, BACK) == []
    assert at(book, 4600) == [("ended", 1)]
    assert at(book, 9999) == []


def test_what_comes_back_soon_is_the_same_notice_with_a_count() -> None:
    book = AlarmLog(SETTINGS)
    for seconds in range(0, 3000, 100):
        at(book, seconds, BACK if seconds % 200 else SILENT)

    (notice,) = book.notices
    assert notice.count == 15
    assert at(book, 3600) == [("ended", 1)]
    assert at(book, 9000, SILENT) == [("raised", 2)]


def test_what_has_no_end_is_told_again_when_it_recurs_after_the_time_that_it_settles_in() -> None:
    book = AlarmLog(SETTINGS)
    at(book, 0, CHANGE)
    assert at(book, 599, CHANGE) == []
    assert at(book, 1199, CHANGE) == [("raised", 1)]  # 600 s after the last occurrence


def test_an_acknowledged_notice_is_told_only_when_it_ends() -> None:
    book = AlarmLog(SETTINGS)
    at(book, 0, SILENT)
    assert book.acknowledge([1, 5], "ada", 10) == (5,)

    assert at(book, 90_000) == []
    at(book, 90_001, BACK)
    assert at(book, 90_700) == [("ended", 1)]
    assert book.notices[0].acknowledged_by == "ada"


def test_a_change_lasts_until_somebody_acknowledges_it() -> None:
    book = AlarmLog(SETTINGS)
    at(book, 0, CHANGE)

    assert at(book, 7200) == [("reminder", 1)]
    book.acknowledge([1], "ada", 7300 * NANOSECONDS)
    assert book.notices[0].closed
    assert at(book, 99_999) == []


def test_a_further_change_is_told_at_once() -> None:
    book = AlarmLog(SETTINGS)
    at(book, 0, CHANGE)

    assert at(book, 100, CHANGE) == []  # of the same hour: counted
    assert at(book, 800, CHANGE) == [("raised", 1)]
    assert book.notices[0].count == 3


def test_a_book_that_is_read_again_tells_nothing_twice() -> None:
    book = AlarmLog(SETTINGS)
    at(book, 0, SILENT)
    at(book, 1, CHANGE)

    again = AlarmLog(SETTINGS, decoded_notices(encoded_notices(book.notices)))

    assert again.notices == book.notices
    assert at(again, 2, SILENT) == []
    assert at(again, 3, AlarmCondition("t1/gap/tower", "gap", "t1", "60 s")) == [("raised", 3)]


@given(st.lists(st.tuples(st.integers(1, 2000), st.booleans()), max_size=40))
def test_every_notice_is_raised_once_and_ended_at_most_once(
    course: list[tuple[int, bool]],
) -> None:
    book, seconds = AlarmLog(SETTINGS), 0
    told: list[tuple[str, int]] = []
    for step, silent in course:
        seconds += step
        told += at(book, seconds, SILENT if silent else BACK)

    for notice in book.notices:
        occasions = [occasion for occasion, number in told if number == notice.id]
        assert occasions.count("raised") == 1
        assert occasions.count("ended") == notice.closed
        assert occasions[0] == "raised"
