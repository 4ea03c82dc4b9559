"""What the tables of the commands share."""

from rich.table import Table


def table_of(title: str) -> Table:
    """An empty table as all of them look."""
    return Table(title=title, title_justify="left", caption_justify="left", header_style="bold")


def counted(count: int, noun: str) -> str:
    """ "1 window", "2 windows"."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def told(figure: float | None, form: str) -> str:
    """A figure in its form, or that it is not known."""
    return "unknown" if figure is None else format(figure, form)
