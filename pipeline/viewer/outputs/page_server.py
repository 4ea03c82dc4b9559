"""Serve pilewatch's own page with Rerun's viewer to browsers, on loopback only.

Why not Rerun's page: it asks the internet for a font, example recordings and its newest release,
and reports to its makers how it is used, with no way to opt out. This page connects to the session
only; its content policy forbids the browser every other connection.
"""

import http.client
import logging
import shutil
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from html import escape
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from sensors.constants import LOOPBACK

if TYPE_CHECKING:
    from _typeshed import SupportsRead

PAGE_FILES = {  # path → file of this package, its type
    "/": ("page.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    "/page.js": ("page.js", "text/javascript; charset=utf-8"),
}
VIEWER_FILES = ("/re_viewer.js", "/re_viewer_bg.wasm")  # the viewer itself, from Rerun's own server
NARROW_LAYOUT = "/narrow.rbl"
HOST_NAMES = (LOOPBACK, "localhost")  # by which a browser on this machine may call the page
ANSWER_TIMEOUT = 10.0  # for Rerun's server to answer [s]
_log = logging.getLogger(__name__)


@contextmanager
def run_page_server(
    page_port: int,
    *,
    session: str,
    assets_port: int,
    pictures: Sequence[Path] = (),
    narrow: Callable[[], bytes] = bytes,
) -> Iterator[None]:
    """Serve the page for as long as the context lasts.

    Parameters
    ----------
    session : str
        Where a session is sent to, rerun+http://127.0.0.1:9876/proxy; shown where there are no
        pictures.
    assets_port : int
        Of Rerun's own web server on this machine.
    pictures : Sequence[Path], optional
        .rrd files to show.
    narrow : Callable[[], bytes], optional
        Returns the layout for a narrow screen, a .rbl; b"" while there is none.

    Raises
    ------
    OSError
        If the port is taken.
    """
    narrow_layout = narrow
    places = {f"/{number}.rrd": path for number, path in enumerate(pictures)}
    shown = tuple(places) or (session,)

    class Handler(PageRequest):
        """Serves this page's content."""

        contents = page_contents(shown)
        policy = content_policy(shown)
        rrds = places
        assets = assets_port
        narrow = staticmethod(narrow_layout)

    server = ThreadingHTTPServer((LOOPBACK, page_port), Handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, name="page", daemon=True).start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()


def page_contents(shown: Sequence[str]) -> dict[str, tuple[bytes, str]]:
    """Return path → (bytes, type) of the package's files.

    Parameters
    ----------
    shown : Sequence[str]
        What the page opens: addresses of sessions, paths on this server.
    """
    folder = files(__package__) / "web"
    texts = {path: (folder / name).read_text("utf-8") for path, (name, _) in PAGE_FILES.items()}
    texts["/"] = texts["/"].replace("ADDRESSES", escape(" ".join(shown)), 1)
    return {path: (texts[path].encode(), kind) for path, (_, kind) in PAGE_FILES.items()}


def content_policy(shown: Sequence[str]) -> str:
    """Return the content security policy: the page itself and what it draws, nothing else."""
    places = [urlsplit(address.removeprefix("rerun+")) for address in shown]
    origins = "".join(f" {place.scheme}://{place.netloc}" for place in places if place.netloc)
    return (
        "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; "
        "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
        f"connect-src 'self'{origins}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    )


class PageRequest(BaseHTTPRequestHandler):
    """One request of a browser."""

    contents: dict[str, tuple[bytes, str]]
    policy: str
    rrds: dict[str, Path]
    assets: int
    narrow: Callable[[], bytes]

    def do_GET(self) -> None:
        """Serve the page's files, its .rrd files and the viewer of Rerun's server only."""
        path = urlsplit(self.path).path
        try:
            if urlsplit(f"//{self.headers.get('Host', '')}").hostname not in HOST_NAMES:
                # Why: another page could resolve its own name to this address and read the content.
                self.send_error(HTTPStatus.FORBIDDEN)
            elif path in self.contents:
                content, kind = self.contents[path]
                self._send(BytesIO(content), len(content), kind)
            elif path in self.rrds:
                with self.rrds[path].open("rb") as rrd:
                    self._send(rrd, self.rrds[path].stat().st_size, "application/octet-stream")
            elif path == NARROW_LAYOUT and (content := self.narrow()):
                self._send(BytesIO(content), len(content), "application/octet-stream")
            elif path in VIEWER_FILES:
                self._forward_to_rerun(path)
            else:
                self.send_error(HTTPStatus.NOT_FOUND)
        except (OSError, http.client.HTTPException) as error:
            # Why debug only: the browser closed the connection, or a viewer is stopping.
            _log.debug("%s not served: %s", path, error)
            self.close_connection = True

    def _forward_to_rerun(self, path: str) -> None:
        with closing(
            http.client.HTTPConnection(LOOPBACK, self.assets, timeout=ANSWER_TIMEOUT)
        ) as rerun:
            rerun.request("GET", path)
            answer = rerun.getresponse()
            self._send(answer, None, answer.headers["Content-Type"])

    def _send(self, content: "SupportsRead[bytes]", length: int | None, kind: str) -> None:
        """Without a length, the end of the connection ends the content."""
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", kind)
        if length is not None:
            self.send_header("Content-Length", str(length))
        self.send_header("Content-Security-Policy", self.policy)
        self.send_header("Cache-Control", "no-cache")
        self.end_headers()
        shutil.copyfileobj(content, self.wfile)

    def log_message(self, format: str, *args: object) -> None:  # noqa: A002 (its name)
        """Log requests at debug level only."""
        _log.debug(format, *args)
