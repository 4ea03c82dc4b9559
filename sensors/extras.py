"""Packages that only some users need, each of an extra of this one."""

from importlib import import_module
from typing import Any

from sensors.errors import InputError


def import_extra(
    module: str, extra: str, purpose: str, error: type[InputError] = InputError
) -> Any:
    """Return a module of a package that may be missing.

    Parameters
    ----------
    extra : str
        That installs the package.
    purpose : str
        What the module is for, as an error begins: a file, "certificates".
    error : type
        Of the error.

    Raises
    ------
    InputError
        If the package is missing; the message has the command that installs it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.partition(".")[0]
        raise error(
            f"{purpose}: {package} is needed for it; pip install 'pilewatch[{extra}]'"
        ) from None
