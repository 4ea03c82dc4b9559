"""Several turbines in one session: all at a glance, each below its own name."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import Message, NodeStatus
from pipeline.viewer.outputs.outputs import RrdFile
from pipeline.viewer.pictures.farm_overview import (
    ROWS_OF_TURBINES,
    board_bounds,
    farm_markdown,
    status_indicators,
)
from pipeline.viewer.pictures.status_text import SessionStatus
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import DESCRIPTION, START_NS, WINDOW, Episode, session

HOST_NAMES = ("north", "south")
EPISODES = (Episode(n_windows=2, block=60), Episode(n_windows=2, block=60, trusted=False))


def farm_session() -> Iterator[Message]:
    """Two turbines by turns; the data of `south` contradict its model."""
    north, south = map(session, EPISODES)
    for of_north, of_south in zip(north, south, strict=True):
        yield replace(of_north, turbine=HOST_NAMES[0])
        yield replace(of_south, turbine=HOST_NAMES[1])


@pytest.fixture(scope="module")
def farm(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    path = tmp_path_factory.mktemp("farm") / "s.rrd"
    viewer = Viewer([RrdFile(path)], DESCRIPTION, session="s", strict=True)
    for message in farm_session():
        viewer.handle(message)
    viewer.close()
    return Recorded(path)


def test_of_turbines_without_a_sample_nothing_is_drawn_at_a_time_in_1970(
    tmp_path: Path,
) -> None:
    path = tmp_path / "s.rrd"
    viewer = Viewer([RrdFile(path)], DESCRIPTION, session="s", strict=True)
    layout = next(each for each in session(EPISODES[0]) if isinstance(each, SensorLayout))
    for name in HOST_NAMES:
        viewer.handle(replace(layout, turbine=name))
    viewer.close()
    assert Recorded(path).timelines == set()


def statuses() -> list[SessionStatus]:
    """After the whole session."""
    each = {name: SessionStatus(name) for name in HOST_NAMES}
    for message in farm_session():
        if not isinstance(message, NodeStatus):
            each[message.turbine].take(message)
    return list(each.values())


def test_every_turbine_has_its_own_median_of_each_stiffness_among_all_turbines(farm: Recorded):
    ends = [START_NS + n * WINDOW * NANOSECONDS for n in (1, 2)]
    for name in ("k11", "k22", "k12"):
        for turbine in HOST_NAMES:
            path = f"/all-turbines/{name}/{turbine}"
            own = farm.scalars(f"/{turbine}/foundation/{name}/posterior")
            assert farm.scalars(path)[:, 0] == pytest.approx(own[:, 1])
            assert list(farm.times_ns(path)) == ends
            assert farm.series_names(path) == [f"{turbine} [-]"]


def test_every_turbine_has_everything_below_its_own_name(farm: Recorded):
    north, south = (
        {entity.removeprefix(f"/{name}/") for entity in farm.entities if f"/{name}/" in entity}
        for name in HOST_NAMES
    )
    assert north == south
    assert {"signals/tower/acceleration", "spectrum/channels", "foundation/joint/draws"} <= north


def test_warnings_of_all_turbines_stand_together_each_with_its_turbine(farm: Recorded):
    lines = [text for (text,) in farm.column("/all-turbines/events", "TextLog:text")]
    untrusted = [line for line in lines if "south: NOT TRUSTED" in line]
    assert len(untrusted) == 2  # a posterior in each window
    of_modes = [line for line in lines if "close-modes" in line]
    assert len(of_modes) == len(lines) - 2 == 2  # where each turbine's warning begins


def test_the_table_of_a_farm_begins_with_who_needs_attention(farm: Recorded):
    *_, (text,) = farm.column("/all-turbines/table", "TextDocument:text")
    assert text == farm_markdown(statuses())
    heading, attention, _, _ = text.split("\n\n")
    assert heading == "### 2 turbines: 1 known, 1 NOT TRUSTED"
    assert attention.startswith("- **south**: ")
    assert "foundation: NOT TRUSTED\n- **north**: 10 modes; close-modes" in attention
    rows = [line for line in text.splitlines() if line.startswith(("| north", "| south"))]
    assert [row.split(" | ")[1] for row in rows] == ["known", "NOT TRUSTED"]
    assert all(row.count(" ± ") == 3 and "00:20:00" in row for row in rows)


def test_a_turbine_of_which_nothing_is_known_yet_has_its_row():
    text = farm_markdown([*statuses(), SessionStatus("east")])
    assert "| east | no posterior yet | – | – | – | – | 0 | 0 | 0 | – |" in text
    assert "- **east**" not in text  # nothing is wrong with it


def test_every_turbine_has_three_indicators_in_its_row_and_a_large_farm_further_columns():
    many = [SessionStatus(f"T{number}") for number in range(ROWS_OF_TURBINES + 5)]
    board = status_indicators(many)
    assert len(board.positions) == len(board.indicators) == 3 * len(many)
    assert len(set(board.positions)) == len(board.positions)
    (left, right), (top, bottom) = board_bounds(len(many))
    places = np.array([*board.positions, *(text.position for text in board.texts)])
    assert (places > (left, top)).all()
    assert (places < (right, bottom)).all()


def test_the_views_of_a_farm_are_laid_out_for_all_its_turbines_and_at_the_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    from pipeline.viewer import session_views as show

    laid_out = []

    def counting(parameters, **settings):
        laid_out.append([each.turbine for each in parameters])
        return original(parameters, **settings)

    original = show.session_blueprint
    monkeypatch.setattr(show, "session_blueprint", counting)
    viewer = Viewer([RrdFile(tmp_path / "s.rrd")], DESCRIPTION, session="s", strict=True)
    messages = list(session(Episode(n_windows=1, block=60)))
    for message in messages:
        for number in range(5):
            viewer.handle(replace(message, turbine=f"T{number}"))
    viewer.close()
    assert [len(turbines) for turbines in laid_out] == [5, 5]  # when all are there; at the end
