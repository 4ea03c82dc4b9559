"""Every block, window and estimate has one fate; what has none, or two, is named."""

from dataclasses import replace
from itertools import islice

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.messages import (
    MessageCount,
    ModalEstimate,
    NodeStatus,
    StreamEnd,
    StreamGap,
    UnitOrigin,
)
from pipeline.state import turbine_book
from pipeline.state.books import Books
from sensors.acquisition.blocks import NANOSECONDS
from sensors.intervals import Intervals
from tests.pipeline.example_estimates import estimate
from tests.pipeline.example_messages import block, rejection, status
from tests.pipeline.state.test_posterior_json import POSTERIOR


def origin(window: int, boot: int = 0) -> tuple[UnitOrigin, ...]:
    return (UnitOrigin("tower", "session-1", boot, 24_000 * window),)


def identified(window: int, boot: int = 0) -> ModalEstimate:
    return replace(estimate(turbine="t1"), window=window, origins=origin(window, boot))


def rejected(window: int, code: str = "gap"):
    return replace(rejection(window), code=code, origins=origin(window))


def gap(first: int, n_blocks: int) -> StreamGap:
    return StreamGap("t1", "tower", "session-1", 0, 1, first, n_blocks)


def books_of(*messages: object, updates: bool | None = True) -> Books:
    books = Books(updates=updates)
    for message in messages:
        books.handle(message)
    return books


@given(st.lists(st.integers(0, 40), max_size=60))
def test_intervals_are_the_set_of_their_numbers(numbers: list[int]) -> None:
    intervals = Intervals()
    for number in numbers:
        intervals.add(number)
    assert len(intervals) == len(set(numbers))
    if numbers:
        inside = {n for first, end in intervals.holes for n in range(first, end)}
        assert inside == set(range(min(numbers), max(numbers))) - set(numbers)


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(0, 8)), max_size=8),
    st.sets(st.integers(0, 30)),
)
def test_a_difference_of_intervals_is_that_of_the_sets(spans, others) -> None:
    one, other = Intervals(), Intervals()
    for first, n in spans:
        one.add(first, first + n)
    for number in others:
        other.add(number)
    left = {n for first, end in one - other for n in range(first, end)}
    assert left == {n for first, size in spans for n in range(first, first + size)} - others


def test_a_run_in_which_nothing_was_lost_balances() -> None:
    blocks = [block(k) for k in range(30)]
    end = StreamEnd("t1", "tower", "session-1", blocks[-1].end_ns, 30)
    books = books_of(*blocks, block(7), end)
    (unit,) = books.as_json()["units"]
    assert (unit["published"], unit["recorded"], unit["lost"], unit["repeated"]) == (30, 30, 0, 1)
    assert not books.violations()


def test_blocks_that_nobody_reports_missing_are_named() -> None:
    books = books_of(*(block(k) for k in (*range(10), *range(15, 20))))
    assert books.violations() == [
        "unit tower of t1, session session-1, boot 0: blocks 10 to 14 are neither recorded nor "
        "reported missing"
    ]
    books.handle(gap(10, 5))
    assert not books.violations()
    assert books.as_json()["units"][0]["lost"] == 5


def test_blocks_that_are_reported_missing_and_are_there_are_named() -> None:
    """After a kill a gap of 522 blocks was reported that were all recorded."""
    (violation,) = books_of(*map(block, range(30)), gap(5, 10)).violations()
    assert violation.endswith("blocks 5 to 14 are reported missing and recorded")


def test_blocks_that_are_recorded_and_refused_may_be_reported_missing() -> None:
    """A unit sends old samples under new numbers: recorded, refused, missing in the windows."""
    refusing = replace(status("identification"), refused=(MessageCount("repeated-samples", 4),))
    books = books_of(*map(block, range(30)), gap(6, 1), gap(13, 3), refusing)
    assert not books.violations()
    books.handle(gap(20, 1))
    (violation,) = books.violations()
    assert violation.endswith("block 20 is reported missing and recorded")


def test_late_blocks_that_came_here_before_the_report_of_them_balance() -> None:
    """Two nodes send the block and the report; nothing orders them."""
    books = books_of(*map(block, range(30)), gap(6, 3))
    assert books.violations()
    books.handle(replace(status("identification"), late=3))
    assert not books.violations()
    books.handle(gap(20, 1))
    assert books.violations()


def test_blocks_that_are_published_twice_are_not_lost() -> None:
    twice = [block(k) for k in range(30) for _ in range(1 + (k % 10 == 3))]
    books = books_of(*twice, StreamEnd("t1", "tower", "session-1", block(29).end_ns, 33))
    (unit,) = books.as_json()["units"]
    assert (unit["recorded"], unit["repeated"], unit["lost"]) == (30, 3, 0)
    assert not books.violations()


def test_numbers_that_a_unit_passes_over_without_missing_a_sample_are_not_lost() -> None:
    jumped = [replace(block(k), sequence=k + 5000) for k in range(10, 20)]
    books = books_of(*map(block, range(10)), *jumped)
    books.handle(StreamEnd("t1", "tower", "session-1", block(19).end_ns, 20))
    assert not books.violations()
    assert books.as_json()["units"][0]["lost"] == 0


def test_a_block_that_comes_after_it_was_reported_missing_is_late() -> None:
    books = books_of(*(block(k) for k in (*range(10), *range(12, 20))), gap(10, 2), block(11))
    (unit,) = books.as_json()["units"]
    assert (unit["recorded"], unit["late"], unit["lost"]) == (19, 1, 1)
    assert not books.violations()


def test_a_block_that_may_still_come_is_not_called_missing() -> None:
    books = books_of(*(block(k) for k in (*range(10), 11, 12)))
    assert not books.violations()
    for k in range(13, 17):
        books.handle(block(k))
    (violation,) = books.violations()
    assert violation.endswith("block 10 is neither recorded nor reported missing")


def test_boots_under_one_name_have_books_of_their_own() -> None:
    later = [replace(block(k), start_ns=block(k).start_ns + 300 * NANOSECONDS) for k in range(20)]
    books = books_of(*map(block, range(50)), *later)
    assert [(u["boot"], u["recorded"]) for u in books.as_json()["units"]] == [(0, 50), (1, 20)]
    assert not books.violations()


@pytest.mark.parametrize("session", ["session-1", "session-2"])
def test_time_without_samples_between_boots_is_in_the_books(session: str) -> None:
    """200 s between two boots of a unit were nowhere: no gap, no loss."""

    def again(silent: int, unit: str = "tower"):
        later = [(block(k), block(30 + silent + k).start_ns) for k in range(20)]
        return [replace(b, session=session, start_ns=ns, unit=unit) for b, ns in later]

    first = [block(k) for k in range(30)]
    books = books_of(*first, *again(200), *again(300, "nacelle"))
    pauses = {
        (u["unit"], u["session"], u["boot"]): u["pause_before_s"]
        for u in (books.as_json()["units"])
    }
    second = ("tower", session, int(session == "session-1"))
    assert pauses.pop(second) == pytest.approx(200.0)
    assert set(pauses.values()) == {0.0}
    assert "of 3 boots recorded (200 s without samples between boots)" in books.line
    joined = books_of(*first, *again(0))
    assert "without samples" not in joined.line


def test_a_silence_of_two_units_at_once_counts_once() -> None:
    first = [block(k, unit=unit) for unit in ("tower", "nacelle") for k in range(30)]
    later = [
        replace(block(k, unit=unit), session="s2", start_ns=block(k + begin).start_ns)
        for unit, begin in (("tower", 230), ("nacelle", 130))
        for k in range(20)
    ]
    books = books_of(*first, *later)
    pauses = [u["pause_before_s"] for u in books.as_json()["units"]]
    assert sorted(pauses) == pytest.approx([0.0, 0.0, 100.0, 200.0])
    assert books.silence("t1") == pytest.approx(200.0)
    assert books.silence("t2") == 0.0
    assert "of 4 boots recorded (200 s without samples between boots)" in books.line


def test_an_estimate_is_forgotten_when_two_later_ones_are_answered() -> None:
    """One may have been overtaken; of two the updating has lost the estimate."""
    answered = [identified(k) for k in range(3)]
    books = books_of(answered[0])
    for each, expected in zip(answered[1:], (0, 1), strict=True):
        books.handle(each)
        books.handle(replace(rejection(each.window), code="guards", origins=each.origins))
        assert len(books.violations()) == expected


def test_an_estimate_that_the_updating_forgets_is_named() -> None:
    answered = [identified(k) for k in range(4)]
    books = books_of(answered[0])
    for each in answered[1:]:
        books.handle(each)
        books.handle(replace(rejection(each.window), code="guards", origins=each.origins))
    assert books.violations() == ["t1: 1 estimate is neither in the posterior nor refused"]
    (turbine,) = books.as_json()["turbines"]
    assert (turbine["identified"], turbine["refused"], turbine["pending"]) == (4, {"guards": 3}, 1)


def test_a_run_without_updating_owes_estimates_no_answer() -> None:
    assert not books_of(*(identified(k) for k in range(5)), updates=False).violations()


def test_windows_without_an_answer_are_named_and_repeated_ones_count_once() -> None:
    books = books_of(identified(0), identified(0), rejected(1), identified(4), updates=False)
    assert books.violations() == [
        "t1: windows 2 to 3 of boot 0 of session session-1 have no answer"
    ]
    (turbine,) = books.as_json()["turbines"]
    assert (turbine["identified"], turbine["rejected"]) == (2, {"gap": 1})


def test_one_rejection_may_stand_for_the_windows_of_a_long_gap() -> None:
    long = replace(rejected(144), windows_before=142)
    assert not books_of(identified(1), long, identified(145), updates=False).violations()
    (turbine,) = books_of(identified(1), long).as_json()["turbines"]
    assert turbine["rejected"] == {"gap": 143}
    one_less = books_of(identified(1), replace(long, windows_before=141), updates=False)
    assert one_less.violations() == [
        "t1: windows 2 to 2 of boot 0 of session session-1 have no answer"
    ]


def test_windows_of_joined_units_go_on_where_one_unit_or_both_are_left_out() -> None:
    both = (UnitOrigin("lower", "s", 0, 0), UnitOrigin("upper", "s", 0, 0))

    def at(window: int, *present: UnitOrigin) -> ModalEstimate:
        origins = tuple(replace(each, first_sample=window) for each in present)
        return replace(identified(window), origins=origins)

    present = (both, both, both[1:], both[:1], (), both)
    whole = [at(window, *units) for window, units in enumerate(present)]
    assert not books_of(*whole, updates=False).violations()
    (skipped,) = books_of(*whole[:3], whole[5], updates=False).violations()
    assert skipped.startswith("t1: windows 3 to 4 of")


def test_books_of_a_flood_of_names_make_room_by_those_that_were_not_heard_for_longest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(turbine_book, "MOST_BOOKS", 10)
    forged = (block(0, unit=f"forged {k}") for k in range(120))
    books = books_of(*(each for k in range(30) for each in (block(k), *islice(forged, 4))))
    (unit,) = [each for each in books.as_json()["units"] if each["unit"] == "tower"]
    assert (unit["recorded"], unit["boot"]) == (30, 0)
    assert len(books.as_json()["units"]) == 10


def test_refusals_of_nodes_are_told_by_reason() -> None:
    refusing = replace(status("identification"), refused=(MessageCount("other-session", 4),))
    assert books_of(refusing).as_json()["refused"] == {"identification": {"other-session": 4}}


def fed(received: int, **counts: int) -> NodeStatus:
    """What the feed of a unit says of its instrument's messages."""
    taken = (MessageCount("FeedMessage", received),)
    return replace(status("source-tower"), received=taken, **counts)


def test_what_a_feed_dropped_of_its_instruments_messages_is_told_over_all_its_starts() -> None:
    books = books_of(fed(10, late=2), fed(50, late=3, lost=1), fed(8), fed(20, malformed=1))
    (of_feed,) = books.as_json()["instruments"]
    assert of_feed == {
        "turbine": "t1",
        "node": "source-tower",
        "received": 70,
        "lost": 1,
        "late": 3,
        "malformed": 1,
        "duplicate": 0,
    }
    assert "of the instruments' messages 3 × late, 1 × lost, 1 × malformed;" in books.line
    assert "instruments" not in books_of(fed(10, duplicate=4)).line


def test_a_message_that_was_missing_and_came_after_all_is_lost_no_longer() -> None:
    """The count of lost ones falls by that; the feed has not been started again."""
    (of_feed,) = books_of(fed(50, lost=3), fed(60, lost=2)).as_json()["instruments"]
    assert (of_feed["received"], of_feed["lost"]) == (60, 2)


def test_late_messages_of_an_instrument_are_no_late_blocks() -> None:
    """They explain no block that is recorded and was reported missing."""
    books = books_of(*map(block, range(30)), gap(6, 3), fed(10, late=3))
    assert books.violations()


@pytest.mark.parametrize("published", [28, 33])
def test_what_the_source_says_it_published_must_fit(published: int) -> None:
    end = StreamEnd("t1", "tower", "session-1", block(29).end_ns, published)
    books = books_of(*map(block, range(30)), end)
    assert books.as_json()["units"][0]["lost"] == max(0, published - 30)
    assert bool(books.violations())


# ---- alarms and fates --------------------------------------------------------------------------


def test_books_that_do_not_balance_are_an_alarm_within_two_windows() -> None:
    books = books_of(block(0), *(block(n) for n in range(5, 11)), rejected(0))
    assert books.alarms() == []
    books.handle(rejected(1))
    (alarm,) = books.alarms()
    assert (alarm.turbine, alarm.kind) == ("t1", "books")
    assert "blocks 1 to 4 are neither recorded nor reported missing" in alarm.text
    books.handle(gap(1, 4))
    books.handle(rejected(2))
    assert books.alarms() == []


def test_windows_without_a_posterior_are_an_alarm_until_there_is_one() -> None:
    books = books_of(*(rejected(window) for window in range(6)), updates=True)
    (alarm,) = books.alarms()
    assert alarm.kind == "no-posterior"
    assert alarm.text == (
        "no posterior for 6 windows: of all 0 were identified, 6 rejected (6 × gap), 0 estimates "
        "refused (none)"
    )
    assert books.alarms(without_posterior=7) == []
    books.handle(identified(6))
    books.handle(replace(POSTERIOR, turbine="t1", origins=origin(6)))
    assert books.alarms() == []


def test_a_run_without_an_updating_owes_no_posterior() -> None:
    windows = [identified(window) for window in range(8)]
    assert books_of(*windows, updates=None).alarms() == []
    assert books_of(*windows, updates=None).violations() == []
    (alarm,) = books_of(status("updating-1-of-2"), *windows, updates=None).alarms()
    assert alarm.kind == "no-posterior"


def test_each_window_and_each_estimate_has_its_fate() -> None:
    books = books_of(
        identified(0),
        replace(POSTERIOR, turbine="t1", origins=origin(0)),
        identified(1),
        rejected(1, "few-pairs"),
        rejected(2),
        identified(3),
        updates=True,
    )
    (turbine,) = books.as_json()["turbines"]
    fates = [(each["window"], each["fate"], each["estimate"]) for each in turbine["windows"]]
    assert fates == [
        (0, "identified", "in-posterior"),
        (1, "identified", "few-pairs"),
        (2, "gap", ""),
        (3, "identified", "pending"),
    ]


def test_an_answer_that_another_one_replaces_is_superseded() -> None:
    books = books_of(rejected(0), identified(0), updates=False)
    (turbine,) = books.as_json()["turbines"]
    assert (turbine["superseded"], turbine["identified"], turbine["rejected"]) == (1, 1, {})
    books.handle(rejected(0))
    (turbine,) = books.as_json()["turbines"]
    assert (turbine["superseded"], turbine["identified"], turbine["rejected"]) == (2, 1, {})


def test_an_answer_may_overtake_its_estimate_on_the_way() -> None:
    """The refusal and the estimate are of two nodes: nothing orders them in a recording."""
    posterior = replace(POSTERIOR, turbine="t1", window=1, origins=origin(1))
    messages = [rejected(0, "operating-state"), identified(0), posterior, identified(1)]
    later = [each for w in (2, 3, 4) for each in (identified(w), rejected(w, "operating-state"))]
    books = books_of(*messages, *later, updates=True)
    assert books.violations() == []
    (turbine,) = books.as_json()["turbines"]
    assert turbine["identified"] == 5
    assert turbine["in_posterior"] == 1
    assert turbine["refused"] == {"operating-state": 4}
    assert turbine["rejected"] == {}


def test_a_unit_that_starts_again_under_its_name_late_in_its_numbers_has_a_book_of_its_own() -> (
    None
):
    """Its first blocks did not come: its numbers go on in the middle of those before."""
    later = [
        replace(block(number), start_ns=block(number).start_ns + 300 * NANOSECONDS)
        for number in range(40, 60)
    ]
    books = books_of(*(block(number) for number in range(59)), *later, gap(0, 40))
    assert books.violations() == []
    assert [(each["recorded"], each["repeated"]) for each in books.as_json()["units"]] == [
        (59, 0),
        (20, 0),
    ]


def test_estimates_that_wait_for_a_slow_updating_are_not_forgotten() -> None:
    """Identified far ahead of the updating, as in a replay at full speed."""
    ahead = [identified(window) for window in range(12)]
    answers = [rejected(window, "guards") for window in range(9)]
    books = books_of(*ahead, *answers, updates=True)
    assert books.violations() == []
    assert books.alarms(without_posterior=100) == []
