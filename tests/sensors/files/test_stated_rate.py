"""A stated rate beside a file's own stamps: which counts, and what is said of it."""

import numpy as np
import pytest

from sensors.files.stated_rate import StampedTime, rate_note, stamped_time, with_stated_rate
from sensors.files.table import ChannelTable

FOLLOWED = "its own time is followed"
COUNTED = "the samples are counted at the 10 Hz given"


def table(
    times: list[float] | None, n: int | None = None, rate: float | None = None
) -> ChannelTable:
    samples = np.zeros((n if times is None else len(times), 1))
    stamps = None if times is None else np.array(times)
    return ChannelTable(("ax",), ("",), samples, stamps, 10**18, rate)


def test_a_pace_is_that_from_the_first_stamp_to_the_last_over_all_chunks() -> None:
    chunks = [table([0.0, 0.1, 0.2]), table([]), table([0.3, 0.5])]
    found = stamped_time(chunks)
    assert found is not None
    assert found.increase
    assert found.pace == pytest.approx(4 / 0.5)
    longest = 0.2 / 0.5  # of the whole time
    assert found.pace_tolerance == pytest.approx(longest, abs=0.02)
    assert found.pace_tolerance > longest


@pytest.mark.parametrize(
    "times", [[0.0, 0.1, 0.1, 0.3], [0.0, 0.2, 0.1, 0.3]], ids=["stand still", "go back"]
)
def test_stamps_that_do_not_increase_have_a_pace_all_the_same(times: list[float]) -> None:
    for chunks in ([table(times)], [table(times[:2]), table(times[2:])]):
        found = stamped_time(chunks)
        assert found is not None
        assert not found.increase
        assert found.pace == pytest.approx(3 / 0.3)


def test_where_no_time_passes_there_is_no_pace_and_without_stamps_nothing_is_known() -> None:
    for times in ([0.0], [0.0, 0.0], [0.5, 0.2]):
        assert stamped_time([table(times)]) == StampedTime(False, None, 0.0)
    assert stamped_time([]) is stamped_time([table([])]) is None
    assert stamped_time([table([0.0, 0.1]), table(None, 2)]) is None


STEADY, STILL = StampedTime(True, 10.0, 0.001), StampedTime(False, 20.0, 0.001)


@pytest.mark.parametrize(
    ("own", "stamps", "note"),
    [
        (None, None, ""),
        (10.0, None, ""),
        (20.0, None, f"the file states 20 Hz; {COUNTED}"),
        (5.0, None, f"the file states 5 Hz; {COUNTED}"),
        (None, STEADY, ""),
        (10.0, STEADY, ""),
        (20.0, STEADY, f"runs at 20 Hz by its own time, not at the 10 Hz given; {FOLLOWED}"),
        (None, STILL, f"and have 20 samples a second on the whole; {COUNTED}"),
        (None, StampedTime(False, 10.01, 0.0011), ""),
        (None, StampedTime(False, 10.01, 0.0009), f" samples a second on the whole; {COUNTED}"),
        (None, StampedTime(False, 9.99, 0.0009), COUNTED),
        (None, StampedTime(False, None, 0.0), ""),
    ],
)  # fmt: skip
def test_a_note_says_how_the_rates_differ_and_which_one_counts(
    own: float | None, stamps: StampedTime | None, note: str
) -> None:
    found = rate_note(own, stamps, 10.0)
    assert found.endswith(note)
    assert bool(found) is bool(note)


def test_stamps_that_increase_are_kept_and_others_are_left_out() -> None:
    rising = [0.0, 0.05, 0.1, 0.15]
    kept, rate, note = with_stated_rate(table(rising), 10.0)
    assert kept.times is not None
    assert rate == pytest.approx(20.0)
    assert FOLLOWED in note
    still, rate, note = with_stated_rate(table([0.0, 0.0, 0.2, 0.2]), 10.0)
    assert (still.times, rate) == (None, 10.0)
    bare, rate, note = with_stated_rate(table(None, 4, rate=20.0), 10.0)
    assert (bare.times, rate) == (None, 10.0)
    assert note == f"the file states 20 Hz; {COUNTED}"


def with_gaps(step: float, n: int, *gaps: tuple[int, float]) -> list[float]:
    """`n` stamps that are `step` apart but for gaps behind some samples; one stamp stands still."""
    times = np.arange(n) * step
    for place, missing in gaps:
        times[place:] += missing
    times[3] = times[2]
    return times.round(6).tolist()


@pytest.mark.parametrize("cut", [50, 199, 200, 201, 400])
@pytest.mark.parametrize("gaps", [((200, 60.0),), ((200, 60.0), (300, 5.0))])
def test_a_gap_among_stamps_that_are_not_followed_is_named(
    cut: int, gaps: tuple[tuple[int, float], ...]
) -> None:
    times = with_gaps(0.1, 400, *gaps)
    found = stamped_time([table(times[:cut]), table(times[cut:])])
    assert found is not None
    missing = sum(each for _, each in gaps)
    assert found.gap == pytest.approx(missing, abs=0.01)
    assert found.gap_begin == pytest.approx(19.9)
    assert found.pace == pytest.approx(10.0, rel=0.01)
    note = rate_note(None, found, 10.0)
    assert f"leap over {missing:g} s (first 19.9 s after they begin)" in note
    assert "samples a second" not in note
    assert note.endswith(f"{COUNTED}, and what follows a gap is that much too early")
    assert f"leap over {missing:g} s" in with_stated_rate(table(times), 10.0)[2]
    assert "have 10 samples a second on the whole and leap" in rate_note(None, found, 20.0)


def test_stamps_that_are_of_packets_have_no_gap() -> None:
    sizes = [4, 4, 4, 40, 4, 4, 80, 4, 4, 4]
    begins = np.cumsum([0, *sizes[:-1]]) * 0.1
    seconds = np.repeat(begins, sizes).tolist()
    back = np.arange(200) * 0.1
    back[100:150] -= 10.0
    for times in (seconds, np.floor(np.arange(400) * 0.1).tolist(), back.tolist()):
        found = stamped_time([table(times)])
        assert found is not None
        assert (found.gap, found.increase) == (0.0, False)
        assert rate_note(None, found, 10.0) == ""
