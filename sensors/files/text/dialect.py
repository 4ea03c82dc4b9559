"""What the beginning of a text file shows: how its columns are kept apart, and what they are.

Logger 7; serial 1234                  lines that describe the measurement
# Sampling rate: 100 Hz                … or begin with # or %
Zeit;oben;unten                        titles
s;m/s²;m/s²                            units, unless they are in the titles
0,00;0,123;-0,456                      samples
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from sensors.files.missing_values import is_missing
from sensors.files.table import EVERYTHING, FileError, Wanted
from sensors.files.text.column_titles import distinct, is_time_title, is_unit, split_unit
from sensors.files.text.columns import (
    Column,
    ColumnKind,
    SortedColumns,
    renamed_columns,
    sort_columns,
)
from sensors.files.text.dates import kind_of_text
from sensors.files.text.decoding import (
    UNREADABLE,
    detect_encoding,
    holds_nul,
    open_unpacked,
)
from sensors.files.text.preamble import stated_rate, stated_start_ns, states_measurement
from sensors.files.text.time_column import ABSOLUTE

Each = TypeVar("Each")

BEGINNING = 2**18  # bytes that are looked at
JUDGED = 60  # rows by which the columns are judged
# How a logger formed each value of a column, in a row below the units: Campbell's TOA5.
STATISTICS = frozenset(
    {"smp", "avg", "max", "min", "std", "tot", "med", "mom", "tmx", "tmn", "wvc"}
)
FEWEST_GROUPED = 5  # numbers of a column by which thousands are told from decimals
COMMENT = ("#", "%", "//")
DELIMITERS = (";", "\t", ",", "|", " ")  # " " stands for blanks of any number

_NUMBER = {
    mark: re.compile(rf"[+-]?(\d+({re.escape(mark)}\d*)?|{re.escape(mark)}\d+)([eE][+-]?\d+)?")
    for mark in ".,"
}
_GROUPED = {mark: re.compile(rf"[+-]?[1-9]\d{{0,2}}({re.escape(mark)}\d{{3}})+") for mark in ".,"}
_BELOW_THOUSAND = re.compile(r"[+-]?\d{1,3}")
_INFINITE = re.compile(r"[+-]?inf(inity)?", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class TextHead:
    """How a text file is read."""

    encoding: str
    delimiter: str
    decimal_point: str
    skipped: int
    """Lines before the first sample."""

    columns: SortedColumns
    missing: tuple[str, ...]
    """How a cell without a value is written."""

    exact_time: bool
    """The time has digits that a double does not hold."""

    nul: bool = False
    """The file has blocks of NUL bytes, whose lines are left out."""


def read_head(path: Path, wanted: Wanted = EVERYTHING) -> TextHead:
    """Return how a text file is read, from its beginning.

    Raises
    ------
    FileError
        Missing, empty or no text; no samples; titles that do not fit the columns.
    """
    try:
        with open_unpacked(path) as file:
            beginning = file.read(BEGINNING)
    except UNREADABLE as error:
        raise FileError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    encoding = detect_encoding(beginning, path)
    text = beginning.decode(encoding, errors="replace")
    lines = list(io.StringIO(text, newline=None))
    if len(beginning) == BEGINNING and len(lines) > 1:
        lines = lines[:-1]  # incomplete
    nul = not encoding.startswith("utf-16") and (b"\0" in beginning or holds_nul(path))
    lines = [line.rstrip("\n") for line in lines if not (nul and "\0" in line)]
    if not any(_holds_cells(line) for line in lines):
        raise FileError(f"{path}: the file is empty; a header row is needed")
    head = _Beginning(lines, _form_of(lines), path).head(encoding, wanted)
    return head if not nul else _without_blocks_of_nul(head, path)


def _without_blocks_of_nul(head: "TextHead", path: Path) -> "TextHead":
    sentence = (
        f"{path}: lines with blocks of NUL bytes, as a power failure leaves them, are left out"
        f"{'' if head.columns.clock else '; without a time column the samples behind them move up'}"
    )
    columns = replace(head.columns, left_out=(*head.columns.left_out, sentence))
    return replace(head, columns=columns, nul=True)


def _form_of(lines: Sequence[str]) -> "Form":
    """Return the form in which the last lines make the most sense, then the most columns."""
    judged = _last([each for each in lines if _holds_cells(each)])
    quoted = any('"' in line for line in judged)
    forms = [Form(d, p) for d in DELIMITERS for p in ".," if quoted or (d, p) != (",", ",")]
    return max(forms, key=lambda form: _sense(form, judged, lines[:JUDGED]))


def _holds_cells(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(COMMENT)


def _last(rows: Sequence[Each]) -> Sequence[Each]:
    """The rows by which all are judged: at most half of them, which spares what stands above."""
    return rows[-max(1, min(JUDGED, (len(rows) + 1) // 2)) :]


def _sense(form: "Form", judged: Sequence[str], first: Sequence[str]) -> tuple[float, bool, int]:
    """The share of cells that are numbers or times, whether there are titles, how many columns."""
    rows = [form.cells(line) for line in judged]
    count = _count_of(rows)
    regular = [row for row in rows if len(row) == count]
    kinds = Counter(form.kind(cell) for row in regular for cell in row)
    filled = kinds.total() - kinds["empty"]
    share = (1 - kinds["text"] / filled if filled else 1.0) * len(regular) / max(1, len(rows))
    titles = (form.titles(line, count) for line in first)
    titled = any(cells and all(cells[1:]) and "text" in map(form.kind, cells) for cells in titles)
    return round(share, 2), titled, count if share else 0


def _count_of(rows: Sequence[Sequence[str]]) -> int:
    """Return how many cells most rows have; of two numbers as frequent, the first one's."""
    counts = Counter(len(row) for row in rows)
    most = max(counts.values(), default=0)
    return next((len(row) for row in rows if counts[len(row)] == most), 0)


@dataclass(frozen=True, slots=True)
class Form:
    """How lines are written."""

    delimiter: str
    decimal_point: str

    def cells(self, line: str) -> list[str]:
        """Return the cells of a line."""
        if self.delimiter == " ":
            return line.split()
        if '"' in line:
            return next(csv.reader([line], delimiter=self.delimiter), [])
        return line.split(self.delimiter)

    def titles(self, line: str, count: int) -> list[str] | None:
        """Return the cells of a line above `count` columns, if there are so many.

        A separator at the end of the one or the other does not count.
        """
        if self.delimiter == " ":
            near = re.sub(r"\s+(?=[\[(])", "", line.strip())
            ways = (near.split(), re.split(r"\s{2,}|\t", near))
            return next((cells for cells in ways if len(cells) == count), None)
        cells = [cell.strip() for cell in self.cells(line)]
        while len(cells) > count and (not cells[-1] or cells[-1].lower() == "comment"):
            cells = cells[:-1]
        if len(cells) == count - 1:
            cells = [*cells, ""]
        return cells if len(cells) == count else None

    def is_number(self, cell: str) -> bool:
        """Return whether a cell is a number."""
        text = cell.strip()
        return bool(_NUMBER[self.decimal_point].fullmatch(text) or _INFINITE.fullmatch(text))

    def kind(self, cell: str) -> ColumnKind:
        """Return what a cell holds."""
        if is_missing(cell):
            return "empty"
        return "number" if self.is_number(cell) else kind_of_text(cell) or "text"

    def value(self, cell: str) -> float:
        """Return the number in a cell."""
        return float(cell.strip().replace(self.decimal_point, "."))


@dataclass(frozen=True, slots=True)
class _Row:
    """One line that is neither blank nor a comment."""

    number: int
    """Number of the line, counted from 0."""

    line: str
    cells: list[str]
    kinds: list[ColumnKind]

    def fits(self, kinds: Sequence[ColumnKind]) -> bool:
        """Return whether it is a sample of columns of these kinds."""
        return len(self.cells) == len(kinds) and all(
            have in (kind, "empty") or kind == "text" or (kind == "empty" and have != "text")
            for have, kind in zip(self.kinds, kinds, strict=True)
        )

    @property
    def missing(self) -> list[str]:
        """The cells without a value, as they are written."""
        pairs = zip(self.cells, self.kinds, strict=True)
        return [cell for cell, kind in pairs if kind == "empty"]

    def has_numbers(self, kinds: Sequence[ColumnKind]) -> bool:
        return len(self.cells) == len(kinds) and any(
            have == kind == "number" for have, kind in zip(self.kinds, kinds, strict=True)
        )


@dataclass(frozen=True, slots=True)
class _Above:
    """What stands above the samples."""

    begin: int
    """Number of the first sample's row."""

    titles: list[str]
    units: list[str]


@dataclass(frozen=True, slots=True)
class _Beginning:
    """The lines of a file's beginning, in the form they have."""

    lines: Sequence[str]
    form: Form
    path: Path

    def head(self, encoding: str, wanted: Wanted) -> TextHead:
        rows = [self._row(number) for number, line in enumerate(self.lines) if _holds_cells(line)]
        kinds = _kinds(rows)
        if not {"number", "empty"} & set(kinds):
            missing = "0 samples below the header" if len(rows) < 3 else "no column of numbers"
            raise FileError(f"{self.path}: {missing}; at least two samples are needed")
        above = self._above(rows, kinds)
        samples = rows[above.begin :]
        if not samples:
            raise FileError(f"{self.path}: 0 samples below the header; at least two are needed")
        preamble = self.lines[: samples[0].number]
        some = [row for row in samples[:JUDGED] if len(row.cells) == len(kinds)]
        titled = self._columns(above, kinds, some)
        self._require_no_thousands(titled, samples)
        columns = sort_columns(titled, self.path, wanted)
        given = [name for name, _ in self._names_and_units(above, kinds)]
        columns = renamed_columns(given, columns, self.path)
        return TextHead(
            encoding,
            self.form.delimiter,
            self.form.decimal_point,
            skipped=samples[0].number,
            columns=replace(
                columns,
                rate=stated_rate(preamble, self.form.decimal_point),
                start_ns=stated_start_ns(preamble, wanted.time),
            ),
            missing=tuple({cell for row in samples for cell in row.missing}),
            exact_time=self._has_long_times(some, columns.clock),
        )

    def _row(self, number: int) -> _Row:
        cells = self.form.cells(self.lines[number])
        return _Row(number, self.lines[number], cells, [self.form.kind(cell) for cell in cells])

    def _above(self, rows: Sequence[_Row], kinds: Sequence[ColumnKind]) -> _Above:
        """Titles and units; what they are about begins behind them, even with a broken row."""
        fit = next((i for i, row in enumerate(rows) if row.fits(kinds)), len(rows))
        titles, at = [], 0
        units: list[str] = []
        units_at = 0
        for i in reversed(range(fit)):
            cells = self._titles_in(rows[i], kinds)
            if cells is None or _is_statistics_row(cells):
                continue
            if not units and i and _are_units(cells) and self._titles_in(rows[i - 1], kinds):
                units, units_at = cells, i + 1
            elif _are_titles(cells, kinds):
                titles, at = cells, i + 1
                break
        begin = max(at, units_at)
        if not titles:
            lines = self.lines[: rows[fit].number if fit < len(rows) else len(self.lines)]
            titles = self._find_commented_titles(lines, len(kinds))
            begin = fit
            if not titles and fit:
                begin = self._begin_untitled(rows[fit - 1], fit, kinds)
        broken = (i for i in range(begin, fit) if rows[i].has_numbers(kinds))
        return _Above(next(broken, fit), titles, units)

    def _titles_in(self, row: _Row, kinds: Sequence[ColumnKind]) -> list[str] | None:
        """Return the cells of a row that may hold titles or units; None of one that cannot."""
        cells = self.form.titles(row.line, len(kinds))
        if cells is None or not any(cells):
            return None
        names_time = is_time_title(split_unit(cells[0])[0])
        cell_kinds = [self.form.kind(cell) for cell in cells]
        numbered = any(have == kind != "text" and have != "empty"
                       for have, kind in zip(cell_kinds, kinds, strict=True))  # fmt: skip
        return None if numbered and not names_time else cells

    def _find_commented_titles(self, lines: Sequence[str], count: int) -> list[str]:
        """Titles in the last comment above the samples, as `numpy.savetxt` writes them."""
        comments = [line for line in lines if line.lstrip().startswith(COMMENT)]
        cells = self.form.titles(comments[-1].strip().lstrip("#%/ "), count) if comments else None
        return cells if cells and any(self.form.kind(cell) == "text" for cell in cells) else []

    def _begin_untitled(self, nearest: _Row, fit: int, kinds: Sequence[ColumnKind]) -> int:
        """Return where the samples begin below a row that is neither sample nor titles.

        Raises
        ------
        FileError
            For titles, right above the samples, of which there are too few or many.
        """
        apart = len(self.lines) > nearest.number + 1 and not self.lines[nearest.number + 1].strip()
        if apart or len(nearest.cells) < 2 or states_measurement(nearest.line):
            return fit
        if nearest.has_numbers(kinds):
            return fit - 1
        raise FileError(
            f"{self.path}: line {nearest.number + 1} has {len(nearest.cells)} titles, the samples "
            f"below it {len(kinds)} columns"
        )

    def _require_no_thousands(self, columns: Sequence[Column], samples: Sequence[_Row]) -> None:
        """Refuse a column in which the decimal mark stands between thousands.

        All of its numbers with the mark are as 1,632 and 12,048,576, none as 0,163 or 1,5; and
        others, of up to three digits, have none: decimals of a fixed number always have the mark.

        Raises
        ------
        FileError
        """
        mark = self.form.decimal_point
        grouped = _GROUPED[mark]
        rows = [row.cells for row in samples if len(row.cells) == len(columns)]
        for column, cells in zip(columns, zip(*rows, strict=True), strict=True):
            numbers = [cell.strip() for cell in cells if self.form.is_number(cell)]
            marked = [cell for cell in numbers if mark in cell]
            plain = next((cell for cell in numbers if _BELOW_THOUSAND.fullmatch(cell)), "")
            if len(marked) >= FEWEST_GROUPED and plain and all(map(grouped.fullmatch, marked)):
                raise FileError(
                    f"{self.path}: column {column.title!r} has {marked[0]!r} and {plain!r}: "
                    f"numbers are needed without {mark!r} between thousands"
                )

    def _columns(
        self, above: _Above, kinds: Sequence[ColumnKind], samples: Sequence[_Row]
    ) -> list[Column]:
        titles = above.titles or [""] * len(kinds)
        split = self._names_and_units(above, kinds)
        names = distinct([name for name, _ in split])
        return [
            Column(name, unit, kind, self._first(samples, i, kind), titled=bool(titles[i].strip()))
            for i, (name, (_, unit), kind) in enumerate(zip(names, split, kinds, strict=True))
        ]

    def _names_and_units(self, above: _Above, kinds: Sequence[ColumnKind]) -> list[tuple[str, str]]:
        titles = above.titles or [""] * len(kinds)
        if not above.units:
            return [split_unit(title) for title in titles]
        units = [unit.strip("[]() ") for unit in above.units]
        return [(t, "" if u == "-" else u) for t, u in zip(titles, units, strict=True)]

    def _first(self, samples: Sequence[_Row], column: int, kind: ColumnKind) -> list[float | str]:
        cells = [row.cells[column] for row in samples if row.kinds[column] == kind]
        return [self.form.value(cell) if kind == "number" else cell.strip() for cell in cells]

    def _has_long_times(self, samples: Sequence[_Row], clock: Sequence[int]) -> bool:
        if len(clock) != 1:
            return False
        plain = re.compile(rf"\d+({re.escape(self.form.decimal_point)}\d{{1,12}})?")
        cells = [row.cells[clock[0]].strip() for row in samples]
        return bool(cells) and all(
            plain.fullmatch(cell) and self.form.value(cell) > ABSOLUTE for cell in cells
        )


def _kinds(rows: Sequence[_Row]) -> list[ColumnKind]:
    """Return what each column holds in the last rows."""
    judged = _last(rows)
    count = _count_of([row.cells for row in judged])
    regular = [row.kinds for row in judged if len(row.cells) == count]
    return [_most([kinds[column] for kinds in regular]) for column in range(count)]


def _most(kinds: Sequence[ColumnKind]) -> ColumnKind:
    seen = Counter[ColumnKind](kind for kind in kinds if kind != "empty")
    most = max(seen.values(), default=0)
    preferred: tuple[ColumnKind, ...] = ("number", "moment", "date", "time of day", "text")
    return next((kind for kind in preferred if most and seen[kind] == most), "empty")


def _are_titles(cells: Sequence[str], kinds: Sequence[ColumnKind]) -> bool:
    """Whether each column but the first and those that hold nothing has one."""
    return all(cell or kind == "empty" for cell, kind in zip(cells[1:], kinds[1:], strict=True))


def _are_units(cells: Sequence[str]) -> bool:
    if cells[:2] == ["TS", "RN"]:  # Campbell's TOA5: units of the time stamp and the record counter
        return True
    filled = [cell for cell in cells if cell]
    known = sum(
        is_unit(cell.strip("[]() ")) or cell[0] + cell[-1] in ("[]", "()") for cell in filled
    )
    return 2 * known >= len(filled)


def _is_statistics_row(cells: Sequence[str]) -> bool:
    """Whether a row states how each value was formed: sampled, averaged (Campbell's TOA5)."""
    stated = [cell.strip().lower() for cell in cells if cell.strip()]
    return bool(stated) and STATISTICS.issuperset(stated)
