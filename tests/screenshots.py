"""Pictures of a session, made without a screen: python -m tests.screenshots FILE.rrd FOLDER [TAB …]

One PNG per tab, also of those inside a tab that are not open at first (the MAC matrix); of the tabs
named, or of all. Rerun draws with Vulkan; in software Debian's mesa-vulkan-drivers and libvulkan1
do (apt-get install mesa-vulkan-drivers libvulkan1). Without them the script says so and makes none.
"""

import contextlib
import ctypes.util
import logging
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from pipeline.viewer.pictures import colours

WINDOW_SIZE = "1600x1000"  # [pixels]
PATIENCE = 60.0  # for a viewer to come up on a slow machine [s]
SETTLING = 2.0  # between two pictures that are the same when a tab is finished [s]
SHADES = 256  # of a picture's palette: enough for flat surfaces and lines
EXPECTED = {  # colours that data, not decoration, fill in each tab
    "Overview": (colours.POSTERIOR, colours.MODEL),
    "Signals": (colours.LEVELS[2], colours.LEVELS[3], colours.NEUTRAL),
    "Modes": (colours.MEASURED, colours.MODEL),
    "Foundation": (colours.POSTERIOR,),
    "All turbines": (colours.LEVELS[0], colours.LEVELS[1]),
}
_log = logging.getLogger("screenshots")


def missing() -> str:
    """Why no picture can be made here; "" where it can."""
    if ctypes.util.find_library("vulkan") is None:
        return "no Vulkan loader: apt-get install mesa-vulkan-drivers libvulkan1"
    drivers = [Path("/usr/share/vulkan/icd.d"), Path("/etc/vulkan/icd.d")]
    if not any(folder.is_dir() and any(folder.iterdir()) for folder in drivers):
        return "no Vulkan driver: apt-get install mesa-vulkan-drivers"
    return ""


@contextmanager
def headless_viewer() -> Iterator[Any]:
    """A viewer without a window on a free loopback port; gone at the end."""
    from rerun.experimental import ViewerClient

    port = _free_port()
    with tempfile.TemporaryDirectory() as runtime:
        command = [sys.executable, "-m", "rerun", "--headless", "--window-size", WINDOW_SIZE]
        command += ["--bind", "127.0.0.1", "--port", str(port), "--expect-data-soon"]
        viewer = subprocess.Popen(
            command,
            env=os.environ | {"RERUN_ANALYTICS": "0", "XDG_RUNTIME_DIR": runtime},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        try:
            _await(port, viewer)
            yield ViewerClient.connect(f"rerun+http://127.0.0.1:{port}/proxy")
        finally:
            os.killpg(viewer.pid, signal.SIGTERM)
            viewer.wait(timeout=20)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _await(port: int, viewer: "subprocess.Popen[bytes]") -> None:
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        if viewer.poll() is not None:
            raise RuntimeError(f"the viewer ended with exit code {viewer.returncode}")
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                return
        time.sleep(0.1)
    raise TimeoutError(f"no viewer on port {port} after {PATIENCE:g} s")


def take(rrd: Path, folder: Path, *wanted: str) -> dict[str, Path]:
    """One PNG of each tab of a .rrd, the cursor at the session's end; tab's name → file.

    wanted   what the names of tabs begin with; none: all

    Raises ValueError for a tab that there is not, or that lacks the colours of what it shows.
    """
    pictures = {}
    with headless_viewer() as viewer:
        viewer.open(str(rrd.resolve()))
        end = _loaded_until(viewer)
        viewer.set_time(timeline="time", timestamp=np.datetime64(end, "ns"), play_state="paused")
        layout = _laid_out(viewer).blueprint  # read once: the viewer rewrites what it shows
        there = [*tabs(layout), *inner_tabs(layout)]
        for tab in [_begun(name, there) for name in wanted] or there:
            show_tab(viewer, layout, tab)
            pictures[tab] = folder.resolve() / f"{file_name(tab)}.png"
            _save_settled(viewer, pictures[tab])
            if "Foundation" in there or "All turbines" in there:  # modes alone: any few sensors
                _require_content(tab, pictures[tab])
            _shrink(pictures[tab])
    return pictures


def _loaded_until(viewer: Any) -> int:
    """Where the time ends of the recording that was opened, once it does not move any more."""
    before, deadline = None, time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        recordings = viewer.get_state().recordings
        lines = recordings[0].timelines if recordings else ()
        end = next((line.end for line in lines if line.name == "time"), None)
        if end is not None and end == before:
            return int(end)
        before = end
        time.sleep(SETTLING / 4)
    raise TimeoutError(f"no recording with a time after {PATIENCE:g} s")


def _begun(name: str, there: list[str]) -> str:
    """The first tab whose name begins so."""
    for tab in there:
        if tab.startswith(name):
            return tab
    raise ValueError(f"no tab's name begins with {name!r}; there are {', '.join(there)}")


def _save_settled(viewer: Any, png: Path) -> None:
    """A picture of what does not change any more; after PATIENCE of what there is by then.

    The viewer does not say when it has drawn everything, but shows moving dots until then.
    """
    before, deadline = b"", time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        time.sleep(SETTLING)
        viewer.save_screenshot(str(png))
        with Image.open(png) as picture:
            now = picture.convert("RGB").tobytes()
        if now == before:
            return
        before = now
    _log.warning("%s: still changing after %g s", png, PATIENCE)


def _require_content(tab: str, png: Path) -> None:
    """ValueError for a picture that lacks the colours of what its tab shows."""
    present = filled_colours(png)
    lacking = [colour for colour in EXPECTED.get(tab, ()) if colour not in present]
    if lacking:
        raise ValueError(f"{png}: tab {tab} shows nothing in {lacking}; is its data missing?")


def _shrink(png: Path) -> None:
    """A fifth of the bytes."""
    with Image.open(png) as picture:
        small = picture.convert("RGB").quantize(
            SHADES, method=Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE
        )
    small.save(png, optimize=True)


def _laid_out(viewer: Any) -> Any:
    """The blueprint, once the viewer has taken all of it."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        blueprint = viewer.get_blueprint()
        with contextlib.suppress(StopIteration):
            _top(_containers(blueprint.blueprint))
            return blueprint
        time.sleep(0.2)
    raise TimeoutError(f"no blueprint with tabs after {PATIENCE:g} s")


def tabs(blueprint: dict[str, Any]) -> list[str]:
    """Names of the outermost tabs, in order."""
    containers = _containers(blueprint)
    top = _top(containers)
    return [containers["/" + path]["display_name"] for path in top["contents"]]


def inner_tabs(blueprint: dict[str, Any]) -> list[str]:
    """Names of views that lie in tabs inside the outermost ones and are not open at first."""
    names = _names(blueprint)
    return [names[path] for one in _inner(blueprint) for path in one["contents"][1:]]


def show_tab(viewer: Any, blueprint: dict[str, Any], name: str) -> None:
    """Bring one tab of a blueprint to the front, and those that it lies in."""
    names, containers = _names(blueprint), _containers(blueprint)
    path: str | None = next(path for path in names if names[path] == name)
    while path is not None:
        holder = next((at for at, one in containers.items() if path in one["contents"]), None)
        if holder is not None and containers[holder].get("container_kind") == "Tabs":
            containers[holder]["active_tab"] = path
        path = None if holder is None else holder.removeprefix("/")
    viewer.set_blueprint(blueprint, of="recording")


def file_name(tab: str) -> str:
    """The tab's first words, without signs."""
    words = tab.split(":")[0].lower().split()
    return "-".join(word for word in words if word.replace("-", "").isalnum())


def _inner(blueprint: dict[str, Any]) -> list[dict[str, Any]]:
    containers = _containers(blueprint)
    top = _top(containers)
    return [
        one
        for one in containers.values()
        if one is not top and one.get("container_kind") == "Tabs" and one["contents"]
    ]


def _names(blueprint: dict[str, Any]) -> dict[str, str]:
    """Path, without its first stroke, → name of every container and view that has one."""
    return {
        path.removeprefix("/"): part["display_name"]
        for path, entity in blueprint.items()
        for part in entity.values()
        if isinstance(part, dict) and part.get("display_name")
    }


def _top(containers: dict[str, Any]) -> dict[str, Any]:
    """The outermost tabs: of one turbine, or all turbines and each; StopIteration without any."""
    held = {"/" + path for one in containers.values() for path in one["contents"]}
    return next(
        one
        for name, one in containers.items()
        if name not in held and one.get("container_kind") == "Tabs"
    )


def _containers(blueprint: dict[str, Any]) -> dict[str, Any]:
    return {
        path: entity["ContainerBlueprint"]
        for path, entity in blueprint.items()
        if "ContainerBlueprint" in entity
    }


def filled_colours(png: Path, *, at_least: int = 30) -> set[tuple[int, int, int]]:
    """Colours (red, green, blue) that fill at least so many pixels of a picture."""
    with Image.open(png) as picture:
        counts = picture.convert("RGB").getcolors(maxcolors=2**24) or []
    return {colour for count, colour in counts if count >= at_least and isinstance(colour, tuple)}


def main(arguments: list[str]) -> None:
    """Take the pictures, or say why not."""
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    if reason := missing():
        _log.warning("skipped: %s", reason)
        return
    if len(arguments) < 2:
        sys.exit(str(__doc__))
    rrd, folder = map(Path, arguments[:2])
    folder.mkdir(parents=True, exist_ok=True)
    try:
        taken = take(rrd, folder, *arguments[2:])
    except ValueError as error:
        sys.exit(str(error))
    for tab, picture in taken.items():
        _log.info("%s: %s, %.0f kB", tab, picture, picture.stat().st_size / 1e3)


if __name__ == "__main__":
    main(sys.argv[1:])
