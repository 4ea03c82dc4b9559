"""Where drawings go: a file, a viewer to be started, a running viewer, a web page.

Importable without rerun; `require_rerun` reports in one line what is missing.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from sensors.errors import InputError

DEFAULT_PORT = 9876  # the Rerun viewer's own [-]
VIEWS_WORD = ",views="  # between the address of a served page's viewer and its file, for a node
DEFAULT_PAGE_PORT = 9090  # the web viewer's own [-]


class ViewerError(InputError):
    """A viewer that is not available: rerun missing, a wrong address, a port in use."""


@dataclass(frozen=True, slots=True)
class RrdFile:
    """A headless recording, to be opened later with `rerun FILE`."""

    path: Path

    indexed: bool = True
    """Whether the file ends with an index of its chunks, for which rerun keeps 1.3 kB of each in
    memory until then: 1 GB at the end of a day of 100 turbines. Viewers open files without one."""

    @property
    def option(self) -> str:
        """The output as given on the command line."""
        return f"--rrd {self.path}"


@dataclass(frozen=True, slots=True)
class SpawnedViewer:
    """A viewer window started on this machine; it outlives the session and listens on loopback."""

    port: int = DEFAULT_PORT

    @property
    def option(self) -> str:
        """The output as given on the command line."""
        return "--view spawn"


@dataclass(frozen=True, slots=True)
class ConnectedViewer:
    """A viewer that already runs at `url`, e.g. rerun+http://127.0.0.1:9876/proxy."""

    url: str
    views: Path | None = None
    """File for what the session's layout is made from, of a page that is served."""

    @property
    def option(self) -> str:
        """The output as given on the command line."""
        return f"--view connect={self.url}"

    @property
    def word(self) -> str:
        """What `parse_view` reads this output from."""
        return f"connect={self.url}" + (f"{VIEWS_WORD}{self.views}" if self.views else "")


ViewerOutput = RrdFile | SpawnedViewer | ConnectedViewer


@dataclass(frozen=True, slots=True)
class WebPage:
    """A page to be served to browsers on this machine; `viewer_process.serve_page` does it.

    Ports in use are replaced by free ones.
    """

    port: int = DEFAULT_PORT
    """Port to which the session is sent."""
    page_port: int = DEFAULT_PAGE_PORT
    """Port at which the browser finds the page."""

    @property
    def option(self) -> str:
        """The output as given on the command line."""
        return "--view web"


@dataclass(frozen=True, slots=True)
class ServedPage:
    """A page being served."""

    output: ConnectedViewer
    """Viewer that the session draws on."""
    address: str
    """Address for a browser, http://…."""


def parse_view(text: str) -> SpawnedViewer | ConnectedViewer | WebPage:
    """Parse `--view spawn`, `web` or `connect=URL`; raise ViewerError for anything else."""
    if text == "spawn":
        return SpawnedViewer()
    if text == "web":
        return WebPage()
    word, _, rest = text.partition("=")
    url, _, views = rest.partition(VIEWS_WORD)
    if word == "connect" and _is_viewer_address(url):
        return ConnectedViewer(url, Path(views) if views else None)
    if word == "connect":
        raise ViewerError(
            f"--view connect={url}: not the address of a Rerun viewer, "
            f"such as connect=rerun+http://127.0.0.1:{DEFAULT_PORT}/proxy"
        )
    raise ViewerError(f"--view {text}: none of 'spawn', 'web' and 'connect=URL'")


def _is_viewer_address(url: str) -> bool:
    schemes = ("rerun://", "rerun+http://", "rerun+https://")
    return url.startswith(schemes) and url.endswith("/proxy")


def require_rerun(outputs: tuple[ViewerOutput | WebPage, ...]) -> None:
    """Raise ViewerError where rerun is not installed, naming the option that needs it."""
    if find_spec("rerun") is None:
        needed_for = " and ".join(output.option for output in outputs)
        raise ViewerError(
            f"rerun-sdk is not installed (needed for {needed_for}): "
            "pip install rerun-sdk, or run with --no-rrd"
        )


def prepare_rerun(outputs: Sequence[ViewerOutput]) -> None:
    """Set what rerun reads from the environment while it is loaded, which comes after this.

    Its allocator, mimalloc, gives freed pages back to the system at once: else the file of a farm
    of four grew a process by 50 MB in ten hours of measurements. That a file has no index is no
    warning. What the environment sets already stays.

    Source: https://microsoft.github.io/mimalloc/environment.html
    """
    os.environ.setdefault("MIMALLOC_PURGE_DELAY", "0")  # [ms]
    if any(isinstance(each, RrdFile) and not each.indexed for each in outputs):
        os.environ.setdefault("RUST_LOG", "warn,re_log_encoding::rrd::file_sink=error")
