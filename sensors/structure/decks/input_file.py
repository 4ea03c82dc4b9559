"""An input file of OpenFAST or BModes: values before their keywords, tables below their titles.

Both programs read by the order of lines, so that a label is what its author wrote: `BldFile(1)` of
one deck is `BldFile1` of another. Labels are compared without case, brackets and colon.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.structure.foundation import TurbineError

_LINE = re.compile(r"""\s*(?:"(?P<double>[^"]*)"|'(?P<single>[^']*)'|(?P<bare>\S+))(?P<rest>.*)""")
_KINDS = ("double", "single", "bare")  # quotes of a value


@dataclass(frozen=True, slots=True)
class Table:
    """Rows below the titles of their columns; a column is named by its title or its place."""

    name: str
    """File and first title, for errors."""
    titles: tuple[str, ...]
    """Titles as the file has them."""
    rows: tuple[tuple[str, ...], ...]
    """Words of each row; comments behind it are words too."""

    def has(self, title: str) -> bool:
        """Return whether there is a column of this title."""
        return _plain(title) in map(_plain, self.titles)

    def texts(self, column: str | int) -> list[str]:
        """Return the words of a column; TurbineError where it or one of them is missing."""
        place, title = self._column(column)
        for number, row in enumerate(self.rows, start=1):
            if len(row) <= place:
                raise TurbineError(
                    f"{self.name}: row {number} ends before {title}: {' '.join(row)!r}"
                )
        return [row[place] for row in self.rows]

    def numbers(self, *columns: str | int) -> FloatArray:
        """Return columns side by side, (n_rows, n_columns); TurbineError for what is no number."""
        values = np.empty((len(self.rows), len(columns)))
        for place, column in enumerate(columns):
            for number, text in enumerate(self.texts(column)):
                value = number_of(text)
                if value is None:
                    raise TurbineError(
                        f"{self.name}: {self._column(column)[1]} of row {number + 1} is {text!r}; "
                        "a number is needed"
                    )
                values[number, place] = value
        return values

    def _column(self, column: str | int) -> tuple[int, str]:
        """Place and title of a column."""
        if isinstance(column, int):
            known = column < len(self.titles)
            return column, self.titles[column] if known else f"column {column + 1}"
        if not self.has(column):
            raise TurbineError(f"{self.name}: no column {column}; it has {', '.join(self.titles)}")
        return [_plain(title) for title in self.titles].index(_plain(column)), column


class Deck:
    """One input file: its keywords, and its tables by their first title."""

    def __init__(self, path: Path) -> None:
        try:
            self.lines = path.read_text("latin-1").splitlines()
        except OSError as error:
            raise TurbineError(f"{path}: {error.strerror}") from error
        self.path = path

    def has(self, keyword: str, *older: str) -> bool:
        """Return whether a line has this keyword."""
        return self._found((keyword, *older)) is not None

    def text(self, keyword: str, *older: str) -> str:
        """Return the value before a keyword, without quotes; TurbineError where it is missing.

        Parameters
        ----------
        keyword : str
            As OpenFAST has it today.
        older : str
            Its names in earlier versions.
        """
        found = self._found((keyword, *older))
        if found is None:
            raise TurbineError(f"{self.path}: there is no {keyword}; is it the right kind of file?")
        return found

    def _found(self, keywords: tuple[str, ...]) -> str | None:
        """Value of the first line with one of the keywords as its second or third word."""
        wanted = {_plain(keyword) for keyword in keywords}
        for line in self.lines:
            match = _LINE.match(line)
            if match and not wanted.isdisjoint(map(_plain, match["rest"].split()[:2])):
                value = next(match[kind] for kind in _KINDS if match[kind] is not None)
                return str(value).strip("\"'")
        return None

    def number(self, keyword: str, *older: str) -> float:
        """Return the number before a keyword."""
        text = self.text(keyword, *older)
        value = number_of(text)
        if value is None:
            raise TurbineError(f"{self.path}: {keyword} is {text!r}; a number is needed")
        return value

    def count(self, keyword: str, *older: str) -> int:
        """Return the whole number before a keyword."""
        value = self.number(keyword, *older)
        if value != int(value) or value < 0:
            raise TurbineError(f"{self.path}: {keyword} is {value:g}; a count is needed")
        return int(value)

    def table(self, head: str, n_rows: int) -> Table:
        """Return the rows below the titles, the first of which is `head`; units stand between."""
        for number, line in enumerate(self.lines):
            titles = line.split()
            if titles and _plain(titles[0]) == _plain(head):
                below = self.lines[number + 2 : number + 2 + n_rows]
                rows = tuple(tuple(each.split()) for each in below)
                if len(rows) == n_rows and all(rows):
                    return Table(f"{self.path}, table of {head}", tuple(titles), rows)
        raise TurbineError(f"{self.path}: there is no table of {head} with {n_rows} rows")

    def beside(self, keyword: str, *older: str) -> "Deck":
        """Return the file that a keyword names, relative to this one."""
        return Deck(self.path.parent / self.text(keyword, *older).replace("\\", "/"))


def number_of(text: str) -> float | None:
    """Return a number as Fortran writes it; None for what is none."""
    try:
        value = float(text.replace("D", "E").replace("d", "e"))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _plain(label: str) -> str:
    """A label without case, brackets and colon."""
    return re.sub(r"[()\[\]]", "", label.rstrip(":")).casefold()
