"""The commands: thin, each a few lines around a function that does the work.

Exit codes: 0 done; 2 something the user gave is wrong (one line says what); 1 a bug or a node that
failed.
"""

import errno
import logging
import sys
from collections.abc import Callable
from typing import Any

import typer
from rich.logging import RichHandler

from pipeline.cli.console import escaped, people
from pipeline.cli.farm import farm, reprocess
from pipeline.cli.live import certificates, control, feed, publish
from pipeline.cli.modes import describe, identify, modes
from pipeline.cli.new import new
from pipeline.cli.recordings import export, import_files, info, salvage, simulate
from pipeline.cli.report import report, show
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
    "A session": (run, new, status, control, show, report),
    "Recordings and files": (simulate, import_files, info, salvage, export),
    "Modes and stiffness": (identify, modes, describe, update, reproduce),
    "Instruments, parts and alarms": (feed, publish, node, certificates, metrics, ack),
    "A farm, an archive": (farm, reprocess),
}
for panel, commands in PANELS.items():
    for command in commands:
        name = "import" if command is import_files else None  # else the function's own
        app.command(name, rich_help_panel=panel)(command)


# What a disk, a person's permissions or a path refuse to whatever command: no fault of the program.
NOT_OURS = frozenset(
    {
        *(errno.EACCES, errno.EPERM, errno.EROFS, errno.ENOSPC, errno.EDQUOT, errno.EFBIG),
        *(errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP, errno.EMFILE),
    }
)


# What typer raises for arguments that do not fit: its own class has no public name.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]


def main() -> None:
    """Entry point of `pilewatch`: a user's mistake becomes one line and exit code 2."""
    logging.basicConfig(
        level=logging.WARNING,
        format="%(message)s",
        handlers=[RichHandler(console=people, show_path=False)],
    )
    try:
        sys.exit(app(prog_name="pilewatch", standalone_mode=False) or 0)
    except UsageError as error:
        if told := _misuse(error):
            people.print(f"[bold red]pilewatch:[/] {escaped(told)}", soft_wrap=True)
        sys.exit(2)
    except InputError as error:
        people.print(f"[bold red]pilewatch:[/] {escaped(str(error))}", soft_wrap=True)
        sys.exit(2)
    except NodeFailed as failure:
        logging.getLogger(__name__).debug("a node failed", exc_info=True)
        people.print(f"[bold red]pilewatch:[/] {escaped(str(failure))}", soft_wrap=True)
        sys.exit(1)
    except ModuleNotFoundError as error:
        if not _is_left_out(error):
            raise
        people.print(
            f"[bold red]pilewatch:[/] this needs {escaped(str(error.name))}, which is not "
            "installed here: a tower unit (pilewatch-edge) only publishes and feeds; "
            "pip install pilewatch",
            soft_wrap=True,
        )
        sys.exit(2)
    except OSError as error:
        if error.errno not in NOT_OURS:
            raise
        place = f"{error.filename}: " if error.filename else ""
        people.print(
            f"[bold red]pilewatch:[/] {escaped(f'{place}{error.strerror}')}", soft_wrap=True
        )
        sys.exit(2)
    except (KeyboardInterrupt, typer.Abort):
        sys.exit(130)


def _is_left_out(error: ModuleNotFoundError) -> bool:
    """Whether what is missing is a package of others, not a part of this one."""
    return bool(error.name) and str(error.name).split(".")[0] not in ("pipeline", "sensors")


def _misuse(error: Any) -> str:
    """A wrong argument or option in one line; "" where the help was shown instead."""
    message = " ".join(error.format_message().split()).removesuffix(".")
    context = getattr(error, "ctx", None)
    command = (
        context.command_path if context is not None else " ".join(["pilewatch", *sys.argv[1:2]])
    )
    return message and f"{message}; `{command} --help` tells how"
