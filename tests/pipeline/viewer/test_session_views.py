"""The layout for a narrow screen is made from what a session keeps with itself."""

import re
from collections.abc import Iterator
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import pytest
import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.narrow_blueprint import LONGEST_TITLE, NARROW_NAME, SHAPES_IN_ROW
from pipeline.viewer.outputs.outputs import ConnectedViewer, parse_view
from pipeline.viewer.session_views import SessionViews, narrow_layout, send_views, stored_views
from pipeline.viewer.view_parameters import ViewParameters
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import LAYOUT, REFERENCE_MODES, TURBINE

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
    def containers(part: Any) -> Iterator[Any]:
        if isinstance(part, rrb.Container):
            yield part
            for each in part.contents:
                yield from containers(each)

    root = session_views(PARAMETERS).blueprint(narrow=True).root_container
    assert not [one for one in containers(root) if isinstance(one, rrb.Horizontal)]
    assert all(len(str(view.name)) <= LONGEST_TITLE for view in views(root))


def test_every_shape_of_a_narrow_screen_is_in_one_row():
    root = session_views(PARAMETERS).blueprint(narrow=True).root_container
    rows = [view.contents for view in views(root) if view.origin == "/t1/shapes"]
    assert max(map(len, rows)) == SHAPES_IN_ROW
    assert [path for row in rows for path in row] == [f"/t1/shapes/{m}/**" for m in "abcdefghijk"]


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
