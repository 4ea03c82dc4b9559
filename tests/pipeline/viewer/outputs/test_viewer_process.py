"""Viewers that live and die as processes of their own; the session never notices."""

import logging
import socket
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from pipeline.messages import Message, NodeStatus
from pipeline.nodes.node import NodeStatistics
from pipeline.offline.draw_recording import open_pictures
from pipeline.runtime.lock_step import run_lock_step
from pipeline.transport.codec import encode
from pipeline.viewer.outputs import viewer_process
from pipeline.viewer.outputs.outputs import ConnectedViewer, RrdFile, ViewerError, WebPage
from pipeline.viewer.outputs.viewer_process import (
    free_port,
    is_listening,
    proxy_address,
    serve_page,
    spawn_viewer,
    viewer_command,
)
from pipeline.viewer.viewer_node import Viewer
from tests.pipeline.viewer.content import Recorded
from tests.pipeline.viewer.session import DESCRIPTION, TURBINE, Episode, session

SIGNAL = f"/{TURBINE}/signals/tower/acceleration"
EPISODE = Episode(n_windows=1, block=60)


class Endpoint:
    """Takes connections on loopback as a viewer does, and can be killed; it understands nothing."""

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self._taken: list[socket.socket] = []
        self.reached = threading.Event()  # a session has sent something
        threading.Thread(target=self._serve, daemon=True).start()

    @property
    def output(self) -> ConnectedViewer:
        return ConnectedViewer(proxy_address(self._server.getsockname()[1]))

    def kill(self) -> None:
        """As the system does it: nothing listens any more, every connection is cut."""
        self._server.shutdown(socket.SHUT_RDWR)
        for connection in self._taken:
            connection.close()
        self._server.close()

    def _serve(self) -> None:
        while True:
            try:
                connection, _ = self._server.accept()
            except OSError:
                return
            self._taken.append(connection)
            threading.Thread(target=self._listen, args=(connection,), daemon=True).start()

    def _listen(self, connection: socket.socket) -> None:
        try:
            if connection.recv(1):
                self.reached.set()
        except OSError:
            return


class Listener:
    """A node beside the viewer; notes what reaches it, but for the nodes' own words."""

    name = "listener"
    inputs = tuple(kind for kind in Viewer.inputs if kind is not NodeStatus)
    statistics = NodeStatistics()

    def __init__(self) -> None:
        self.received: list[bytes] = []

    def handle(self, message: Message) -> tuple[Message, ...]:
        self.received.append(encode(message))
        return ()

    def close(self) -> None:
        """Nothing is held."""


def heard_beside(viewers: list[Viewer], messages: Iterable[Message]) -> list[bytes]:
    """The messages that another node of the same graph receives."""
    listener = Listener()
    run_lock_step(messages, [*viewers, listener], turbine=TURBINE)
    return listener.received


def until_killed(endpoint: Endpoint) -> Iterator[Message]:
    """The session; the viewer dies in the middle of it, once something has reached it."""
    messages = list(session(EPISODE))
    for number, message in enumerate(messages):
        if number == len(messages) // 2:
            assert endpoint.reached.wait(30.0)
            endpoint.kill()
        yield message


def test_a_viewer_that_is_killed_changes_nothing_for_anybody_else(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
):
    endpoint = Endpoint()
    path = tmp_path / "s.rrd"
    viewer = Viewer([RrdFile(path), endpoint.output], DESCRIPTION, session="s", strict=True)
    with caplog.at_level(logging.ERROR):
        beside_the_dead = heard_beside([viewer], until_killed(endpoint))
    assert not caplog.records  # a closed window is no error
    assert beside_the_dead == heard_beside([], session(EPISODE))
    alone = Viewer([RrdFile(tmp_path / "alone.rrd")], DESCRIPTION, session="s", strict=True)
    heard_beside([alone], session(EPISODE))
    drawn, expected = Recorded(path), Recorded(tmp_path / "alone.rrd")
    assert drawn.entities == expected.entities
    np.testing.assert_array_equal(drawn.scalars(SIGNAL), expected.scalars(SIGNAL))


def test_a_page_is_served_on_loopback_only_and_is_gone_afterwards():
    with serve_page(WebPage(free_port(0), free_port(0))) as shown:
        address = urlsplit(shown.address)
        page, headers = fetched(shown.address)
        assert f'data-show="{shown.output.url}"' in page.decode()
        assert (
            f"connect-src 'self' {origin_of(shown.output.url)};"
            in headers["Content-Security-Policy"]
        )
        assert fetched(f"{shown.address}re_viewer.js")[0].startswith(b"let wasm_bindgen")
        viewer = Viewer([shown.output], DESCRIPTION, session="s", wait_for_viewer=True, strict=True)
        for message in session(Episode(n_windows=1, block=60)):
            viewer.handle(message)
        viewer.close()
        ports = [address.port, urlsplit(shown.output.url).port]
        assert all(listening_addresses(port) == {"127.0.0.1"} for port in ports)
    assert not any(is_listening(port) for port in ports)


def origin_of(proxy: str) -> str:
    """http://127.0.0.1:9876 of rerun+http://127.0.0.1:9876/proxy."""
    return proxy.removeprefix("rerun+").removesuffix("/proxy")


def fetched(url: str) -> tuple[bytes, Mapping[str, str]]:
    """What a browser gets: content and headers."""
    with urllib.request.urlopen(url, timeout=20.0) as answer:
        return answer.read(), answer.headers


def listening_addresses(port: int) -> set[str]:
    """Local addresses on which a program listens at that port, as Linux lists them."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text("ascii").splitlines()[1:]:
            address, listening_port = line.split()[1].split(":")
            if line.split()[3] == "0A" and int(listening_port, 16) == port:
                found.add(
                    socket.inet_ntoa(bytes.fromhex(address)[::-1]) if len(address) == 8 else "v6"
                )
    return found


def test_a_port_that_another_program_has_is_replaced_for_a_page():
    with socket.create_server(("127.0.0.1", 0)) as other:
        taken = other.getsockname()[1]
        assert free_port(taken) != taken
    assert free_port(taken) == taken


def test_a_page_has_its_port_again_though_a_link_of_the_last_one_has_just_ended():
    with socket.create_server(("127.0.0.1", 0)) as last:
        port = last.getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as browser:
            last.accept()[0].close()  # by the page, so that the system keeps the link for a while
            assert browser.recv(1) == b""
    assert free_port(port) == port


def test_a_window_on_a_port_in_use_is_one_line_with_the_alternative():
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(ViewerError, match=rf"port {port} is in use; .*--view connect=rerun"):
            spawn_viewer(port)


def test_a_viewer_that_ends_at_once_is_one_line(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(viewer_process.sys, "executable", "/bin/false")
    with pytest.raises(ViewerError, match=r"--view spawn: the viewer ended at once.*display\?"):
        spawn_viewer(free_port(0))
    with (
        pytest.raises(ViewerError, match=r"--view web: the viewer ended at once"),
        serve_page(WebPage(free_port(0), free_port(0))),
    ):
        pass


STUBBORN_CHILD = """
import signal, socket, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
server = socket.create_server(("127.0.0.1", {port}))
print("listens", flush=True)
time.sleep(60)
"""
PARENT = "import subprocess, sys; subprocess.run([sys.executable, '-c', sys.argv[1]])"


@pytest.mark.skipif(sys.platform == "win32", reason="there are no process groups there")
def test_a_viewers_child_that_holds_its_port_is_killed_after_the_viewer_itself_has_ended(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(viewer_process, "SERVER_STOP_TIMEOUT", 0.3)
    port = free_port(0)
    child = STUBBORN_CHILD.format(port=port)
    command = [sys.executable, "-c", PARENT, child]
    with subprocess.Popen(command, start_new_session=True, stdout=subprocess.PIPE) as viewer:
        assert viewer.stdout is not None
        assert viewer.stdout.readline() == b"listens\n"
        viewer_process._stop(viewer, port)
        assert not is_listening(port)


def test_every_viewer_and_server_that_is_started_has_a_limit_of_memory(monkeypatch, tmp_path):
    started: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        started.append(command)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr("pipeline.offline.draw_recording.subprocess.run", run)
    (tmp_path / "a.rrd").touch()
    open_pictures(tmp_path / "a.rrd")
    for command in (*started, viewer_command("--serve-web"), viewer_command("--port", "9876")):
        assert command[command.index("--memory-limit") + 1] == "4GiB"
        assert command[command.index("--server-memory-limit") + 1] == "1GiB"
    sources = [
        path.read_text("utf-8") for path in Path(viewer_process.__file__).parents[2].rglob("*.py")
    ]
    assert sum(text.count('"-m", "rerun"') for text in sources) == 1  # no other way to start one
