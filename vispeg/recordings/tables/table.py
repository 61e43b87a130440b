"""Read a table of numbers from CSV or Parquet; errors name row and column of a cell that is not a number.

A table is read block by block and only requested columns are kept, so that half an hour at 1 kHz needs little more
memory than its numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, time
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError

MAX_BYTES = 2_000_000_000
MAX_ROWS = 5_000_000
MAX_COLUMNS = 5_000


@dataclass(frozen=True)
class Dialect:
    """How a text table is written: its cell separator and decimal mark.

    Attributes:
        separator: between cells; " " is any run of blanks.
        decimal: decimal mark in numbers.
        names: column names for a table without a header line; without any, columns are numbered from 1.
    """

    separator: str = ","
    decimal: str = "."
    names: tuple[str, ...] = ()


@dataclass(frozen=True)
class Table:
    """Columns by name, each (n,) float64 with NaN for an empty cell.

    Attributes:
        file: where it came from.
        columns: name -> values, of the columns that were kept.
        names: all columns in the order of the file.
        rows: number of samples.
        numbers: number of each sample in messages: its line in a text table, its index elsewhere.
        text: name -> (row, cell) of the first cell that is not a number; such a column is not in `columns`.
        mixed: names of those text columns that hold numbers too.
        comments: the lines before the header, as text.
        dates: names of those columns whose cells are dates or times of day, which became s (`as_seconds`).
        origin: name -> name in the file, of columns that a map renamed.
    """

    file: Path
    columns: dict[str, np.ndarray]
    names: list[str]
    rows: int
    numbers: range | np.ndarray
    text: dict[str, tuple[int, str]] = field(default_factory=dict)
    comments: tuple[str, ...] = ()
    mixed: frozenset[str] = frozenset()
    dates: frozenset[str] = frozenset()
    origin: Mapping[str, str] = field(default_factory=dict)

    def column(self, name: str) -> str:
        """Name a column as in messages: as it is in the file, and what it was mapped to."""
        origin = self.origin.get(name, name)
        return f"column {name}" if origin == name else f"column {origin} ({name})"

    def row(self, index: int | np.integer) -> str:
        """Name the sample at `index` as in messages."""
        return f"row {int(self.numbers[int(index)])}"

    def number(self, name: str) -> np.ndarray:
        """Return a column (n,). Raises UserError if it is absent or has a cell that is not a number."""
        if name in self.text:
            row, cell = self.text[name]
            point = cell.strip().replace(",", ".")
            comma = point != cell.strip() and as_float(point) is not None
            expected = f"a decimal point ({point})" if comma else None
            message = "has a decimal comma" if comma else "is not a date" if name in self.dates else "is not a number"
            raise UserError(message, file=self.file, key=f"row {row}, column {name}", expected=expected, got=cell)
        if name not in self.names:
            raise UserError("column is missing", file=self.file, got=name, choices=self.names)
        return self.columns[name]


@dataclass(frozen=True)
class Reading:
    """Which columns of a table to read, and callbacks while reading.

    Attributes:
        keep: column names in the file -> those to keep; the others are not even converted. None keeps all.
        glance: column names in the file -> those that are passed to `look` although they are not kept.
        look: called with every block as it is read; raises UserError for impossible values.
        progress: called with the share that has been read, 0 to 1.
        most_rows: reading stops once at least this many rows are read; None reads all.
        dialect: cell separator and decimal mark of a text table.
    """

    keep: Callable[[list[str]], Collection[str]] | None = None
    glance: Callable[[list[str]], Collection[str]] = lambda names: ()
    look: Callable[[Table], None] | None = None
    progress: Callable[[float], None] = lambda share: None
    most_rows: int | None = None
    dialect: Dialect = Dialect()

    def retained(self, names: list[str]) -> list[str]:
        """Return those of `names` that are kept, in the file's order."""
        return _in_order(names, self.keep(names)) if self.keep is not None else names

    def wanted(self, names: list[str]) -> list[str]:
        """Return those of `names` that are kept or passed to `look`, in the file's order."""
        return _in_order(names, [*self.retained(names), *self.glance(names)])

    def enough(self, rows: int) -> bool:
        """Return whether reading may stop."""
        return self.most_rows is not None and rows >= self.most_rows


def _in_order(names: list[str], selected: Collection[str]) -> list[str]:
    chosen = set(selected)
    return [name for name in names if name in chosen]


def checked_names(names: list[str], file: Path) -> list[str]:
    """Return a header's names. Raises UserError: too many, or a duplicate."""
    if len(names) > MAX_COLUMNS:
        raise UserError("has too many columns", file=file, expected=f"at most {MAX_COLUMNS}", got=len(names))
    earlier: set[str] = set()
    for name in names:
        if name in earlier:
            raise UserError("column is given twice", file=file, key=name)
        earlier.add(name)
    return names


def check_rows(rows: int, file: Path) -> None:
    """Raise UserError if a table has more rows than are supported."""
    if rows > MAX_ROWS:
        raise UserError("has too many rows", file=file, expected=f"at most {MAX_ROWS}; split it")


def as_float(cell: str) -> float | None:
    """Parse a cell: its number, NaN if it is empty, None if it is not a number."""
    cell = cell.strip()
    if not cell:
        return np.nan
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def as_seconds(cell: str) -> float | None:
    """Parse a date or a time of day in ISO 8601: s since 1970 (UTC where no zone is stated), or since midnight.

    NaN if the cell is empty, None if it is neither. Digits beyond the microsecond are dropped.
    """
    cell = cell.strip()
    if not cell:
        return np.nan
    try:
        date = datetime.fromisoformat(cell)
    except ValueError:
        if ":" not in cell:  # the number 11,5 would be half a second past eleven
            return None
        try:
            day = time.fromisoformat(cell)
        except ValueError:
            return None
        return (((day.hour * 60 + day.minute) * 60 + day.second) * 1_000_000 + day.microsecond) / 1e6
    return (date if date.tzinfo else date.replace(tzinfo=UTC)).timestamp()


def is_date(kind: Any) -> bool:
    """Return whether an Arrow type is of dates with times, or of times of day."""
    import pyarrow as pa

    return pa.types.is_timestamp(kind) or pa.types.is_time(kind)


def seconds_of(column: Any) -> np.ndarray:
    """Return an Arrow array of dates or times of day as `as_seconds` returns their text, (n,) s."""
    import pyarrow as pa
    from pyarrow import compute

    zone = getattr(column.type, "tz", None)
    finer = pa.timestamp("ns", zone) if pa.types.is_timestamp(column.type) else pa.time64("ns")
    whole = compute.divide(column.cast(finer).cast(pa.int64()), 1000)  # us: float64 holds them exactly
    return whole.cast(pa.float64()).to_numpy(zero_copy_only=False) / 1e6


class Columns:
    """Columns (n,) that grow block by block, in place, so that memory holds no block twice."""

    def __init__(self, names: list[str], rows: int = 1 << 20):
        self._values = {name: np.empty(rows) for name in names}
        self.rows = 0

    def add(self, block: dict[str, np.ndarray], rows: int) -> None:
        """Append the next rows of every column."""
        end = self.rows + rows
        for name, values in self._values.items():
            if end > len(values):
                self._values[name] = values = np.concatenate([values[: self.rows], np.empty(max(end, len(values)))])
            values[self.rows : end] = block[name]
        self.rows = end

    def done(self) -> dict[str, np.ndarray]:
        """Return the columns after the last block."""
        return {name: values[: self.rows] for name, values in self._values.items()}
