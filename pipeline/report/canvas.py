"""Where figures are drawn. matplotlib is an optional dependency (extra `plot`), imported here."""

from typing import Any

from sensors.errors import InputError


def new_figure(size: tuple[float, float], purpose: str) -> Any:
    """An empty matplotlib figure.

    size      width and height [inch]
    purpose   what it is for, in the error's words, e.g. "diagram.png"

    Raises InputError where matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise InputError(
            f"cannot draw {purpose}: matplotlib is not installed; pip install 'pilewatch[plot]'"
        ) from error
    return Figure(figsize=size, layout="constrained")
