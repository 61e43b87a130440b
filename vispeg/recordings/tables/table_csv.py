"""Reads a text table block by block: quickly where every cell is a number, else cell by cell to name what is not."""

from __future__ import annotations

import csv
import gzip
import io
import os
import zlib
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import refuse_special
from vispeg.recordings.tables.table import (
    MAX_BYTES,
    Columns,
    Dialect,
    Reading,
    Table,
    as_float,
    check_rows,
    checked_names,
)

BLOCK = 1 << 22  # bytes
MAX_LINE = 1 << 20


def read_csv(file: Path, reading: Reading) -> Table:
    """The table. Raises UserError for what is no text table, and for cells that are missing or too many."""
    with opened(file) as stream:
        head, second = _line(stream, file, 0), _line(stream, file, 1)
        if not head.strip():
            raise UserError("is empty" if not second.strip() else "has no header line", file=file)
        _refuse_dialect(head, second, reading.dialect, file)
        names = header(head, reading.dialect, file)
    wanted = reading.wanted(names)
    table = _all_numbers(file, names, wanted, reading) if wanted else None
    return table if table is not None else _cell_by_cell(file, names, wanted, reading)


def header(line: str, dialect: Dialect, file: Path) -> list[str]:
    """The names in a header line."""
    try:
        cells = next(csv.reader([line.rstrip("\r\n")], delimiter=dialect.separator))
        return checked_names([name.strip() for name in cells], file)
    except (csv.Error, StopIteration) as error:
        raise UserError(f"header line cannot be read: {error}", file=file) from error


@contextmanager
def opened(file: Path) -> Iterator[BinaryIO]:
    """The bytes of a file, unpacked where it is gzipped, without a byte order mark; `raw` says how far it is."""
    refuse_special(file)
    with file.open("rb") as raw:
        packed = file.suffix.lower() == ".gz"
        stream = _Limited(gzip.GzipFile(fileobj=raw) if packed else raw, raw, file)
        try:
            yield io.BufferedReader(stream, 1 << 18)  # type: ignore[return-value]
        except (gzip.BadGzipFile, zlib.error, EOFError) as error:
            raise UserError(f"is not a gzip file that can be read: {error}", file=file) from error


class _Limited(io.RawIOBase):
    """A stream without its byte order mark and without blank lines at its end, that ends a file grown too large."""

    def __init__(self, stream: Any, raw: BinaryIO, file: Path):
        self._stream, self.raw, self._file = stream, raw, file
        self._held, self._ready, self._count = b"", b"", 0

    def readable(self) -> bool:
        """It is."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Reads on; blank bytes are held back until something follows them."""
        while not self._ready:
            data = self._stream.read(1 << 18)
            if not data:
                return 0
            if not self._count:
                data = data.removeprefix(b"\xef\xbb\xbf")
            self._count += len(data)
            if self._count > MAX_BYTES:
                raise UserError("is too large", file=self._file, expected=f"at most {MAX_BYTES} bytes unpacked")
            solid = data.rstrip(b" \r\n")
            if solid:
                self._ready, self._held = self._held + solid, data[len(solid) :]
            else:
                self._held += data
        n = min(len(buffer), len(self._ready))
        buffer[:n], self._ready = self._ready[:n], self._ready[n:]
        return n


def _line(stream: BinaryIO, file: Path, number: int) -> str:
    line = stream.readline(MAX_LINE)
    try:
        return line.decode()
    except UnicodeDecodeError as error:
        raise UserError(f"is not UTF-8 text (line {number + 1}, byte {error.start})", file=file) from error


def _refuse_dialect(head: str, second: str, dialect: Dialect, file: Path) -> None:
    """The header decides between semicolons, tabs and commas: the wrong one makes one column of all."""
    separator = dialect.separator
    other = max((sign for sign in (",", ";", "\t") if sign != separator), key=head.count)
    if head.count(other) <= head.count(separator):
        return
    commas = other == ";" and "," in second
    also = ", and its numbers have decimal commas: write it with points and commas (1.5,2.5)" if commas else ""
    name = {";": "semicolons", "\t": "tabs", ",": "commas"}[other]
    raise UserError(f"columns are separated by {name}{also}", file=file, expected=repr(separator), got=other)


def _all_numbers(file: Path, names: list[str], wanted: list[str], reading: Reading) -> Table | None:
    """The wanted columns where each of their cells is a number or empty; None where a closer look is needed."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    collected, size = Columns(reading.retained(names)), max(os.stat(file).st_size, 1)
    convert = arrow.ConvertOptions(
        column_types=dict.fromkeys(wanted, pa.float64()),
        include_columns=wanted,
        null_values=[""],
        decimal_point=reading.dialect.decimal,
    )
    try:
        with opened(file) as stream:
            limited: Any = stream.raw  # type: ignore[attr-defined]
            stream.readline()
            source = arrow.open_csv(
                stream,
                arrow.ReadOptions(column_names=names, use_threads=False, block_size=BLOCK),
                arrow.ParseOptions(ignore_empty_lines=False, delimiter=reading.dialect.separator),
                convert,
            )
            for batch in source:
                block = {name: batch.column(name).to_numpy(zero_copy_only=False) for name in wanted}
                if reading.look is not None:
                    reading.look(Table(file, block, names, batch.num_rows, 2 + collected.rows))
                collected.add(block, batch.num_rows)
                check_rows(collected.rows, file)
                reading.progress(limited.raw.tell() / size)
                if reading.enough(collected.rows):
                    break
    except pa.ArrowException:
        return None
    return Table(file, collected.done(), names, collected.rows, 2)


def _cell_by_cell(file: Path, names: list[str], wanted: list[str], reading: Reading) -> Table:
    columns = {names.index(name): array("d") for name in wanted}
    text: dict[str, tuple[int, str]] = {}
    point = reading.dialect.decimal
    rows = 0
    with opened(file) as stream:
        stream.readline()
        lines = (_line(stream, file, n) for n in range(1, 1 << 62))
        try:
            for number, cells in enumerate(csv.reader(_until_empty(lines), delimiter=reading.dialect.separator), 2):
                if len(cells) != len(names):
                    raise _torn(file, number, cells, names)
                for i, column in columns.items():
                    value = as_float(cells[i] if point == "." else cells[i].replace(point, "."))
                    if value is None:
                        text.setdefault(names[i], (number, cells[i]))
                        value = np.nan
                    column.append(value)
                rows += 1
                check_rows(rows, file)
                if reading.enough(rows):
                    break
        except csv.Error as error:
            raise UserError(f"cannot be read: {error}", file=file) from error
    values = {names[i]: np.array(column) for i, column in columns.items() if names[i] not in text}
    table = Table(file, values, names, rows, 2, text)
    if reading.look is not None:
        reading.look(table)
    return table


def _until_empty(lines: Iterator[str]) -> Iterator[str]:
    for line in lines:
        if not line:
            return
        yield line


def _torn(file: Path, number: int, cells: list[str], names: list[str]) -> UserError:
    numeric = all("." not in cell and as_float(cell) is not None for cell in cells)
    commas = numeric and len(names) < len(cells) <= 2 * len(names)
    why = "looks like decimal commas: write 1.5, not 1,5" if commas else "cut off?"
    message = f"has the wrong number of cells ({why})"
    return UserError(message, file=file, key=f"row {number}", expected=len(names), got=len(cells))
