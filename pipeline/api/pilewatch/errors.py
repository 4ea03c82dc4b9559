"""What is raised for input that cannot be right, and for an extra that is not installed."""

from typing import Any

from sensors.errors import InputError
from sensors.extras import import_extra

__all__ = ["InputError", "require"]


def require(package: str) -> Any:
    """Import a package that only one method needs.

    Raises
    ------
    InputError
        If it is not installed; the message has the command that installs it.
    """
    return import_extra(package, "notebook", "tables and plots")
