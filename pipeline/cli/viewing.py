"""What `--view` asks for, made ready before a command draws on it and cleared away after it."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.cli.console import people

if TYPE_CHECKING:
    from pipeline.viewer.outputs.outputs import ViewerOutput

VIEW_HELP = (
    "spawn: a viewer's window; web: a page for a browser on this machine; "
    "connect=URL: a viewer that runs."
)


@dataclass(frozen=True, slots=True)
class View:
    """A viewer that can be drawn on."""

    output: "ViewerOutput | None"  # None: nothing is shown
    page: str = ""  # what a browser opens; "" where no page is served

    def stay(self, stopping: threading.Event) -> None:
        """Keep a served page up until Ctrl-C: it holds what was drawn, and is gone afterwards."""
        if self.page and not stopping.is_set():
            people.print(f"The page stays at {self.page} until Ctrl-C.", soft_wrap=True)
            stopping.wait()


@contextmanager
def viewing(asked: str | None, *pictures: Path) -> Iterator[View]:
    """The viewer of `--view`; a page is served for as long as the context lasts.

    pictures   .rrd files that the page shows

    Raises ViewerError for a word that is none, and where no page can be served.
    """
    from pipeline.viewer.outputs.outputs import WebPage, parse_view
    from pipeline.viewer.outputs.viewer_process import served_page

    view = None if asked is None else parse_view(asked)
    if not isinstance(view, WebPage):
        yield View(view)
        return
    with served_page(view, *pictures) as shown:
        people.print(f"Open in a browser: {shown.address}", soft_wrap=True)
        yield View(shown.output, shown.address)
