"""What the commands share: output streams, progress bars, options, signals."""

import json
import logging
import re
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rich.console import Console
from rich.markup import render
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from sensors.atomic_write import require_writable
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.viewer.outputs.outputs import ViewerOutput
    from sensors.acquisition.blocks import AccelerationBlock


class LineConsole(Console):
    """A console that folds sentences on a terminal only: in a file or a pipe a line is a line."""

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as `Console` does."""
        sentences = all(isinstance(each, str) for each in objects)
        options.setdefault("soft_wrap", sentences and not self.is_terminal)
        super().print(*objects, **options)


def require_place(path: Path, option: str) -> None:
    """Refuse a file that cannot be written, before the work that it is for.

    Raises
    ------
    InputError
        If its folder is missing or takes no file, or it is a folder itself.
    """
    if not path.parent.is_dir():
        raise InputError(f"{option} {path}: the folder {path.parent} does not exist")
    if path.is_dir():
        raise InputError(f"{option} {path} is a folder; a file is needed")
    try:
        require_writable(path.parent)
    except OSError as error:
        raise InputError(f"{option} {path} cannot be written: {error.strerror}") from error


class JsonFormatter(logging.Formatter):
    """A log record as one line of JSON: time (UTC), level, logger, message, exception."""

    def format(self, record: logging.LogRecord) -> str:
        """Return the line."""
        moment = datetime.fromtimestamp(record.created, UTC)
        line = {
            "time": moment.isoformat(timespec="milliseconds").replace("+00:00", "Z"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        if record.exc_info:
            line["exception"] = self.formatException(record.exc_info)
        return json.dumps(line, ensure_ascii=False)


class LogConsole(LineConsole):
    """The console of progress, warnings and errors, which may write lines of JSON instead."""

    json_lines = False

    @property
    def is_terminal(self) -> bool:
        """False among lines of JSON: no progress bar is drawn between them."""
        return super().is_terminal and not self.json_lines

    def print(self, *objects: Any, **options: Any) -> None:
        """Print as `Console` does; as JSON, the markup's colour is the level."""
        if not self.json_lines:
            super().print(*objects, **options)
            return
        for text in map(str, objects):
            plain = render(text).plain if options.get("markup", True) else text
            level = "WARNING" if "yellow]" in text else "ERROR" if "red]" in text else "INFO"
            record = {
                "name": "pilewatch",
                "levelname": level,
                "msg": plain.removeprefix("pilewatch: "),
            }
            self.log_line(logging.makeLogRecord(record))

    def log_line(self, record: logging.LogRecord) -> None:
        """Write one record as a line of JSON."""
        self.file.write(JsonFormatter().format(record) + "\n")
        self.file.flush()


# Without emoji: they would replace what is between two colons, as in an address.
stderr = LogConsole(stderr=True, emoji=False)  # progress, warnings, errors
output = LineConsole(emoji=False)  # results

ScenarioOption = Annotated[
    str | None,
    typer.Option(help="A shipped scenario (e.g. parked) or a TOML file of your own."),
]
SamplerChoice = Literal["importance", "emcee", "tmcmc", "tmcmc-published"]  # of the updating
SamplerOption = Annotated[
    SamplerChoice | None,
    typer.Option(
        "--sampler", help="Sampler of an exact structure; default: the scenario's, else importance."
    ),
]
DatesOption = Annotated[
    Literal["day-first", "month-first"] | None,
    typer.Option("--dates", help="What comes first in dates such as 3/4/2024."),
]
ZoneOption = Annotated[
    str,
    typer.Option("--zone", help="Time zone of dates that state none, such as Europe/Berlin; UTC."),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]


ZenohConfigOption = Annotated[
    Path | None,
    typer.Option("--zenoh-config", help="A Zenoh configuration (JSON5), as zenohd reads it."),
]
ZenohMode = Literal["peer", "client", "router"]
ModeOption = Annotated[
    ZenohMode,
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
    mode: ZenohMode, listen: list[str] | None, connect: list[str] | None, config: Path | None
) -> Any:
    """Return how the command's session finds the others.

    Parameters
    ----------
    mode : ZenohMode
        Of the session.
    listen : list of str or None
        Endpoints that it listens at.
    connect : list of str or None
        Endpoints that it connects to.
    config : Path or None
        Configuration file of Zenoh, which sets the mode.

    Raises
    ------
    InputError
        If the mode is unknown, or set by a file; for an endpoint that is none.
    """
    from pipeline.transport.zenoh_bus import ZenohSettings
    from pipeline.transport.zenoh_settings import is_endpoint

    for option, endpoints in (("--listen", listen), ("--connect", connect)):
        for endpoint in endpoints or ():
            if not is_endpoint(endpoint):
                raise InputError(
                    f"{option} {endpoint}: no endpoint; one is a protocol, a host and a port, as "
                    "in tcp/192.0.2.1:7447"
                )

    if config is not None and mode != "peer":
        raise InputError(f"--mode {mode} and --zenoh-config {config}: the file sets the mode")
    return ZenohSettings(mode, tuple(listen or ()), tuple(connect or ()), False, config)


def print_json(figures: Any) -> None:
    """Print what a command found as JSON, for programs: not a table, and never folded."""
    typer.echo(json.dumps(figures, ensure_ascii=False, indent=2, default=str))


def print_written(files: Iterable[Path]) -> None:
    """Print which files a command has written, on one line."""
    output.print(escape_markup(f"Written: {', '.join(map(str, files))}"), soft_wrap=True)


def speed_of(text: str) -> float:
    """Return the factor of `--speed`.

    Raises
    ------
    InputError
        If the text is no speed.
    """
    try:
        speed = float("inf") if text == "max" else float(text)
    except ValueError:
        speed = float("nan")
    if not speed > 0:
        raise InputError(f"--speed {text} is neither 'max' nor a positive number")
    return speed


def escape_markup(text: str) -> str:
    """Text whose brackets are not read as markup, also after backslashes."""
    return re.sub(r"(\\*)\[", r"\1\1\\[", text)


@contextmanager
def stop_on_signals() -> Iterator[threading.Event]:
    """Set an event on Ctrl-C and SIGTERM, so that files are closed before the end."""
    stopping = threading.Event()
    names = (signal.SIGINT, signal.SIGTERM)
    before = {name: signal.signal(name, lambda *_: stopping.set()) for name in names}
    try:
        yield stopping
    finally:
        for name, handler in before.items():
            signal.signal(name, handler)


def progress_bars(*columns: ProgressColumn) -> Progress:
    """Bars on the error stream, gone at the end; on no terminal nothing, not even an empty line."""
    return Progress(*columns, console=stderr, transient=True, disable=not stderr.is_terminal)


@contextmanager
def progress(title: str, duration: float | None) -> Iterator["Callable[[AccelerationBlock], None]"]:
    """Draw a bar of measured time on the error stream; yield the function that advances it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f} s measured"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with progress_bars(*columns) as bar:
        task = bar.add_task(escape_markup(title), total=duration)
        yield lambda block: bar.advance(task, block.duration)


VIEW_HELP = (
    "spawn: a viewer's window; web: a page for a browser on this machine; "
    "connect=URL: a running viewer."
)


@dataclass(frozen=True, slots=True)
class View:
    """A viewer of `--view`."""

    output: "ViewerOutput | None"
    """Where to draw; None without a viewer."""
    page: str = ""
    """Address for a browser; "" where no page is served."""

    def wait(self, stopping: threading.Event) -> None:
        """Keep a served page up until Ctrl-C: it holds what was drawn until then."""
        if self.page and not stopping.is_set():
            stderr.print(f"The page stays at {self.page} until Ctrl-C.", soft_wrap=True)
            stopping.wait()


@contextmanager
def open_view(asked: str | None, *pictures: Path) -> Iterator[View]:
    """Open the viewer of `--view`; a page is served for as long as the context lasts.

    Parameters
    ----------
    pictures : Path
        .rrd files that the page opens.

    Raises
    ------
    ViewerError
        If the word is unknown or no page can be served.
    """
    from pipeline.viewer.outputs.outputs import WebPage, parse_view
    from pipeline.viewer.outputs.viewer_process import serve_page

    view = None if asked is None else parse_view(asked)
    if not isinstance(view, WebPage):
        yield View(view)
        return
    with serve_page(view, *pictures, narrow=_narrow_layout) as shown:
        stderr.print(f"Open in a browser: {shown.address}", soft_wrap=True)
        yield View(shown.output, shown.address)


def _narrow_layout(place: Path) -> bytes:
    """Return the layout of a session for a narrow screen; rerun is loaded for it alone."""
    from pipeline.viewer.session_views import narrow_layout

    return narrow_layout(place)


@contextmanager
def no_longer_than(seconds: float) -> Iterator[None]:
    """Raise InputError where an import in the context takes longer; in the main thread alone.

    Parameters
    ----------
    seconds : float
        Wall time [s].
    """

    def give_up(*_: object) -> None:
        raise InputError(
            f"the import takes longer than {seconds:g} s and is given up; --at-most allows more"
        )

    if not seconds > 0:
        raise InputError(f"--at-most {seconds:g}: a positive number of seconds is needed")
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, give_up)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
