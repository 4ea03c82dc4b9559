"""The commands of `pilewatch`, each a few lines around a function that does the work.

Exit codes: 0 done; 2 wrong input or nothing could be done (one line gives the reason); 1 a bug or a
failed node.
"""

import errno
import logging
import sys
from collections.abc import Callable
from typing import Any

import typer
from rich.logging import RichHandler

from pipeline.cli.console import escape_markup, stderr
from pipeline.cli.farm import farm, reprocess
from pipeline.cli.live import certificates, control, feed, publish
from pipeline.cli.modes import describe, identify, modes
from pipeline.cli.new import new
from pipeline.cli.recordings import export, import_files, info, salvage, simulate
from pipeline.cli.report import audit, report, show
from pipeline.cli.run import node, run
from pipeline.cli.status import ack, metrics, status
from pipeline.cli.update import reproduce, update
from pipeline.runtime.errors import NodeFailed
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
    "Modes and stiffness": (identify, modes, describe, update, reproduce),
    "Instruments, parts and alarms": (feed, publish, node, certificates, metrics, ack),
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


# What typer raises for wrong arguments; its class has no public name.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]


def main() -> None:
    """Run `pilewatch`: wrong input becomes one line and exit code 2."""
    logging.basicConfig(
        level=logging.WARNING,
        format="%(message)s",
        handlers=[RichHandler(console=stderr, show_path=False)],
    )
    try:
        sys.exit(app(prog_name="pilewatch", standalone_mode=False) or 0)
    except UsageError as error:
        if text := _usage_text(error):
            stderr.print(f"[bold red]pilewatch:[/] {escape_markup(text)}", soft_wrap=True)
        sys.exit(2)
    except InputError as error:
        stderr.print(f"[bold red]pilewatch:[/] {escape_markup(str(error))}", soft_wrap=True)
        sys.exit(2)
    except NodeFailed as failure:
        logging.getLogger(__name__).debug("a node failed", exc_info=True)
        stderr.print(f"[bold red]pilewatch:[/] {escape_markup(str(failure))}", soft_wrap=True)
        sys.exit(1)
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


def _usage_text(error: Any) -> str:
    """Return the error of a wrong argument or option as one line; "" after the help."""
    message = " ".join(error.format_message().split()).removesuffix(".")
    context = getattr(error, "ctx", None)
    command = (
        context.command_path if context is not None else " ".join(["pilewatch", *sys.argv[1:2]])
    )
    return message and f"{message}; `{command} --help` describes its options"
