"""The page for browsers: what it serves, to whom it lets the browser speak."""

import re
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

from pipeline.viewer.outputs.page_server import content_policy, page_contents, run_page_server
from pipeline.viewer.outputs.viewer_process import free_port

SESSION = "rerun+http://127.0.0.1:9876/proxy"


class Assets(BaseHTTPRequestHandler):
    """Stands in for Rerun's own web server."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "application/wasm")
        self.end_headers()
        self.wfile.write(b"\0asm of " + self.path.encode())

    def log_message(self, *_: object) -> None:
        """Not a word."""


@contextmanager
def page(pictures: tuple[Path, ...] = (), narrow: bytes = b"") -> Iterator[str]:
    """The address of a page whose viewer comes from a stand-in."""
    assets = ThreadingHTTPServer(("127.0.0.1", 0), Assets)
    Thread(target=assets.serve_forever, daemon=True).start()
    port = free_port(0)
    options = {"session": SESSION, "assets_port": assets.server_port, "pictures": pictures}
    options["narrow"] = lambda: narrow
    with run_page_server(port, **options):
        yield f"http://127.0.0.1:{port}"
    assets.shutdown()
    assets.server_close()


def fetched(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=20.0) as answer:
        return answer.read()


def test_the_viewer_itself_comes_from_reruns_server():
    with page() as address:
        assert fetched(f"{address}/re_viewer_bg.wasm") == b"\0asm of /re_viewer_bg.wasm"


def test_pictures_are_served_whole_and_opened_instead_of_the_session(tmp_path: Path):
    rrd = tmp_path / "a.rrd"
    rrd.write_bytes(b"RRF2" * 1000)
    with page((rrd,)) as address:
        assert 'data-show="/0.rrd"' in fetched(address).decode()
        assert fetched(f"{address}/0.rrd") == rrd.read_bytes()


def test_a_narrow_screen_gets_a_layout_where_there_is_one():
    with page(narrow=b"RRF2") as address:
        assert fetched(f"{address}/narrow.rbl") == b"RRF2"
    with page() as address, pytest.raises(urllib.error.HTTPError, match="404"):
        fetched(f"{address}/narrow.rbl")


@pytest.mark.parametrize("path", ["/1.rrd", "/../../pyproject.toml", "/sw.js", "/etc/passwd"])
def test_nothing_else_is_served(path: str, tmp_path: Path):
    (tmp_path / "a.rrd").write_bytes(b"RRF2")
    with (
        page((tmp_path / "a.rrd",)) as address,
        pytest.raises(urllib.error.HTTPError, match="404"),
    ):
        fetched(address + path)


def test_a_page_of_another_host_name_is_refused():
    with page() as address:
        assert fetched(address.replace("127.0.0.1", "localhost"))
        request = urllib.request.Request(address, headers={"Host": "elsewhere.example:80"})
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(request, timeout=20.0)


def test_the_browser_may_connect_to_the_page_and_the_session_only():
    policy = content_policy([SESSION])
    assert "default-src 'none'" in policy
    assert "connect-src 'self' http://127.0.0.1:9876;" in policy
    assert "*" not in policy
    assert "connect-src 'self';" in content_policy(["/0.rrd"])


def test_the_page_names_no_address_outside_this_machine():
    for content, _ in page_contents([SESSION]).values():
        hosts = set(re.findall(r"https?://([^/\s\"']+)", content.decode()))
        assert {host.split(":")[0] for host in hosts} <= {"127.0.0.1"}


def test_an_address_cannot_break_out_of_its_place_in_the_page():
    text = page_contents(['"><script>alert(1)</script>'])["/"][0].decode()
    assert "<script>alert" not in text


def test_nothing_is_kept_by_the_browser_for_another_session():
    with page() as address:
        for path in ("", "/re_viewer_bg.wasm"):
            with urllib.request.urlopen(address + path, timeout=20.0) as answer:
                assert answer.headers["Cache-Control"] == "no-cache"
