"""The commands of `pilewatch`, each a few lines around a function that does the work.

Exit codes: 0 done; 2 wrong input or nothing could be done (one line gives the reason); 75 no
session answers (to try again may help, as a service does); 1 a bug or a failed node.
"""

import errno
import logging
import os
import re
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, version
from typing import Annotated, Any, Literal

import typer

from pipeline.cli.console import escape_markup, stderr
from pipeline.cli.farm import farm, reprocess
from pipeline.cli.live import certificates, control, feed, publish
from pipeline.cli.modes import describe, identify, modes
from pipeline.cli.new import new
from pipeline.cli.recordings import export, import_files, info, salvage, simulate
from pipeline.cli.report import audit, report, show
from pipeline.cli.run import node, run
from pipeline.cli.status import ack, metrics, notices, status
from pipeline.cli.update import calibrate, reproduce, update
from pipeline.runtime.errors import NodeFailed
from pipeline.transport.errors import UnreachableError
from sensors.errors import InputError

app = typer.Typer(
    help="Watch an offshore wind turbine's foundation through its tower's accelerations.",
    epilog="Start with `pilewatch run`: it replays recordings/parked.mcap and writes out/.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
)
PANELS: dict[str, tuple[Callable[..., None], ...]] = {
    "A session": (run, new, status, control, show, report, audit),
    "Recordings and files": (simulate, import_files, info, salvage, export),
    "Modes and stiffness": (identify, modes, describe, update, calibrate, reproduce),
    "Instruments, parts and alarms": (feed, publish, node, certificates, metrics, notices, ack),
    "A farm, an archive": (farm, reprocess),
}
for panel, commands in PANELS.items():
    for command in commands:
        name = "import" if command is import_files else None  # else the function's own
        app.command(name, rich_help_panel=panel)(command)


# Errors of a disk, of permissions or of a path: one line, since no part of the program is at fault.
ENVIRONMENT_ERRORS = frozenset(
    {
        *(errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EFBIG),
        *(errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EMFILE),
    }
)


LOG_FORMAT = "PILEWATCH_LOG_FORMAT"  # variable of the environment
# The number of threads of the libraries that numpy and scipy compute with. They read it once, when
# a command loads them, and the processes that it starts inherit it.
BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")

# What typer raises for wrong arguments; its class has no public name.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]


def print_version(asked: bool) -> None:
    """Print the version and exit, where it was asked for."""
    if asked:
        try:
            typer.echo(f"pilewatch {version('pilewatch')}")
        except PackageNotFoundError:  # on a tower unit
            typer.echo(f"pilewatch-edge {version('pilewatch-edge')}")
        raise typer.Exit


@app.callback()
def common_options(
    verbose: Annotated[
        int, typer.Option("-v", "--verbose", count=True, help="Log more; -vv: for debugging.")
    ] = 0,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Log errors only.")] = False,
    log_format: Annotated[
        Literal["text", "json"],
        typer.Option(envvar=LOG_FORMAT, help="json: every line of the log is one JSON object."),
    ] = "text",
    shown_version: Annotated[
        bool,
        typer.Option("--version", callback=print_version, is_eager=True, help="Print the version."),
    ] = False,
) -> None:
    """Options before the name of a command."""
    more = (logging.WARNING, logging.INFO, logging.DEBUG)[min(verbose, 2)]
    logging.getLogger().setLevel(logging.ERROR if quiet else more)
    stderr.json_lines = log_format == "json"
    os.environ[LOG_FORMAT] = log_format  # nodes that run as processes log alike


class ConsoleHandler(logging.Handler):
    """Log on the error stream beside progress bars, one unbroken line per event."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print one log record."""
        if stderr.json_lines:
            stderr.log_line(record)
            return
        text = f"{record.levelname.lower()}: {self.format(record)}"
        stderr.print(text, soft_wrap=True, markup=False, highlight=False)


def main() -> None:
    """Run `pilewatch`: wrong input becomes one line and exit code 2."""
    for variable in BLAS_THREADS:  # small matrices: several threads only wait for each other
        os.environ.setdefault(variable, "1")
    logging.basicConfig(
        level=logging.WARNING,
        format="%(message)s",
        handlers=[ConsoleHandler()],
    )
    try:
        sys.exit(app(prog_name="pilewatch", standalone_mode=False) or 0)
    except UsageError as error:
        if text := _usage_text(error):
            stderr.print(f"[bold red]pilewatch:[/] {escape_markup(text)}", soft_wrap=True)
        sys.exit(2)
    except InputError as error:
        stderr.print(f"[bold red]pilewatch:[/] {escape_markup(str(error))}", soft_wrap=True)
        sys.exit(os.EX_TEMPFAIL if isinstance(error, UnreachableError) else 2)
    except NodeFailed as failure:
        logging.getLogger(__name__).debug("a node failed", exc_info=True)
        stderr.print(f"[bold red]pilewatch:[/] {escape_markup(str(failure))}", soft_wrap=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        if not _is_left_out(error):
            raise
        stderr.print(
            f"[bold red]pilewatch:[/] this needs {escape_markup(str(error.name))}, which is not "
            "installed here: a tower unit (pilewatch-edge) only publishes and feeds; "
            "pip install pilewatch",
            soft_wrap=True,
        )
        sys.exit(2)
    except OSError as error:
        if error.errno not in ENVIRONMENT_ERRORS:
            raise
        place = f"{error.filename}: " if error.filename else ""
        stderr.print(
            f"[bold red]pilewatch:[/] {escape_markup(f'{place}{error.strerror}')}", soft_wrap=True
        )
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(130)


def _is_left_out(error: ModuleNotFoundError) -> bool:
    """Report whether what is missing is a package of others, not a part of this one."""
    return bool(error.name) and str(error.name).split(".")[0] not in ("pipeline", "sensors")


_PARSING = re.compile(r"Input should be a valid (\w+), unable to parse string as an? \w+")


def _wanted_number(found: re.Match[str]) -> str:
    return "a whole number is needed" if found[1] == "integer" else f"a valid {found[1]} is needed"


def _given(error: Any) -> str:
    """Return the value that an option or argument could not be read from; "" where none is known.

    Typer reads values by pydantic, whose message leaves the value out.
    """
    errors = getattr(error.__cause__ or error.__context__, "errors", None)
    found = errors() if callable(errors) else ()
    return str(found[0].get("input", "")) if found else ""


# Of every command, before its name.
LOGGING_OPTIONS = ("-v", "-vv", "--verbose", "-q", "--quiet", "--log-format")


def _usage_text(error: Any) -> str:
    """Return the error of a wrong argument or option as one line; "" after the help."""
    message = " ".join(error.format_message().split()).removesuffix(".")
    message = message.replace("Value error, ", "", 1)
    message = _PARSING.sub(_wanted_number, message)
    message = message.replace("Input should be greater than or equal to ", "at least ")
    if "at least " in message and not message.endswith("needed"):
        message += " is needed"
    given = _given(error)
    if given and repr(given) not in message:
        message = message.replace(": ", f": {given!r}; ", 1)
    context = getattr(error, "ctx", None)
    option = getattr(error, "option_name", "")
    if option in LOGGING_OPTIONS and context is not None:
        name = context.info_name
        written = f"{option} json" if option == "--log-format" else option
        return f"{option} stands before the command: `pilewatch {written} {name} …`"
    command = (
        context.command_path if context is not None else " ".join(["pilewatch", *sys.argv[1:2]])
    )
    return message and f"{message}; `{command} --help` describes its options"
