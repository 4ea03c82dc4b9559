"""What the tables of the commands share."""

from rich.table import Table


def table_of(title: str) -> Table:
    """Return an empty table in the common style."""
    return Table(title=title, title_justify="left", caption_justify="left", header_style="bold")


def format_value(figure: float | None, form: str) -> str:
    """Return a figure in its format, or `unknown`."""
    return "unknown" if figure is None else format(figure, form)
