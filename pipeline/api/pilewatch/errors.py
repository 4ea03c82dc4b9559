"""What is raised for input that cannot be right, and for an extra that is not installed."""

import importlib
from types import ModuleType

from sensors.errors import InputError

__all__ = ["InputError", "require"]


def require(package: str) -> ModuleType:
    """Import a package that only one method needs.

    Raises
    ------
    InputError
        If it is not installed; the message has the command that installs it.
    """
    try:
        return importlib.import_module(package)
    except ImportError:
        raise InputError(f"{package} is not installed: pip install 'pilewatch[notebook]'") from None
