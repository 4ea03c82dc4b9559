"""Viewers as processes of their own: a window, or a page for browsers. Both on loopback only.

Why a process: the SDK's own servers listen on every interface and die with what they show; a
process that crashes, hangs or runs out of memory takes nothing with it. Its server keeps what it
was sent (up to MEMORY, the oldest goes first), so a browser may come late, go and come back.
"""

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from pipeline.viewer.outputs.outputs import (
    ConnectedViewer,
    ShownPage,
    ViewerError,
    WebPage,
    require_rerun,
)
from pipeline.viewer.outputs.page_server import LOOPBACK, serving_page

MEMORY = "1GiB"  # of messages kept for browsers that come late: about ten days of one turbine
START_PATIENCE = 20.0  # for a viewer to come up [s]
STOP_PATIENCE = 5.0  # for a page's server to end [s]
INSTEAD = "a session is written to session.rrd without --view"


def spawn_viewer(port: int, *, headless: bool = False) -> str:
    """Start a viewer's window that outlives this process; its address.

    `rr.spawn` has no say in the interface and would listen on all of them. Raises ViewerError
    where the port is taken, by another viewer or another program, and where no window comes up.
    """
    if is_listening(port):
        raise ViewerError(
            f"--view spawn: port {port} is in use; close the viewer that has it, or show the "
            f"session in it with --view connect={proxy_address(port)}"
        )
    options = ["--port", str(port), "--expect-data-soon", "--hide-welcome-screen"]
    viewer = _started(options + ["--headless"] * headless)
    _await_listening(viewer, port, "--view spawn", doubt="; is there a display?")
    return proxy_address(port)


@contextmanager
def served_page(page: WebPage, *pictures: Path) -> Iterator[ShownPage]:
    """A page for browsers, for as long as the context lasts; free ports where the usual are taken.

    pictures   .rrd files that it shows from the beginning

    Raises ViewerError where rerun is missing or the server does not come up.
    """
    require_rerun((page,))
    port, page_port, assets_port = free_port(page.port), free_port(page.page_port), free_port(0)
    # The pictures are not for this server: given a file, that of 0.41 keeps a core busy for ever.
    options = ["--serve-web", "--port", str(port), "--web-viewer-port", str(assets_port)]
    server = _started([*options, "--server-memory-limit", MEMORY])
    session = proxy_address(port)
    try:
        for each in (port, assets_port):
            _await_listening(server, each, page.option)
        with serving_page(page_port, session=session, assets_port=assets_port, pictures=pictures):
            yield ShownPage(ConnectedViewer(session), f"http://{LOOPBACK}:{page_port}/")
    finally:
        _stop(server, port, assets_port)


def proxy_address(port: int) -> str:
    """Where a session is sent to."""
    return f"rerun+http://{LOOPBACK}:{port}/proxy"


def free_port(preferred: int) -> int:
    """That port where nobody has it, else one that is free."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the server will take it
        try:
            probe.bind((LOOPBACK, preferred))
        except OSError:
            probe.bind((LOOPBACK, 0))
        return int(probe.getsockname()[1])


def is_listening(port: int) -> bool:
    """Whether a program answers on that port of this machine."""
    with socket.socket() as probe:
        return probe.connect_ex((LOOPBACK, port)) == 0


def _started(options: list[str]) -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        [sys.executable, "-m", "rerun", "--bind", LOOPBACK, *options],
        env=os.environ | {"RERUN_ANALYTICS": "0"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the pipeline, which ends first
    )


def _await_listening(
    viewer: "subprocess.Popen[bytes]", port: int, option: str, doubt: str = ""
) -> None:
    deadline = time.monotonic() + START_PATIENCE
    while not is_listening(port):
        if viewer.poll() is not None:
            raise ViewerError(
                f"{option}: the viewer ended at once (exit code {viewer.returncode}){doubt}; "
                f"{INSTEAD}"
            )
        if time.monotonic() > deadline:
            _stop(viewer)
            raise ViewerError(
                f"{option}: no viewer on port {port} after {START_PATIENCE:g} s; {INSTEAD}"
            )
        time.sleep(0.05)


def _stop(viewer: "subprocess.Popen[bytes]", *ports: int) -> None:
    """End it and what it started, until its ports are free.

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
    """Whether, within STOP_PATIENCE, it ends and nobody listens any more."""
    deadline = time.monotonic() + STOP_PATIENCE
    try:
        viewer.wait(STOP_PATIENCE)
    except subprocess.TimeoutExpired:
        return False
    while any(map(is_listening, ports)):
        if time.monotonic() > deadline:
            return False
        time.sleep(0.05)
    return True
