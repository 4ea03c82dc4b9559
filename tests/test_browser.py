"""What people open is opened in a browser: a report and the viewer's page, short forms.

The pictures themselves are looked at by hand: python -m tests.browser.
"""

from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from pipeline.report.html import TextTable, document, paragraph, table_html
from pipeline.viewer.outputs.outputs import WebPage
from pipeline.viewer.outputs.viewer_process import free_port, serve_page
from tests import browser
from tests.browser import DESK, PHONE, Heard, Screen, tab_places

needs_chromium = pytest.mark.skipif(bool(browser.missing()), reason=browser.missing())


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser.chromium() as running:
        yield running


def test_only_what_leaves_this_machine_is_outside():
    heard = Heard()
    for address in ("file:///r.html", "data:,", "http://127.0.0.1:9090/", "blob:http://x/1"):
        browser.note_asked(heard, address)
    browser.note_asked(heard, "https://example.org/font")
    assert heard.outside == ["https://example.org/font"]


def test_errors_are_complaints_and_warnings_are_not():
    heard = Heard()
    for kind in ("error", "warning", "info"):
        browser.note_said(heard, kind, f"an {kind}")
    assert heard.complaints == ["an error"]


@pytest.mark.parametrize("ground", [20, 250])
def test_a_tab_is_ink_between_wide_gaps_on_a_dark_or_light_bar(ground: int):
    bar = np.full((20, 200, 3), ground, dtype=np.uint8)
    for left, right in ((10, 15), (19, 40), (60, 64), (68, 100)):  # sign and name of two tabs
        bar[8:12, left:right] = 255 - ground
    png = BytesIO()
    Image.fromarray(bar).save(png, "PNG")
    assert tab_places(png.getvalue(), (4, 16)) == pytest.approx([26, 81], abs=3)


@needs_chromium
@pytest.mark.parametrize("screen", [DESK, PHONE], ids=lambda screen: screen.name)
def test_a_report_fits_any_screen_and_its_wide_table_scrolls_by_itself(
    chromium: Any, tmp_path: Path, screen: Screen
):
    head = tuple(f"a long heading {number}" for number in range(20))
    table = table_html(TextTable("wide", head, (head,)))
    report = tmp_path / "report.html"
    report.write_text(document("title", paragraph("words " * 200) + table), "utf-8")
    with browser.opened(chromium, report.as_uri(), screen) as (page, heard):
        wide = page.locator(".wide").evaluate("box => box.scrollWidth - box.clientWidth")
        assert browser.overflow(page) <= 0 < wide
    assert heard == Heard()


@needs_chromium
def test_the_viewer_starts_on_our_page_and_asks_nobody_outside(chromium: Any):
    small = Screen("small", 720, 400)  # drawn in software
    with (
        serve_page(WebPage(free_port(0), free_port(0))) as shown,
        browser.opened(chromium, shown.address, small) as (page, heard),
    ):
        browser.start_viewer(page)
        assert page.locator("#canvas").is_visible()
    assert heard == Heard()


@needs_chromium
def test_a_phone_is_asked_first_and_told_of_the_report(chromium: Any):
    with (
        serve_page(WebPage(free_port(0), free_port(0))) as shown,
        browser.opened(chromium, shown.address, PHONE) as (page, heard),
    ):
        assert page.locator("#open").is_visible()
        assert "pilewatch report" in page.locator("#narrow").inner_text()
        assert browser.overflow(page) <= 0
    assert heard == Heard()
