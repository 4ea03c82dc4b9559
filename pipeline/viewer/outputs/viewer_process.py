"""Start viewers as processes of their own: a window, or a page for browsers, on loopback only.

Why a process: the SDK's own servers listen on every interface and die with what they show; a
process that crashes, hangs or runs out of memory takes nothing with it. Its server keeps what it
was sent (up to SERVER_MEMORY, the oldest goes first), so a browser may come late, go and come back.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from pipeline.viewer.outputs.outputs import (
    ConnectedViewer,
    ServedPage,
    ViewerError,
    WebPage,
    require_rerun,
)
from pipeline.viewer.outputs.page_server import run_page_server
from sensors.constants import LOOPBACK

SERVER_MEMORY = (
    "1GiB"  # of messages kept for browsers that come late: about ten days of one turbine
)
VIEWER_MEMORY = "4GiB"  # of a viewer's window, which by itself takes 75 % of the machine's
VIEWER_START_TIMEOUT = 20.0  # for a viewer to come up [s]
SERVER_STOP_TIMEOUT = 5.0  # for a page's server to end [s]
ALTERNATIVE = "a session is written to session.rrd without --view"


def spawn_viewer(port: int) -> str:
    """Start a viewer's window that outlives this process; return its address.

    `rr.spawn` cannot choose the interface and listens on all of them.

    Raises
    ------
    ViewerError
        If the port is taken, by another viewer or another program, and where no window comes
        up.
    """
    if is_listening(port):
        raise ViewerError(
            f"--view spawn: port {port} is in use; close the viewer that uses it, or draw the "
            f"session in it with --view connect={proxy_address(port)}"
        )
    options = ["--port", str(port), "--expect-data-soon", "--hide-welcome-screen"]
    viewer = _start_process(options)
    _await_listening(viewer, port, "--view spawn", warning="; is there a display?")
    return proxy_address(port)


@contextmanager
def serve_page(
    page: WebPage, *pictures: Path, narrow: Callable[[Path], bytes] = lambda _: b""
) -> Iterator[ServedPage]:
    """A page for browsers, for as long as the context lasts, on free ports if the usual are in use.

    Parameters
    ----------
    pictures : Path
        .rrd files to open at the start.
    narrow : Callable, optional
        Makes the layout for a narrow screen, a .rbl, from a .rrd or from `ConnectedViewer.views`;
        b"" where it cannot.

    Raises
    ------
    ViewerError
        If rerun is missing or the server does not come up.
    """
    require_rerun((page,))
    port, page_port, assets_port = free_port(page.port), free_port(page.page_port), free_port(0)
    # The pictures are not for this server: given a file, that of 0.41 keeps a core busy for ever.
    options = ["--serve-web", "--port", str(port), "--web-viewer-port", str(assets_port)]
    server = _start_process(options)
    session = proxy_address(port)
    try:
        for each in (port, assets_port):
            _await_listening(server, each, page.option)
        with TemporaryDirectory() as folder:
            views = Path(folder) / "views.json"
            with run_page_server(
                page_port,
                session=session,
                assets_port=assets_port,
                pictures=pictures,
                narrow=lambda: narrow(pictures[0] if pictures else views),
            ):
                address = f"http://{LOOPBACK}:{page_port}/"
                yield ServedPage(ConnectedViewer(session, views), address)
    finally:
        _stop(server, port, assets_port)


def proxy_address(port: int) -> str:
    """Return the address to which a session is sent."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def free_port(preferred: int) -> int:
    """Return the preferred port if it is free, else any free one."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server will take it
        try:
            probe.bind((LOOPBACK, preferred))
        except OSError:
            probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def is_listening(port: int) -> bool:
    """Return whether a program listens on that port of this machine."""
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0


def viewer_command(*options: str) -> list[str]:
    """Return the command that starts a viewer or a server with it, its memory limited."""
    limits = ("--memory-limit", VIEWER_MEMORY, "--server-memory-limit", SERVER_MEMORY)
    return [sys.executable, "-m", "rerun", "--bind", LOOPBACK, *limits, *options]


def _start_process(options: list[str]) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        viewer_command(*options),
        env=os.environ | {"RERUN_ANALYTICS": "0"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the pipeline, which ends first
    )


def _await_listening(
    viewer: "subprocess.Popen[bytes]", port: int, option: str, warning: str = ""
) -> None:
    deadline = time.monotonic() + VIEWER_START_TIMEOUT
    while not is_listening(port):
        if viewer.poll() is not None:
            raise ViewerError(
                f"{option}: the viewer ended at once (exit code {viewer.returncode}){warning}; "
                f"{ALTERNATIVE}"
            )
        if time.monotonic() > deadline:
            _stop(viewer)
            raise ViewerError(
                f"{option}: no viewer on {port} after {VIEWER_START_TIMEOUT:g} s; {ALTERNATIVE}"
            )
        time.sleep(0.05)


def _stop(viewer: "subprocess.Popen[bytes]", *ports: int) -> None:
    """Stop it and its children, until its ports are free.

    `python -m rerun` runs the viewer as its child, which may outlive it by a moment.
    """
    if sys.platform == "win32":  # no process groups there
        viewer.terminate()
        _has_ended(viewer, ports)
        return
    for name in (signal.SIGTERM, signal.SIGKILL):
        try:
            os.killpg(viewer.pid, name)
        except ProcessLookupError:
            return
        if _has_ended(viewer, ports):
            return


def _has_ended(viewer: "subprocess.Popen[bytes]", ports: tuple[int, ...]) -> bool:
    """Return whether, within SERVER_STOP_TIMEOUT, it ends and its ports are free."""
    deadline = time.monotonic() + SERVER_STOP_TIMEOUT
    try:
        viewer.wait(SERVER_STOP_TIMEOUT)
    except subprocess.TimeoutExpired:
        return False
    while any(map(is_listening, ports)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True
