"""Read a text table block by block: fast if every cell is a number, else cell by cell to locate the one that is not."""

from __future__ import annotations

import csv
import gzip
import io
import os
import re
import zlib
from array import array
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
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
RUNS = re.compile(rb"[ \t\r\n]+")
COMMENT, MOST_COMMENTS = "#%", 1000


@dataclass(frozen=True)
class Head:
    """The lines before the samples of a text table.

    Attributes:
        names: column names.
        lines: number of lines before the first sample.
        comments: those lines that are not the header, as text, without empty ones.
    """

    names: list[str]
    lines: int
    comments: tuple[str, ...] = ()


def read_csv(file: Path, reading: Reading) -> Table:
    """Read a text table. Raises UserError: not a text table, or a row with too few or too many cells."""
    with opened(file) as stream:
        head = _head(stream, file, reading.dialect)
    wanted = reading.wanted(head.names)
    table = _all_numbers(file, head, wanted, reading) if wanted else None
    return table if table is not None else _cell_by_cell(file, head, wanted, reading)


def _head(stream: BinaryIO, file: Path, dialect: Dialect) -> Head:
    """Read up to the first sample. Raises UserError: no header or sample with this dialect."""
    before: list[str] = []
    while True:
        line = _line(stream, file, len(before))
        if not line:
            raise UserError("is empty" if not before else "has no header line", file=file)
        if line.strip() and line.lstrip()[0] not in COMMENT:
            break
        before.append(line)
        if len(before) > MOST_COMMENTS:
            raise UserError("has no header line", file=file, expected=f"one after {MOST_COMMENTS} comments at most")
    first = split_cells(line, dialect)
    said = [i for i, text in enumerate(before) if text.strip()]
    told = uncommented(before[said[-1]], dialect) if said else []
    numeric = [as_float(cell.replace(dialect.decimal, ".")) is not None for cell in first]
    if told and len(told) == len(first) > 1 and any(numeric):  # np.savetxt, gnuplot, rostopic: the header is a comment
        names, lines = told, len(before)
        before = [text for i, text in enumerate(before) if i != said[-1]]
    elif all(numeric):
        names, lines = list(dialect.names) or [str(k + 1) for k in range(len(first))], len(before)
        if len(names) != len(first):
            got = f"{len(names)} names"
            raise UserError("has another number of columns", file=file, key="--columns", expected=len(first), got=got)
    else:
        _refuse_dialect(line, _line(stream, file, len(before) + 1), dialect, file)
        names, lines = first, len(before) + 1
    comments = tuple(text.strip() for text in before if text.strip())
    return Head(checked_names([name.strip() for name in names], file), lines, comments)


def uncommented(line: str, dialect: Dialect) -> list[str]:
    """Return the cells of a comment line without its comment sign; rostopic's `%time` is a name and is kept."""
    text = line.lstrip()
    return split_cells(text if text[0] == "%" and text[1:2].isalpha() else text[1:].lstrip(), dialect)


def split_cells(line: str, dialect: Dialect) -> list[str]:
    """Split a line into cells; empty if it cannot be split."""
    line = line.rstrip("\r\n")
    if dialect.separator == " ":
        return line.split()
    try:
        return next(csv.reader([line], delimiter=dialect.separator), [])
    except csv.Error:
        return []


@contextmanager
def opened(file: Path, blanks: bool = False) -> Iterator[io.BufferedReader]:
    """Open a file as bytes, decompressed if gzipped, without a byte order mark; `raw` tells the position in the file.

    With `blanks`, every run of blanks and tabs becomes one blank, and those at the ends of a line are removed.
    """
    refuse_special(file)
    with file.open("rb") as raw:
        packed = file.suffix.lower() == ".gz"
        stream = _Limited(gzip.GzipFile(fileobj=raw) if packed else raw, raw, file, blanks)
        try:
            yield io.BufferedReader(stream, 1 << 18)
        except (gzip.BadGzipFile, zlib.error, EOFError) as error:
            raise UserError(f"is not a gzip file that can be read: {error}", file=file) from error


class _Limited(io.RawIOBase):
    """A stream without byte order mark and trailing blank lines, which refuses a file that unpacks too large."""

    def __init__(self, stream: Any, raw: BinaryIO, file: Path, blanks: bool = False):
        self._stream, self.raw, self._file, self._blanks = stream, raw, file, blanks
        self._held, self._ready, self._count = b"", b"", 0

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read the next bytes; blank bytes are held back until something follows them."""
        while not self._ready:
            data = self._stream.read(1 << 18)
            if not data:
                return 0
            if not self._count:
                data = data.removeprefix(b"\xef\xbb\xbf")
                data = data.lstrip(b" \t") if self._blanks else data
            self._count += len(data)
            if self._count > MAX_BYTES:
                raise UserError("is too large", file=self._file, expected=f"at most {MAX_BYTES} bytes unpacked")
            solid = data.rstrip(b" \t\r\n" if self._blanks else b" \r\n")
            if solid:
                self._ready, self._held = self._held + solid, data[len(solid) :]
                self._ready = RUNS.sub(_one, self._ready) if self._blanks else self._ready
            else:
                self._held += data
        n = min(len(buffer), len(self._ready))
        buffer[:n], self._ready = self._ready[:n], self._ready[n:]
        return n


def _one(run: re.Match[bytes]) -> bytes:
    """Replace a run of blanks by a line end if it contains one, else by one blank."""
    return b"\n" * run[0].count(b"\n") or b" "


def _line(stream: BinaryIO, file: Path, number: int) -> str:
    line = stream.readline(MAX_LINE)
    try:
        return line.decode()
    except UnicodeDecodeError as error:
        raise UserError(f"is not UTF-8 text (line {number + 1}, byte {error.start})", file=file) from error


def _refuse_dialect(head: str, second: str, dialect: Dialect, file: Path) -> None:
    """Refuse a wrong separator, judged by the header: with a wrong one, all of it would be one column."""
    separator = dialect.separator
    other = max((sign for sign in (",", ";", "\t") if sign != separator), key=head.count)
    if head.count(other) <= head.count(separator):
        return
    commas = other == ";" and "," in second
    also = ", and its numbers have decimal commas: write it with points and commas (1.5,2.5)" if commas else ""
    name = {";": "semicolons", "\t": "tabs", ",": "commas"}[other]
    raise UserError(f"columns are separated by {name}{also}", file=file, expected=repr(separator), got=other)


def _all_numbers(file: Path, head: Head, wanted: list[str], reading: Reading) -> Table | None:
    """Read the wanted columns if each of their cells is a number or empty; None if they must be read cell by cell."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    names, first = head.names, head.lines + 1
    collected, size = Columns(reading.retained(names)), max(os.stat(file).st_size, 1)
    convert = arrow.ConvertOptions(
        column_types=dict.fromkeys(wanted, pa.float64()),
        include_columns=wanted,
        null_values=[""],
        decimal_point=reading.dialect.decimal,
    )
    try:
        with opened(file, reading.dialect.separator == " ") as stream:
            limited: Any = stream.raw  # a `_Limited`
            for _ in range(head.lines):
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
                    reading.look(Table(file, block, names, batch.num_rows, first + collected.rows))
                collected.add(block, batch.num_rows)
                check_rows(collected.rows, file)
                reading.progress(limited.raw.tell() / size)
                if reading.enough(collected.rows):
                    break
    except pa.ArrowException:
        return None
    return Table(file, collected.done(), names, collected.rows, first, comments=head.comments)


def _cell_by_cell(file: Path, head: Head, wanted: list[str], reading: Reading) -> Table:
    names, first = head.names, head.lines + 1
    columns = {names.index(name): array("d") for name in wanted}
    text: dict[str, tuple[int, str]] = {}
    point = reading.dialect.decimal
    rows = 0
    with opened(file, reading.dialect.separator == " ") as stream:
        for _ in range(head.lines):
            stream.readline()
        lines = (_line(stream, file, n) for n in range(head.lines, 1 << 62))
        try:
            for number, cells in enumerate(csv.reader(_until_empty(lines), delimiter=reading.dialect.separator), first):
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
    every = {names[i]: np.array(column) for i, column in columns.items()}
    values = {name: column for name, column in every.items() if name not in text}
    mixed = frozenset(name for name in text if np.isfinite(every[name]).any())
    table = Table(file, values, names, rows, first, text, head.comments, mixed)
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
