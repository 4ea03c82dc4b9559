"""What the commands share: where they speak, how they show progress, how they are stopped."""

import re
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from sensors.errors import InputError

if TYPE_CHECKING:
    from sensors.acquisition.blocks import AccelerationBlock
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.viewer.outputs.outputs import ViewerOutput

# Without emoji: they would take the place of what stands between two colons, as in an address.
people = Console(stderr=True, emoji=False)  # progress, warnings, errors
output = Console(emoji=False)  # results

ScenarioOption = Annotated[
    str | None,
    typer.Option(help="A shipped scenario (e.g. parked) or a TOML file of your own."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


ZenohConfigOption = Annotated[
    Path | None,
    typer.Option("--zenoh-config", help="A Zenoh configuration (JSON5), as zenohd reads it."),
]
ModeOption = Annotated[
    str,
    typer.Option("--mode", help="peer: find each other; client: of a router; router: be one."),
]
ListenOption = Annotated[
    list[str] | None,
    typer.Option("--listen", help="Zenoh endpoint to listen on, e.g. tcp/127.0.0.1:7447."),
]
ConnectOption = Annotated[
    list[str] | None,
    typer.Option("--connect", help="Zenoh endpoint to connect to; repeatable."),
]


def zenoh_settings(
    mode: str, listen: list[str] | None, connect: list[str] | None, config: Path | None
) -> Any:
    """How the command's session finds the others. Raises InputError for a mode that is none, or
    one that a file decides."""
    from pipeline.transport.zenoh_bus import ZenohSettings

    match mode:
        case "peer" | "client" | "router" if config is None or mode == "peer":
            return ZenohSettings(mode, tuple(listen or ()), tuple(connect or ()), False, config)
        case "peer" | "client" | "router":
            raise InputError(f"--mode {mode} and --zenoh-config {config}: the file says the mode")
        case _:
            raise InputError(f"--mode {mode} is none of peer, client and router")


def speed_of(text: str) -> float:
    """What `--speed` says. Raises InputError for what is no speed."""
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = float("nan")
    if not speed > 0:
        raise InputError(f"--speed {text} is neither 'max' nor a positive number")
    return speed


def escaped(text: str) -> str:
    """Text whose brackets are brackets, not markup, whatever backslashes stand before them."""
    return re.sub(r"(\\*)\[", r"\1\1\\[", text)


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that Ctrl-C and SIGTERM set, so that files are closed before the end."""
    stopping = threading.Event()
    names = (signal.SIGINT, signal.SIGTERM)
    before = {name: signal.signal(name, lambda *_: stopping.set()) for name in names}
    try:
        yield stopping
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


@contextmanager
def progress(title: str, duration: float | None) -> Iterator["Callable[[AccelerationBlock], None]"]:
    """A bar of measured time on the error stream; gives the function that moves it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} s measured"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=people, transient=True) as bar:
        task = bar.add_task(escaped(title), total=duration)
        yield lambda block: bar.advance(task, block.duration)


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
