"""What a sender's numbers say of the messages that never came."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.feeds.payloads.sequence_numbers import FARTHEST_AHEAD, WATCHED, Place, SequenceMonitor


@settings(max_examples=50)
@given(arrived=st.lists(st.integers(0, 200), min_size=1, max_size=200))
def test_what_is_lost_is_what_lies_between_the_numbers_that_came(arrived: list[int]) -> None:
    watch = SequenceMonitor()
    arrived = [0, *arrived]
    places = [watch.place(number) for number in arrived]
    assert watch.lost == max(arrived) + 1 - len(set(arrived))
    assert places.count(Place.DUPLICATE) == len(arrived) - len(set(arrived))


def test_a_message_that_comes_late_is_lost_no_longer() -> None:
    watch = SequenceMonitor()
    assert [watch.place(number) for number in (7, 8, 11, 9)] == [
        Place.AHEAD,
        Place.NEXT,
        Place.AHEAD,
        Place.BEHIND,
    ]
    assert watch.lost == 1


def test_a_long_cut_is_counted_to_the_last_message() -> None:
    watch = SequenceMonitor()
    watch.place(0)
    watch.place(100_001)
    assert watch.lost == 100_000
    assert watch.place(100_001 - WATCHED - 5) is Place.OLD
    assert watch.lost == 100_000


def test_a_new_start_of_the_sender_begins_another_count_and_its_stragglers_are_old() -> None:
    watch = SequenceMonitor()
    for number in (5, 6, 8):
        watch.place(number, session=100)
    assert watch.place(0, session=200) is Place.AHEAD
    assert watch.place(9, session=100) is Place.OLD
    assert watch.place(1, session=200) is Place.NEXT
    assert watch.lost == 1


def test_a_sender_that_does_not_number_its_starts_is_known_by_its_time() -> None:
    watch = SequenceMonitor()
    for number in range(10):
        watch.place(number, time_ns=number)
    assert watch.place(3, time_ns=3) is Place.DUPLICATE
    assert watch.place(0, time_ns=500) is Place.AHEAD
    assert watch.place(1, time_ns=501) is Place.NEXT
    assert watch.lost == 0


def test_where_sessions_rise_nothing_that_was_sent_before_is_taken_again() -> None:
    watch = SequenceMonitor(rising=True)
    for number in range(10):
        watch.place(number, session=100)
    watch.place(0, session=200)
    assert [watch.place(number, session=100) for number in range(5, 15)] == [Place.OLD] * 10
    assert watch.place(0, session=200) is Place.DUPLICATE
    assert watch.place(0, session=200, time_ns=10**18) is Place.DUPLICATE


def test_a_number_beyond_all_reason_counts_nothing() -> None:
    watch = SequenceMonitor()
    watch.place(0)
    for far in (1, 2, 0, 5_000, 5_001):  # no three on end
        assert watch.place(2 * FARTHEST_AHEAD + far) is Place.OLD
        if far == 2:
            assert watch.place(1) is Place.NEXT
    assert watch.lost == 0


@pytest.mark.parametrize("rising", [False, True])
def test_a_sender_that_goes_on_far_ahead_is_taken_there(rising: bool) -> None:
    """After a link that was away for hours."""
    watch = SequenceMonitor(rising=rising)
    watch.place(0, time_ns=0)
    first = FARTHEST_AHEAD + 80_000
    places = [watch.place(first + n, time_ns=first + n) for n in range(5)]
    assert places == [Place.OLD, Place.OLD, Place.AHEAD, Place.NEXT, Place.NEXT]
    assert watch.place(1, time_ns=1) is Place.OLD
    assert watch.lost == 0


def test_numbers_far_ahead_with_times_of_before_are_not_taken() -> None:
    watch = SequenceMonitor()
    watch.place(0, time_ns=10**9)
    for n in range(5):
        assert watch.place(2 * FARTHEST_AHEAD + n, time_ns=n) is Place.OLD
