"""Pages in a real browser: python -m tests.browser [--tabs] FOLDER FILE…

FILE is a report (.html), opened as it is, or pictures (.rrd), opened on the page that
`pilewatch show FILE --view web` serves; an address (http://…) is opened where it is, e.g. that of a
session that runs with `--view web`. Each is opened as on a desk and as on a phone, dark and light,
waited for until it has drawn, and saved as a PNG in FOLDER; with --tabs of pictures one PNG of each
of the outermost tabs, of a phone also of those inside them. What the browser complains of, and
every request that leaves this machine, is told; the exit code is then 1.

Needs Playwright (pip install 'pilewatch[browser]') and Debian's chromium (apt-get install
chromium); without them the script says so and opens nothing. It draws without a graphics card: a
picture of the viewer takes a minute.
"""

import logging
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.util import find_spec
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
from PIL import Image

from pipeline.viewer.outputs.outputs import WebPage
from pipeline.viewer.outputs.viewer_process import free_port, serve_page
from pipeline.viewer.session_views import narrow_layout

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

FLAGS = (
    *("--headless=new", "--no-sandbox", "--no-first-run", "--disable-quic", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # in software
    "--ignore-gpu-blocklist",
)
PATIENCE = 180.0  # for a page to have drawn all, in software [s]
LOOK = 3.0  # between two looks that must be alike [s]
TAB_GAP = 9  # between two tabs; between a tab's sign and its name there is less [pixels]
TAB_WIDTH = 9  # at least; a frame beside the tabs is less [pixels]
INK = 40  # by which a letter's colour differs from what is behind it, of 255
HERE = ("127.0.0.1", "localhost")
# The viewer tells the console of every shader it makes; to hear it takes longer than to draw.
# Whether the pictures that a page is served for have come whole.
FETCHED = """document.documentElement.dataset.show.split(" ")
    .filter(place => place.startsWith("/"))
    .every(place => performance.getEntriesByName(location.origin + place).length > 0)"""
QUIET = "console.debug = () => {};"
_log = logging.getLogger("browser")


@dataclass(frozen=True, slots=True)
class Screen:
    """What a page is looked at on."""

    name: str
    width: int  # [CSS pixels]
    height: int  # [CSS pixels]
    is_phone: bool = False
    tab_bar: tuple[int, int] = (42, 62)  # rows of a picture [pixels]
    inner_bar: tuple[int, int] | None = None  # the same of the tabs inside a tab


DESK = Screen("desk", 1600, 1000)
PHONE = Screen("phone", 390, 844, is_phone=True, tab_bar=(7, 21), inner_bar=(35, 49))


@dataclass(slots=True)
class Heard:
    """What a browser says while a page is open."""

    complaints: list[str] = field(default_factory=list)  # errors, failed requests
    outside: list[str] = field(default_factory=list)  # addresses beyond this machine


def missing() -> str:
    """Why no page can be opened here; "" where one can."""
    if find_spec("playwright") is None:
        return "no Playwright: pip install 'pilewatch[browser]'"
    if shutil.which("chromium") is None:
        return "no chromium: apt-get install chromium"
    return ""


@contextmanager
def chromium() -> Iterator["Browser"]:
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=list(FLAGS)
        )
        try:
            yield browser
        finally:
            browser.close()


@contextmanager
def opened(
    browser: "Browser", address: str, screen: Screen = DESK, *, dark: bool = False
) -> Iterator[tuple["Page", Heard]]:
    """A page on a screen, and what the browser says of it."""
    context = browser.new_context(
        viewport={"width": screen.width, "height": screen.height},
        is_mobile=screen.is_phone,
        has_touch=screen.is_phone,
        color_scheme="dark" if dark else "light",
    )
    context.add_init_script(QUIET)
    page, heard = context.new_page(), Heard()
    listen(page, heard)
    try:
        page.goto(address, wait_until="load")
        yield page, heard
    finally:
        context.close()


def listen(page: Any, heard: Heard) -> None:
    """Note from now on what the browser says of a page."""
    page.on("console", lambda said: note_said(heard, said.type, said.text))
    page.on("pageerror", lambda error: heard.complaints.append(str(error)))
    page.on("requestfailed", lambda request: heard.complaints.append(f"failed: {request.url}"))
    page.on("request", lambda request: note_asked(heard, request.url))


def note_said(heard: Heard, kind: str, text: str) -> None:
    """Errors are complaints; warnings and news are not."""
    if kind == "error":
        heard.complaints.append(text)


def note_asked(heard: Heard, address: str) -> None:
    """Files, what a page holds in itself, and this machine are not outside."""
    place = urlsplit(address)
    if place.scheme not in ("file", "data", "blob") and place.hostname not in HERE:
        heard.outside.append(address)


def start_viewer(page: "Page") -> None:
    """Say yes where a narrow screen is asked first; wait until the viewer runs."""
    if is_asked := page.locator("#open").is_visible():
        page.locator("#open").tap()
    page.locator("#note").wait_for(state="hidden", timeout=1000 * PATIENCE)
    await_true(page, FETCHED)
    if is_asked:
        await_true(page, "window.narrow")  # has its narrow layout


def await_true(page: "Page", expression: str) -> None:
    """Wait until an expression is true; Playwright's own wait needs what the page's policy forbids.

    TimeoutError after PATIENCE.
    """
    deadline = time.monotonic() + PATIENCE
    while not page.evaluate(expression):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{page.url}: not within {PATIENCE:g} s: {expression}")
        page.wait_for_timeout(1000 * LOOK / 3)


def settled_picture(page: "Page") -> bytes:
    """A PNG of what does not change any more; TimeoutError after PATIENCE."""
    before, deadline = None, time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        now = (viewer_state(page), page.screenshot(full_page=True, timeout=1000 * PATIENCE))
        if now == before:
            return now[1]
        before = now
        page.wait_for_timeout(1000 * LOOK)
    raise TimeoutError(f"{page.url} still changes after {PATIENCE:g} s")


def viewer_state(page: "Page") -> Any:
    """What the viewer holds: recordings, how far they reach, where the cursor is."""
    return page.evaluate("window.viewer ? Array.from(viewer.viewer_state()) : null")


def overflow(page: "Page") -> int:
    """By how much a page is wider than its screen [CSS pixels]."""
    return int(page.evaluate("document.documentElement.scrollWidth - window.innerWidth"))


def n_colours(png: bytes) -> int:
    """How many colours a picture has: a page that still loads has few."""
    with Image.open(BytesIO(png)) as picture:
        return len(picture.convert("RGB").getcolors(maxcolors=2**24) or [])


@contextmanager
def served(place: str) -> Iterator[str]:
    """The address of an .html file, of pictures served for as long, or the address itself."""
    if place.startswith("http"):
        yield place
    elif place.endswith(".rrd"):
        page = WebPage(free_port(0), free_port(0))
        with serve_page(page, Path(place), narrow=narrow_layout) as shown:
            yield shown.address
    else:
        yield Path(place).resolve().as_uri()


def tab_places(png: bytes, rows: tuple[int, int]) -> list[int]:
    """Middles of the tabs in these rows of a picture: ink between gaps of TAB_GAP [pixels]."""
    with Image.open(BytesIO(png)) as picture:
        bar = np.asarray(picture.convert("L"), dtype=float)[slice(*rows)]
    inked = np.flatnonzero((np.abs(bar - np.median(bar)) > INK).any(axis=0))
    groups = np.split(inked, np.flatnonzero(np.diff(inked) > TAB_GAP) + 1)
    return [int(group.mean()) for group in groups if len(group) >= TAB_WIDTH]


def drawn_picture(page: "Page", screen: Screen) -> bytes:
    """The viewer's first picture with tabs that stays.

    While it loads, a slow machine stops for long at one without, or with a session's first second.
    """
    before, deadline = b"", time.monotonic() + PATIENCE
    while not tab_places(now := settled_picture(page), screen.tab_bar) or now != before:
        before = now
        page.wait_for_timeout(1000 * LOOK)
        if time.monotonic() > deadline:
            raise TimeoutError(f"{page.url} shows no tabs after {PATIENCE:g} s")
    return now


def tab_pictures(page: "Page", first: bytes, screen: Screen) -> Iterator[bytes]:
    """A picture of each tab behind the first, and of those inside it; a page has none."""
    for number, shown in enumerate(opened_tabs(page, first, screen.tab_bar)):
        if number:
            yield shown
        if screen.inner_bar:
            yield from list(opened_tabs(page, shown, screen.inner_bar))[1:]


def opened_tabs(page: "Page", shown: bytes, bar: tuple[int, int]) -> Iterator[bytes]:
    """What is shown, the first tab of a bar open, then a picture of each of the others."""
    with Image.open(BytesIO(shown)) as picture:  # of a narrow page, laid out wider, as wide as that
        scale = page.evaluate("window.innerWidth") / picture.width
    yield shown
    for x in tab_places(shown, bar)[1:]:
        page.mouse.click(x * scale, sum(bar) / 2 * scale)
        yield settled_picture(page)


def photograph(browser: "Browser", place: str, folder: Path, *, tabs: bool = False) -> bool:
    """Pictures of a page on every screen, dark and light; whether nothing was complained of."""
    is_good = True
    for screen in (DESK, PHONE):
        for dark in (True, False):
            name = f"{Path(place).stem}-{screen.name}-{'dark' if dark else 'light'}"
            with served(place) as address, opened(browser, address, screen, dark=dark) as seen:
                page, heard = seen
                if place.endswith(".html"):
                    picture = settled_picture(page)
                else:
                    start_viewer(page)
                    picture = drawn_picture(page, screen)
                (folder / f"{name}.png").write_bytes(picture)
                if tabs and not place.endswith(".html"):
                    for number, tab in enumerate(tab_pictures(page, picture, screen), 2):
                        (folder / f"{name}-{number}.png").write_bytes(tab)
                is_good &= _report(name, picture, heard, overflow(page))
    return is_good


def _report(name: str, picture: bytes, heard: Heard, too_wide: int) -> bool:
    wrong = [f"complaint: {each}" for each in heard.complaints]
    wrong += [f"asked outside: {each}" for each in heard.outside]
    if too_wide > 0:
        wrong.append(f"{too_wide} pixels wider than the screen")
    for each in wrong:
        _log.error("%s: %s", name, each)
    _log.info("%s: %d colours, %s", name, n_colours(picture), "WRONG" if wrong else "good")
    return not wrong


def main(arguments: list[str]) -> int:
    """Open the pages, or say why not."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if reason := missing():
        _log.warning("skipped: %s", reason)
        return 0
    tabs = arguments[0] == "--tabs"
    folder, *places = arguments[tabs:]
    Path(folder).mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        good = [photograph(browser, place, Path(folder), tabs=tabs) for place in places]
    return 0 if all(good) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
