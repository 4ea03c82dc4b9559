"""A table of the controller that grows, is rotated, and is at times wrong."""

import math
import threading
from pathlib import Path

import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.feeds.live import LiveFeed
from sensors.feeds.open_feed import open_feed
from sensors.feeds.protocol import FeedError
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.sensors.feeds.scripted import measured_until

LAYOUT = LayoutFile((MappedChannel("ax", 100.0, (1.0, 0.0, 0.0)),), "t1", "top")
START = 1_700_000_000
HEADER = "time,wind_speed,rotor_speed,state\n"


def row(number: int) -> str:
    return f"{START + 10 * number},{number}.5,0.1,parked\n"


def tail(path: Path, query: str = "") -> LiveFeed:
    return open_feed(f"scada+csv:{path}{query}", LAYOUT)


def winds(given: list[object]) -> list[float]:
    return [each.wind_speed for each in given if isinstance(each, ScadaSample)]


def add(path: Path, text: str) -> None:
    with path.open("a") as file:
        file.write(text)


def test_every_new_row_is_a_sample_and_the_old_ones_are_not(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER + row(0) + row(1))
    live = tail(path)
    given = measured_until(
        live, lambda: live.counts.received == 2, lambda: add(path, row(2) + row(3))
    )
    assert winds([*given]) == [2.5, 3.5]
    first = given[0]
    assert isinstance(first, ScadaSample)
    assert (first.time_ns, first.state) == ((START + 20) * NANOSECONDS, "parked")


def test_all_rows_are_given_from_the_start_if_wanted(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER + row(0) + row(1))
    live = tail(path, "?from=start")
    assert winds([*measured_until(live, lambda: live.counts.received == 2)]) == [0.5, 1.5]


def test_a_placeholder_costs_its_own_figure(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(f"{HEADER}{START},n/a,0.0,parked\n{START + 10},9.5,NULL,-\n")
    live = tail(path, "?from=start")
    first, second = measured_until(live, lambda: live.counts.received == 2)
    assert isinstance(first, ScadaSample)
    assert isinstance(second, ScadaSample)
    assert math.isnan(first.wind_speed)
    assert math.isnan(second.rotor_speed)
    assert (first.rotor_speed, first.state) == (0.0, "parked")
    assert (second.wind_speed, second.state) == (9.5, "")
    assert live.counts.malformed == 0


def test_a_level_above_a_chart_datum_is_given_above_the_mean(tmp_path: Path) -> None:
    path = tmp_path / "tide.csv"
    path.write_text(f"time,Level_cm\n{START},325\n")
    live = tail(path, "?from=start&water_level=Level_cm*0.01&water_level_zero=-1.85")
    (sample,) = measured_until(live, lambda: live.counts.received == 1)
    assert isinstance(sample, ScadaSample)
    assert sample.water_level == pytest.approx(1.4)


def test_a_zero_of_the_level_that_is_no_elevation_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(FeedError, match="water_level_zero=LAT is no elevation in metres"):
        tail(tmp_path / "tide.csv", "?water_level_zero=LAT")


def test_a_row_that_is_half_written_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER)
    live = tail(path)
    halves = [row(0)[:7], row(0)[7:] + row(1)]

    def done() -> bool:
        if halves:
            add(path, halves.pop(0))
        return live.counts.received == 2

    assert winds([*measured_until(live, done)]) == [0.5, 1.5]
    assert live.counts.malformed == 0


@pytest.mark.parametrize("how", ["renamed", "emptied"])
def test_a_file_that_is_rotated_loses_nothing(tmp_path: Path, how: str) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER)
    live = tail(path)
    steps = [0]

    def done() -> bool:
        if live.counts.received == 2 and len(steps) == 1:
            steps.append(1)
            if how == "renamed":
                add(path, row(2))
                path.rename(tmp_path / "scada.csv.1")
                path.write_text(HEADER + row(3))
            else:
                path.write_text(row(2))  # and without a header
                add(path, "")
        if live.counts.received == 3 and how == "emptied":
            add(path, row(3))
        return live.counts.received >= 4

    given = measured_until(live, done, lambda: add(path, row(0) + row(1)))
    assert winds([*given]) == [0.5, 1.5, 2.5, 3.5]


def test_semicolons_decimal_commas_and_names_of_ones_own(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text("Zeit;Wind;P_kW\n")
    live = tail(path, "?time=Zeit&wind_speed=Wind&power=P_kW*1000")
    (sample,) = measured_until(
        live, lambda: live.counts.received == 1, lambda: add(path, "2023-11-14 22:13:20;9,5;1,2\n")
    )
    assert isinstance(sample, ScadaSample)
    assert (sample.wind_speed, sample.power, sample.state) == (9.5, 1200.0, "")


def test_rows_that_are_wrong_or_not_later_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER)
    live = tail(path)
    wrong = ["noon,1,1,parked\n", f"{START},1\n", f"{START},calm,1,parked\n", f"{START},1,1,gone\n"]
    text = "".join([row(1), *wrong, row(1), row(0), row(2)])
    given = measured_until(live, lambda: live.counts.received == 8, lambda: add(path, text))
    assert winds([*given]) == [1.5, 2.5]
    assert (live.counts.malformed, live.counts.duplicate, live.counts.late) == (4, 1, 1)
    assert "state is 'gone'; parked, idling, start, operating, stop" in live.counts.refusal


def test_one_wild_stamp_costs_its_own_row_and_a_leap_that_lasts_is_believed(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER)
    live = tail(path)
    years = 10**7  # in rows
    numbers = [years, 0, 1, 2, 3, 2 * years, 4, 3 * years, 3 * years + 1, 3 * years + 2, 5, 6, 7]
    text = "".join(row(number) for number in numbers)
    given = measured_until(live, lambda: live.counts.received == 13, lambda: add(path, text))
    times = [each.time_ns // NANOSECONDS for each in given if isinstance(each, ScadaSample)]
    assert [(time - START) // 10 for time in times] == [
        years, 0, 1, 2, 3, 4, 3 * years, 3 * years + 1, 3 * years + 2,
    ]  # fmt: skip
    assert (live.counts.malformed, live.counts.late) == (1, 3)


def test_a_file_that_is_written_anew_with_its_old_rows_gives_only_the_new_ones(
    tmp_path: Path,
) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER)
    live = tail(path)
    day = [row(number) for number in range(20)]

    renamed: list[bool] = []

    def anew() -> bool:
        if live.counts.received == 20 and not renamed:
            renamed.append(True)
            (tmp_path / "new").write_text(HEADER + "".join(day) + row(20))
            (tmp_path / "new").rename(path)
        return live.counts.received == 41

    given = measured_until(live, anew, lambda: add(path, "".join(day)))
    assert winds([*given]) == [number + 0.5 for number in range(21)]
    assert live.counts.duplicate + live.counts.late == 20


def test_a_row_without_end_is_dropped_and_the_next_one_read(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    path.write_text(HEADER)
    live = tail(path)
    text = "x" * 3_000_000 + "\n" + row(0)
    given = measured_until(live, lambda: live.counts.received == 1, lambda: add(path, text))
    assert winds([*given]) == [0.5]
    assert live.counts.refusal == "a row of more than 65536 bytes"


def test_a_file_that_is_not_there_is_waited_for_unless_once(tmp_path: Path) -> None:
    path = tmp_path / "scada.csv"
    with pytest.raises(FeedError, match="cannot be reached: No such file"):
        list(open_feed(f"scada+csv:{path}", LAYOUT, once=True).measured(threading.Event()))
    live = tail(path, "?from=start")

    def done() -> bool:
        if live.counts.problem and not path.exists():
            path.write_text(HEADER + row(0))
        return live.counts.received == 1

    assert winds([*measured_until(live, done)]) == [0.5]


def test_a_factor_that_is_no_number_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(FeedError, match=r"power=P\*x: 'x' is no factor"):
        tail(tmp_path / "scada.csv", "?power=P*x")
