"""What a controller reports: whose time is new, and in what units its figures are."""

import math

import pytest

from sensors.acquisition.scada import ScadaSample
from sensors.feeds.address import parsed
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.scada import AGREEING_REPORTS, LEAP, RisingTimes, ScadaReader
from sensors.feeds.protocol import FeedCounts, FeedError

SECOND = 10**9  # [ns]
START = 1_700_000_000  # [s]
UNKNOWN = [math.nan] * 6


def report(second: float) -> ScadaSample:
    return ScadaSample("t1", round((START + second) * SECOND), "parked", *UNKNOWN)


def given(*seconds: float) -> tuple[list[float], FeedCounts]:
    """The reports that are given on, by their seconds, and what is counted of the others."""
    counts = FeedCounts()
    times = RisingTimes(counts)
    taken = [each for second in seconds for each in times.taken(report(second))]
    return [each.time_ns / SECOND - START for each in taken], counts


def test_reports_that_rise_are_given_at_once_and_what_comes_again_is_counted() -> None:
    taken, counts = given(0, 10, 20, 30, 30, 20, 40)
    assert taken == [0, 10, 20, 30, 40]
    assert (counts.duplicate, counts.late, counts.malformed) == (1, 1, 0)


@pytest.mark.parametrize(("ahead", "believed"), [(LEAP, True), (LEAP + 1, False)])
def test_a_stamp_that_leaps_by_more_than_a_day_is_not_believed_alone(
    ahead: float, believed: bool
) -> None:
    taken, counts = given(0, 1, 1 + ahead, 20)
    assert taken == ([0, 1, 1 + ahead] if believed else [0, 1, 20])
    assert counts.malformed == (0 if believed else 1)
    assert counts.late == (1 if believed else 0)


def test_stamps_that_agree_after_a_leap_are_believed_together() -> None:
    behind = [2 * LEAP + second for second in range(AGREEING_REPORTS)]
    assert given(0, 1, 2, *behind[:-1])[0] == [0, 1, 2]
    taken, counts = given(0, 1, 2, *behind, behind[-1] + 1)
    assert taken == [0, 1, 2, *behind, behind[-1] + 1]
    assert counts.malformed == 0


def test_a_leap_that_others_contradict_is_counted_once_each() -> None:
    taken, counts = given(0, 1, 2, 3 * LEAP, 6 * LEAP, 3)
    assert taken == [0, 1, 2, 3]
    assert counts.malformed == 2
    assert "far ahead" in counts.refusal


def test_as_many_leaps_as_would_do_are_not_believed_where_they_contradict_each_other() -> None:
    wild = [3 * LEAP * (1 + number) for number in range(AGREEING_REPORTS + 1)]
    taken, counts = given(0, 1, 2, *wild, 3)
    assert taken == [0, 1, 2, 3]
    assert counts.malformed == len(wild)


def test_a_first_stamp_that_was_wrong_gives_way_to_reports_that_agree() -> None:
    """Only a time that few reports have shown may turn out wrong itself."""
    right = [float(second) for second in range(AGREEING_REPORTS)]
    assert given(5 * LEAP, *right)[0] == [5 * LEAP, *right]
    shown = [5 * LEAP + second for second in range(AGREEING_REPORTS)]
    taken, counts = given(*shown, *right, *right)
    assert taken == shown
    assert counts.late == 2 * AGREEING_REPORTS


READER = ScadaReader(
    parsed("scada+csv:/x.csv?power=P_kW*1000&wind_speed=Wind.Avg&yaw=Yaw*-1"), "t1"
)
SAID = {
    "time": "2024-03-01T12:00:00Z",
    "state": " Parked ",
    "Wind.Avg": "9.5",
    "P_kW": 2,
    "Yaw": 90,
}


def test_figures_are_in_standard_units_under_the_names_that_the_address_gives() -> None:
    sample = READER.sample(SAID)
    assert (sample.turbine, sample.state) == ("t1", "parked")
    assert sample.time_ns == 1_709_294_400 * SECOND
    assert (sample.wind_speed, sample.power, sample.yaw) == (9.5, 2000.0, -90.0)
    assert math.isnan(sample.pitch)
    assert READER.declared == ("P_kW", "Wind.Avg", "Yaw")


@pytest.mark.parametrize(
    ("written", "known"),
    [(1e6, True), (-1e6, True), (1.001e6, False), ("", False), (None, False), (" ", False)],
)
def test_a_figure_beyond_all_reason_or_empty_is_unknown(written: object, known: bool) -> None:
    """P_kW counts a thousandfold; no figure is above a thousand millions."""
    assert math.isnan(READER.sample(SAID | {"P_kW": written}).power) is not known


@pytest.mark.parametrize("word", ["n/a", "NULL", "-", "--", "#N/A", " None ", "missing", "1.#QNAN"])
def test_a_placeholder_is_an_unknown_figure_or_state_and_the_others_are_known(word: str) -> None:
    sample = READER.sample(SAID | {"P_kW": word})
    assert math.isnan(sample.power)
    assert (sample.state, sample.wind_speed, sample.yaw) == ("parked", 9.5, -90.0)
    sample = READER.sample(SAID | {"state": word})
    assert (sample.state, sample.wind_speed) == ("", 9.5)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"P_kW": "x"}, "P_kW is 'x', which is no number"),
        ({"state": "broken"}, "state is 'broken'; parked"),
        ({"time": "noon"}, "time: "),
    ],
)
def test_what_cannot_be_read_is_refused_by_its_name(change: dict[str, str], reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        READER.sample(SAID | change)


def test_a_report_has_a_time_and_something_beside_it() -> None:
    with pytest.raises(MessageError, match="no 'time' in it; it has state"):
        READER.sample({each: SAID[each] for each in ("state", "P_kW")})
    with pytest.raises(MessageError, match="none of state"):
        READER.sample({"time": SAID["time"], "other": 1})
    assert math.isnan(READER.sample({"time": SAID["time"], "state": "idling"}).power)


def test_a_factor_is_a_number() -> None:
    with pytest.raises(FeedError, match=r"'k' is no factor"):
        ScadaReader(parsed("scada+csv:/x.csv?power=P*k"), "t1")
