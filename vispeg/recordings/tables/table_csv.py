"""Read a text table block by block: fast if every cell is a number, else cell by cell to locate the one that is not."""

from __future__ import annotations

import codecs
import csv
import gzip
import io
import os
import re
import zlib
from array import array
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import count
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import MARKS, recoded, refuse_special
from vispeg.recordings.tables.table import (
    MAX_BYTES,
    Columns,
    Dialect,
    Reading,
    Table,
    as_float,
    as_seconds,
    check_rows,
    checked_names,
    seconds_of,
)

BLOCK = 1 << 22  # bytes
MAX_LINE = 1 << 20  # bytes
BLANKS = re.compile(rb"[ \t\r\n]+")
SEPARATOR_LINE = re.compile(r'"?sep=([^\w.+"-])"?', re.IGNORECASE)  # first line of a table that Excel is to open
COMMENT, MOST_COMMENTS = "#%", 1000


@dataclass(frozen=True)
class Head:
    """The lines before the samples of a text table.

    Attributes:
        names: column names.
        lines: number of lines up to the header, or before the first sample of a table without one.
        dialect: how the table is written; the separator is that of its first line if that states one (`sep=;`).
        dates: zones of the columns whose first cell is a date (True: it states a zone) or time of day (None).
        comments: those lines that are not the header, as text, without empty ones.
    """

    names: list[str]
    lines: int
    dialect: Dialect
    dates: dict[str, bool | None]
    comments: tuple[str, ...] = ()


def read_csv(file: Path, reading: Reading) -> Table:
    """Read a text table. Raises UserError: not a text table, or a row with too few or too many cells."""
    with opened(file) as stream:
        head = _head(stream, file, reading.dialect)
    reading = replace(reading, dialect=head.dialect)
    wanted = reading.wanted(head.names)
    table = _all_numbers(file, head, wanted, reading) if wanted else None
    return table if table is not None else _cell_by_cell(file, head, wanted, reading)


def _head(stream: BinaryIO, file: Path, dialect: Dialect) -> Head:
    """Read up to the first sample. Raises UserError: no header or sample with this dialect."""
    before: list[str] = []
    line, offset = _line(stream, file, 0), 0
    if separator := told_separator(line):
        dialect, offset = replace(dialect, separator=separator), 1
        line = _line(stream, file, 1)
    while True:
        if not line:
            raise UserError("is empty" if not before else "has no header line", file=file)
        if line.strip() and line.lstrip()[0] not in COMMENT:
            break
        before.append(line)
        if len(before) > MOST_COMMENTS:
            raise UserError("has no header line", file=file, expected=f"one after {MOST_COMMENTS} comments at most")
        line = _line(stream, file, len(before) + offset)
    first = split_cells(line, dialect)
    filled = [i for i, text in enumerate(before) if text.strip()]
    last_comment = uncommented(before[filled[-1]], dialect) if filled else []
    numeric = [
        as_float(cell.replace(dialect.decimal, ".")) is not None or as_seconds(cell) is not None for cell in first
    ]
    if last_comment and len(last_comment) == len(first) > 1 and any(numeric):
        # np.savetxt, gnuplot, rostopic: the header is a comment
        names, lines, sample = last_comment, len(before), first
        before = [text for i, text in enumerate(before) if i != filled[-1]]
    elif all(numeric):
        names, lines = list(dialect.names) or [str(k + 1) for k in range(len(first))], len(before)
        sample = first
        if len(names) != len(first):
            got = f"{len(names)} names"
            raise UserError("has another number of columns", file=file, key="--columns", expected=len(first), got=got)
    else:
        second = _line(stream, file, len(before) + offset + 1)
        while second and not second.strip():
            second = _line(stream, file, len(before) + offset + 1)
        _refuse_dialect(line, second, dialect, file)
        names, lines, sample = first, len(before) + 1, split_cells(second, dialect)
    comments = tuple(text.strip() for text in before if text.strip())
    names = checked_names([name.strip() for name in names], file)
    dates = {name: _zone(cell) for name, cell in zip(names, sample, strict=False) if _is_date(cell)}
    return Head(names, lines + offset, dialect, dates, comments)


def told_separator(line: str) -> str:
    """Return the separator that a table's first line states as Excel does (`sep=;`); empty if it is no such line."""
    match = SEPARATOR_LINE.fullmatch(line.rstrip("\r\n"))
    return match[1] if match else ""


def _is_date(cell: str) -> bool:
    return as_float(cell) is None and as_seconds(cell) is not None


def _zone(cell: str) -> bool | None:
    """Return whether a date states its zone; None for a time of day."""
    try:
        return datetime.fromisoformat(cell.strip()).tzinfo is not None
    except ValueError:
        return None


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
    """Open a file as UTF-8, decompressed if gzipped, without its byte order mark; `raw` tells the position in the file.

    A mark of UTF-16 or UTF-32, as Excel's "Unicode text" has, says which encoding to convert from.

    With `blanks`, every run of blanks and tabs becomes one blank, and those at the ends of a line are removed.
    """
    refuse_special(file)
    with file.open("rb") as raw:
        source: Any = gzip.GzipFile(fileobj=raw) if file.suffix.lower() == ".gz" else raw
        encoding = "UTF-8"
        try:
            start = source.peek(4)
            encoding = next((name for mark, name in MARKS.items() if start.startswith(mark)), encoding)
            source = source if encoding == "UTF-8" else codecs.EncodedFile(source, "UTF-8", encoding)
            yield io.BufferedReader(_Limited(source, raw, file, blanks), 1 << 18)
        except UnicodeDecodeError as error:
            expected = recoded(file) if encoding == "UTF-8" else f"{encoding}, as its first bytes say"
            raise UserError(f"is not {encoding} text", file=file, expected=expected) from error
        except (gzip.BadGzipFile, zlib.error, EOFError) as error:
            raise UserError(f"is not a gzip file that can be read: {error}", file=file) from error


class _Limited(io.RawIOBase):
    """A stream without byte order mark and trailing blank lines, which refuses a file that unpacks too large."""

    def __init__(self, stream: Any, raw: BinaryIO, file: Path, blanks: bool):
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
                data = data.removeprefix(codecs.BOM_UTF8)
                data = data.lstrip(b" \t") if self._blanks else data
            self._count += len(data)
            if self._count > MAX_BYTES:
                raise UserError("is too large", file=self._file, expected=f"at most {MAX_BYTES} bytes unpacked")
            solid = data.rstrip(b" \t\r\n" if self._blanks else b" \r\n")
            if solid:
                self._ready, self._held = self._held + solid, data[len(solid) :]
                self._ready = BLANKS.sub(_one_blank, self._ready) if self._blanks else self._ready
            else:
                self._held += data
        n = min(len(buffer), len(self._ready))
        buffer[:n], self._ready = self._ready[:n], self._ready[n:]
        return n


class _Lines(io.RawIOBase):
    """The rest of a text table without its empty lines, which separate blocks and are no samples.

    Args:
        stream: behind the header.
        first: number of its next line in the file.
        separator: between cells; other blanks may stand in an empty line. None keeps every line, for a table of one
            column, whose empty line is an empty cell.
    """

    def __init__(self, stream: io.BufferedReader, first: int, separator: str | None):
        blank = "".join(sign for sign in " \t\r" if sign != separator)
        self._empty = None if separator is None else re.compile(f"\n(?:[{blank}]*\n)+".encode())
        self._stream, self._first, self._ready, self._count = stream, first, b"", 0
        self._gaps: list[int] = []  # for every empty line: the number of lines before it that are kept

    def readable(self) -> bool:
        """Return True."""
        return True

    def readinto(self, buffer: Any) -> int:
        """Read the next bytes: whole lines of the stream, in pieces."""
        while not self._ready:
            data = self._stream.read(BLOCK >> 4)
            if not data:
                return 0
            self._ready = self._solid(data + self._stream.readline(MAX_LINE))
        n = min(len(buffer), len(self._ready))
        buffer[:n], self._ready = self._ready[:n], self._ready[n:]
        return n

    def _solid(self, lines: bytes) -> bytes:
        if self._empty is None:
            return lines
        kept, end = [], 0
        lines = b"\n" + lines  # so that an empty first line is found as any other
        for run in self._empty.finditer(lines):
            kept.append(lines[end : run.start() + 1])
            self._count += kept[-1].count(b"\n") - (end == 0)
            self._gaps += [self._count] * (run[0].count(b"\n") - 1)
            end = run.end()
        kept.append(lines[end:])
        self._count += kept[-1].count(b"\n") - (end == 0)
        return b"".join(kept)[1:]

    def number(self, row: int) -> int:
        """Return the number in the file of the `row`-th line that is kept, of those that have been read."""
        return self._first + row + bisect_right(self._gaps, row)

    def numbers(self, start: int, stop: int) -> range | np.ndarray:
        """Return the numbers of the kept lines from `start` to before `stop`."""
        if not self._gaps:
            return range(self._first + start, self._first + stop)
        rows = np.arange(start, stop)
        return self._first + rows + np.searchsorted(self._gaps, rows, side="right")


@contextmanager
def _samples(file: Path, head: Head) -> Iterator[tuple[io.BufferedReader, _Lines, Any]]:
    """Open a table behind its header: the stream of its samples, their line numbers, and the raw file."""
    separator = head.dialect.separator
    with opened(file, separator == " ") as stream:
        for _ in range(head.lines):
            stream.readline()
        limited: Any = stream.raw  # a `_Limited`
        lines = _Lines(stream, head.lines + 1, separator if len(head.names) > 1 else None)
        yield io.BufferedReader(lines, 1 << 18), lines, limited.raw


def _one_blank(run: re.Match[bytes]) -> bytes:
    """Replace a run of blanks by a line end if it contains one, else by one blank."""
    return b"\n" * run[0].count(b"\n") or b" "


def _line(stream: BinaryIO, file: Path, number: int) -> str:
    line = stream.readline(MAX_LINE)
    try:
        return line.decode()
    except UnicodeDecodeError as error:
        where = f"line {number + 1}, byte {error.start}"
        raise UserError(f"is not UTF-8 text ({where})", file=file, expected=recoded(file, data=line)) from error


def _refuse_dialect(head: str, second: str, dialect: Dialect, file: Path) -> None:
    """Refuse a wrong separator, judged by the header: with a wrong one, all of it would be one column."""
    separator = dialect.separator
    other = max((sign for sign in (",", ";", "\t") if sign != separator), key=head.count)
    if head.count(other) <= head.count(separator):
        return
    commas = other != "," and "," in second
    also, mark = (", and its numbers have decimal commas", ', decimal: ","') if commas else ("", "")
    points = " and decimal points" if commas else ""
    name = {";": "semicolons", "\t": "tabs", ",": "commas"}[other]
    written = f'table: {{separator: "{other}"{mark}}}'.replace("\t", "\\t")
    expected = f"{separator!r}{points}; of a log, `vispeg convert` reads it with --guess, or a map with {written}"
    raise UserError(f"columns are separated by {name}{also}", file=file, expected=expected)


def _all_numbers(file: Path, head: Head, wanted: list[str], reading: Reading) -> Table | None:
    """Read the wanted columns if each of their cells is a number or empty; None if they must be read cell by cell."""
    import pyarrow as pa
    from pyarrow import csv as arrow

    names = head.names
    collected, size = Columns(reading.retained(names)), max(os.stat(file).st_size, 1)
    date_types = {True: pa.timestamp("ns", "UTC"), False: pa.timestamp("ns"), None: pa.time64("ns")}
    types = {name: date_types[head.dates[name]] if name in head.dates else pa.float64() for name in wanted}
    convert = arrow.ConvertOptions(
        column_types=types,
        include_columns=wanted,
        null_values=[""],
        decimal_point=reading.dialect.decimal,
    )
    try:
        with _samples(file, head) as (stream, lines, raw):
            source = arrow.open_csv(
                stream,
                arrow.ReadOptions(column_names=names, use_threads=False, block_size=BLOCK),
                arrow.ParseOptions(ignore_empty_lines=False, delimiter=reading.dialect.separator),
                convert,
            )
            for batch in source:
                block = {
                    name: seconds_of(column) if name in head.dates else column.to_numpy(zero_copy_only=False)
                    for name, column in ((name, batch.column(name)) for name in wanted)
                }
                if reading.look is not None:
                    numbers = lines.numbers(collected.rows, collected.rows + batch.num_rows)
                    reading.look(Table(file, block, names, batch.num_rows, numbers))
                collected.add(block, batch.num_rows)
                check_rows(collected.rows, file)
                reading.progress(raw.tell() / size)
                if reading.enough(collected.rows):
                    break
    except pa.ArrowException:
        return None
    numbers = lines.numbers(0, collected.rows)
    return Table(
        file, collected.done(), names, collected.rows, numbers, comments=head.comments, dates=frozenset(head.dates)
    )


def _cell_by_cell(file: Path, head: Head, wanted: list[str], reading: Reading) -> Table:
    names = head.names
    columns = {names.index(name): array("d") for name in wanted}
    text: dict[str, tuple[int, str]] = {}
    point = reading.dialect.decimal
    rows = 0
    with _samples(file, head) as (stream, lines, _):
        texts = (_line(stream, file, lines.number(n) - 1) for n in count())
        try:
            for row in csv.reader(_until_empty(texts), delimiter=reading.dialect.separator):
                cells = row or [""]  # an empty line of a one-column table
                if len(cells) != len(names):
                    raise _torn(file, lines.number(rows), cells, names)
                for i, column in columns.items():
                    if names[i] in head.dates:
                        value = as_seconds(cells[i])
                    else:
                        value = as_float(cells[i] if point == "." else cells[i].replace(point, "."))
                    if value is None:
                        text.setdefault(names[i], (lines.number(rows), cells[i]))
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
    numbers = lines.numbers(0, rows)
    table = Table(file, values, names, rows, numbers, text, head.comments, mixed, frozenset(head.dates))
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
