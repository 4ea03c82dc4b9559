"""Packages that only one format needs, imported when a file of that format is read."""

from importlib import import_module
from pathlib import Path
from typing import Any

from sensors.files.table import FileError


def needed(module: str, extra: str, path: Path) -> Any:
    """The module. Raises FileError, which names the extra to install, where it is missing.

    path   the file that is to be read
    """
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise FileError(
            f"{path}: {package} is needed to read it; pip install 'pilewatch[{extra}]'"
        ) from error


def existing(path: Path) -> Path:
    """The path. Raises FileError where no file is there, or it cannot be read."""
    try:
        with path.open("rb"):
            return path
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
