"""The layout for a narrow screen is made from what a session keeps with itself."""

import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.blueprint import NARROW_NAME
from pipeline.viewer.outputs.outputs import ConnectedViewer, parse_view
from pipeline.viewer.session_views import SessionViews, narrow_layout, send_views, stored_views
from pipeline.viewer.tabs.modes import SHAPES_IN_ROW
from pipeline.viewer.tabs.narrow import LONGEST_TITLE
from pipeline.viewer.view_parameters import ViewParameters
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import LAYOUT, REFERENCE_MODES, TURBINE

# Of Rerun's labels, measured on a picture [pixels].
LAID_OUT = 480  # width of a narrow screen
CHARACTER = 6.3  # mean width of a text's characters
TEXT_HEIGHT, BELOW = 14.0, 5.0  # of a text, and of its top from the place that it belongs to
PARAMETERS = ViewParameters("t1", (LAYOUT,), tuple("abcdefghijk"), 50.0, sized=True, has_truth=True)
MODES_ONLY = replace(PARAMETERS, has_structure=False, sized=False, lists_nodes=False)


def session_views(*parameters: ViewParameters) -> SessionViews:
    return SessionViews(parameters, playback_speed=30.0, span_ns=(10**9, 10**12))


def views(part: Any) -> Iterator[Any]:
    if not isinstance(part, rrb.Container):
        yield part
        return
    for each in part.contents:
        yield from views(each)


def containers(part: Any) -> Iterator[Any]:
    if isinstance(part, rrb.Container):
        yield part
        for each in part.contents:
            yield from containers(each)


@pytest.mark.parametrize("span_ns", [None, (1, 3)])
def test_views_are_read_as_they_were_written(span_ns: tuple[int, int] | None):
    written = replace(session_views(PARAMETERS, MODES_ONLY), span_ns=span_ns)
    assert SessionViews.from_json(written.to_json()) == written


@pytest.mark.parametrize(
    "shown",
    [(PARAMETERS,), (MODES_ONLY,), (PARAMETERS, replace(MODES_ONLY, turbine="t2"))],
    ids=["turbine", "modes only", "farm"],
)
def test_a_narrow_screen_shows_what_a_wide_one_does(shown: tuple[ViewParameters, ...]):
    wide, narrow = (session_views(*shown).blueprint(narrow=each) for each in (False, True))
    drawn = [{view.origin for view in views(one.root_container)} for one in (wide, narrow)]
    assert drawn[0] <= drawn[1]


def test_on_a_narrow_screen_nothing_stands_side_by_side_but_small_plots():
    root = session_views(PARAMETERS).blueprint(narrow=True).root_container
    assert not [one for one in containers(root) if isinstance(one, rrb.Horizontal)]
    assert all(len(str(view.name)) <= LONGEST_TITLE for view in views(root))


@pytest.mark.parametrize("narrow", [False, True])
def test_a_session_opens_with_its_first_tabs_and_every_part_of_a_row_has_its_share(narrow: bool):
    shown = (PARAMETERS, replace(MODES_ONLY, turbine="t2"))
    root = session_views(*shown).blueprint(narrow=narrow).root_container
    for each in containers(root):
        if isinstance(each, rrb.Tabs):
            assert each.active_tab in (None, 0)
        for shares in (each.row_shares, each.column_shares):
            assert shares is None or len(shares) == len(each.contents)


def test_on_a_desk_the_status_has_room_for_a_warning():
    """Heights measured on a picture of a farm's turbine, 1600 by 1000 pixels."""
    root = session_views(PARAMETERS, replace(MODES_ONLY, turbine="t2")).blueprint().root_container
    (column,) = [
        one
        for one in containers(root)
        if isinstance(one, rrb.Vertical) and "/t1/status" in [view.origin for view in views(one)]
    ]
    assert column.row_shares is not None
    shown = column.row_shares[1] / sum(column.row_shares) * 877  # of the column [pixels]
    assert shown >= 434  # title, sentence, table, fit, heading and three lines [pixels]


def test_every_shape_of_a_narrow_screen_is_in_one_row():
    root = session_views(PARAMETERS).blueprint(narrow=True).root_container
    rows = [view.contents for view in views(root) if view.origin == "/t1/shapes"]
    assert max(map(len, rows)) == SHAPES_IN_ROW
    assert [path for row in rows for path in row] == [f"/t1/shapes/{m}/**" for m in "abcdefghijk"]


@pytest.mark.parametrize("narrow", [False, True])
def test_every_track_of_a_mode_says_what_its_band_is(narrow: bool):
    """A grid's own title shows where it lies in tabs alone; 19 characters of a plot's are seen."""
    modes = ("m1", "m10", "m12")
    root = session_views(replace(MODES_ONLY, modes=modes)).blueprint(narrow=narrow).root_container
    tracks = [view for view in views(root) if str(view.origin).startswith("/t1/modes/")]
    assert [view.name for view in tracks] == [f"{mode}: f ± 2 std [Hz]" for mode in modes]
    assert all(len(str(view.name)) <= 19 for view in tracks)


def test_a_narrow_screen_explains_its_colours_and_signs_as_a_wide_one_does():
    root = session_views(PARAMETERS).blueprint(narrow=True).root_container
    titles = {str(view.origin): str(view.name) for view in views(root)}
    assert "colours as in Series" in titles["/t1/spectrum"]
    assert "one colour per band" in titles["/t1/stabilisation"]
    assert "≈" in titles["/t1/shapes"]


def boxes(recorded: Recorded, view: Any) -> dict[str, np.ndarray]:
    """Left, top, right, bottom of each text of a picture on a narrow screen [pixels]."""
    (bounds,) = view.properties["VisualBounds2D"].range.as_arrow_array().to_pylist()
    left, right = bounds["x_range"]
    scale = LAID_OUT / (right - left)
    *_, texts = recorded.column(f"{view.origin}/text", "Points2D:labels")
    *_, places = recorded.column(f"{view.origin}/text", "Points2D:positions")
    drawn = {}
    for text, (x, y) in zip(texts, places, strict=True):
        middle, top, half = scale * (x - left), scale * y + BELOW, CHARACTER * len(text) / 2
        drawn[f"{text} at {x:.2f}, {y:.2f}"] = np.array(
            [middle - half, top, middle + half, top + TEXT_HEIGHT]
        )
    return drawn


def test_texts_of_a_narrow_screen_do_not_cover_each_other_and_none_is_cut(recorded: Recorded):
    views_of = SessionViews.from_json(stored_views(recorded.path))
    root = views_of.blueprint(narrow=True).root_container
    pictures = [view for view in views(root) if isinstance(view, rrb.Spatial2DView)]
    assert len(pictures) == 6
    for view in pictures:
        drawn = boxes(recorded, view)
        for name, box in drawn.items():
            assert box[0] >= 0, (view.origin, name)
            assert box[2] <= LAID_OUT, (view.origin, name)
        for (one, a), (other, b) in combinations(drawn.items(), 2):
            apart = np.maximum(a[:2], b[:2]) >= np.minimum(a[2:], b[2:])
            assert apart.any(), (view.origin, one, other)


def test_a_file_of_pictures_has_its_narrow_layout_with_it(recorded: Recorded):
    (parameters,) = SessionViews.from_json(stored_views(recorded.path)).parameters
    assert (parameters.turbine, parameters.layouts) == (TURBINE, (LAYOUT,))
    assert parameters.modes == tuple(label for label, *_ in REFERENCE_MODES)
    assert NARROW_NAME.encode() in narrow_layout(recorded.path)  # as the page looks for it


def test_a_served_session_keeps_its_views_beside_the_page(tmp_path: Path):
    output = ConnectedViewer("rerun+http://127.0.0.1:9876/proxy", tmp_path / "views.json")
    assert parse_view(output.word) == output
    assert narrow_layout(tmp_path / "views.json") == b""  # before the first layout
    send_views(rr.RecordingStream("t"), output, session_views(PARAMETERS))
    assert SessionViews.from_json((tmp_path / "views.json").read_text("utf-8")).span_ns
    assert NARROW_NAME.encode() in narrow_layout(tmp_path / "views.json")


def test_pictures_of_an_older_version_have_no_narrow_layout(tmp_path: Path):
    recording = rr.RecordingStream("t")
    recording.save(tmp_path / "old.rrd")
    recording.log("a", rr.TextDocument("a"), static=True)
    recording.disconnect()
    assert narrow_layout(tmp_path / "old.rrd") == b""


def test_the_page_looks_for_the_name_of_the_narrow_layout():
    script = (files("pipeline.viewer.outputs") / "web" / "page.js").read_text("utf-8")
    assert re.findall(r'const NARROW_NAME = "(.*)";', script) == [NARROW_NAME]
