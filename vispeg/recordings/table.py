"""Reads a table of numbers from CSV or Parquet, naming the row and column of what is not a number."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from vispeg.core.errors import UserError

MAX_BYTES = 2_000_000_000
MAX_ROWS = 5_000_000
MAX_COLUMNS = 5_000


@dataclass(frozen=True)
class Table:
    """Columns by name, each (n,) float64 with NaN for an empty cell.

    Attributes:
        file: where it came from.
        columns: name -> values.
        text: name -> (row, cell) of the first cell that is not a number; such a column is not in `columns`.
        first_row: what a message calls the first sample: 2 in a CSV (line 1 is the header), 0 in Parquet.
        names: all columns in the order of the file.
        rows: number of samples.
    """

    file: Path
    columns: dict[str, np.ndarray]
    names: list[str]
    rows: int
    first_row: int
    text: dict[str, tuple[int, str]] = field(default_factory=dict)

    def row(self, index: int | np.integer) -> str:
        """How a message names the sample at `index`."""
        return f"row {self.first_row + int(index)}"

    def number(self, name: str) -> np.ndarray:
        """A column, (n,). Raises UserError if it is absent or holds something that is not a number."""
        if name in self.text:
            row, cell = self.text[name]
            point = cell.strip().replace(",", ".")
            comma = point != cell.strip() and _float(point) is not None
            expected = f"a decimal point ({point})" if comma else None
            message = "has a decimal comma" if comma else "is not a number"
            raise UserError(message, file=self.file, key=f"row {row}, column {name}", expected=expected, got=cell)
        if name not in self.columns:
            raise UserError("column is missing", file=self.file, got=name, choices=self.names)
        return self.columns[name]


def read_table(file: Path) -> Table:
    """Reads a .csv or .parquet file. Raises UserError for anything that is not a table with a header and samples."""
    try:
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise UserError("is too large", file=file, expected=f"at most {MAX_BYTES} bytes; split it", got=size)
        table = _parquet(file) if file.suffix == ".parquet" else _csv(file)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or error}", file=file) from error
    if table.rows == 0:
        raise UserError("holds no samples", file=file)
    return table


def _header(names: list[str], file: Path) -> list[str]:
    if len(names) > MAX_COLUMNS:
        raise UserError("has too many columns", file=file, expected=f"at most {MAX_COLUMNS}", got=len(names))
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise UserError("column is given twice", file=file, key=name)
        seen.add(name)
    return names


def _csv(file: Path) -> Table:
    try:
        text = file.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"is not UTF-8 text (byte {error.start})", file=file) from error
    head, _, body = text.partition("\n")
    if not head.strip():
        raise UserError("is empty" if not text.strip() else "has no header line", file=file)
    other = max((";", "\t"), key=head.count)
    if head.count(other) > head.count(","):
        commas = other == ";" and "," in body.partition("\n")[0]
        also = ", and its numbers have decimal commas: write it with points and commas (1.5,2.5)" if commas else ""
        name = "semicolons" if other == ";" else "tabs"
        raise UserError(f"columns are separated by {name}{also}", file=file, expected="','", got=other)
    try:
        names = _header([name.strip() for name in next(csv.reader([head.rstrip("\r")]))], file)
    except (csv.Error, StopIteration) as error:
        raise UserError(f"header line cannot be read: {error}", file=file) from error
    if body.count("\n") > MAX_ROWS:
        raise UserError("has too many rows", file=file, expected=f"at most {MAX_ROWS}; split it")
    if not body.strip():
        return Table(file, {}, names, 0, 2)
    quick = _all_numbers(body, names)
    return Table(file, quick, names, len(quick[names[0]]), 2) if quick else _cell_by_cell(file, names, body)


def _all_numbers(body: str, names: list[str]) -> dict[str, np.ndarray] | None:
    """The columns where every cell is a number or empty; None where a closer look is needed."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    try:
        table = arrow.read_csv(
            pa.BufferReader(body.rstrip().encode()),
            arrow.ReadOptions(column_names=names, use_threads=False),
            arrow.ParseOptions(ignore_empty_lines=False),
            arrow.ConvertOptions(column_types=dict.fromkeys(names, pa.float64()), null_values=[""]),
        )
    except pa.ArrowException:
        return None
    return {name: table.column(name).to_numpy(zero_copy_only=False).copy() for name in names}


def _cell_by_cell(file: Path, names: list[str], body: str) -> Table:
    columns: list[list[float]] = [[] for _ in names]
    text: dict[str, tuple[int, str]] = {}
    lines = body.rstrip().splitlines()
    try:
        for number, cells in enumerate(csv.reader(lines), start=2):
            if len(cells) != len(names):
                whole = all("." not in cell and _float(cell) is not None for cell in cells)
                commas = whole and len(names) < len(cells) <= 2 * len(names)
                why = "looks like decimal commas: write 1.5, not 1,5" if commas else "cut off?"
                key, got = f"row {number}", len(cells)
                message = f"has the wrong number of cells ({why})"
                raise UserError(message, file=file, key=key, expected=len(names), got=got)
            for name, column, cell in zip(names, columns, cells, strict=True):
                value = _float(cell)
                if value is None:
                    text.setdefault(name, (number, cell))
                    value = np.nan
                column.append(value)
    except csv.Error as error:
        raise UserError(f"cannot be read: {error}", file=file) from error
    values = {name: np.array(column) for name, column in zip(names, columns, strict=True) if name not in text}
    return Table(file, values, names, len(columns[0]), 2, text)


def _float(cell: str) -> float | None:
    cell = cell.strip()
    if not cell:
        return np.nan
    try:
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _parquet(file: Path) -> Table:
    import pyarrow as pa
    import pyarrow.parquet as pq

    values: dict[str, np.ndarray] = {}
    text: dict[str, tuple[int, str]] = {}
    try:
        with pq.ParquetFile(file) as source:
            names = _header(list(source.schema_arrow.names), file)
            if source.metadata.num_rows > MAX_ROWS:
                raise UserError("has too many rows", file=file, expected=f"at most {MAX_ROWS}; split it")
            table = source.read()
        for name in names:
            column = table.column(name)
            kind = column.type
            if pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_null(kind):
                values[name] = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False).copy()
            else:
                text[name] = (0, f"a column of {kind}")
    except (pa.ArrowException, OSError, ValueError, OverflowError, NotImplementedError, MemoryError) as error:
        raise UserError(f"is not a Parquet file that can be read: {error}", file=file) from error
    return Table(file, values, names, table.num_rows, 0, text)
