"""What the tables of the commands share."""

from collections.abc import Iterable
from typing import Any

from rich.table import Table

from pipeline.cli.console import escape_markup


class PlainTable(Table):
    """A table whose cells are read as they are: brackets in a name are no markup."""

    def add_row(self, *cells: Any, **options: Any) -> None:
        """Add a row as `Table` does."""
        plain = (escape_markup(cell) if isinstance(cell, str) else cell for cell in cells)
        super().add_row(*plain, **options)


def table_of(title: str, *texts: str, figures: Iterable[str] = (), no_wrap: bool = False) -> Table:
    """Return an empty table in the common style, no word of whose headings is cut.

    Parameters
    ----------
    title : str
        As it is; brackets are no markup. So are headings and cells.
    *texts : str
        Headings of columns of text, on the left.
    figures : iterable of str, optional
        Headings of columns of figures, which are set to the right.
    no_wrap : bool, optional
        Whether every cell stays on one line.
    """
    table = PlainTable(
        title=escape_markup(title),
        title_justify="left",
        caption_justify="left",
        header_style="bold",
    )
    for heading in texts:
        table.add_column(escape_markup(heading), no_wrap=no_wrap, min_width=_longest_word(heading))
    for heading in figures:
        table.add_column(
            escape_markup(heading),
            justify="right",
            no_wrap=no_wrap,
            min_width=_longest_word(heading),
        )
    return table


def _longest_word(heading: str) -> int:
    return max(map(len, heading.split()), default=0)


def format_value(figure: float | None, form: str) -> str:
    """Return a figure in its format, or `unknown`."""
    return "unknown" if figure is None else format(figure, form)


def format_short(figure: float | None) -> str:
    """Return three significant digits of a figure, up to a million without an exponent."""
    if figure is None or not 1e3 <= abs(figure) < 1e6:
        return format_value(figure, ".3g")
    return f"{float(f'{figure:.3g}'):.0f}"
