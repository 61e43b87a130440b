"""How a text table is written: found from its first lines."""

from __future__ import annotations

import re
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.recordings.tables.table import Dialect
from vispeg.recordings.tables.table_csv import opened

LINES = 20
DECIMAL_COMMA = re.compile(r"(?<![\d.])-?\d+,\d+(?![\d,])")


def dialect_of(file: Path) -> Dialect:
    """What separates cells in a text table, and what stands in its numbers.

    Raises:
        UserError: not text, or a first line of numbers instead of names.
    """
    try:
        with opened(file) as stream:
            lines = [stream.readline(1 << 20).decode() for _ in range(LINES)]
    except UnicodeDecodeError as error:
        raise UserError("is not UTF-8 text", file=file) from error
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or error}", file=file) from error
    lines = [line.rstrip("\r\n") for line in lines if line.strip()]
    if not lines:
        raise UserError("is empty", file=file)
    head, body = lines[0], lines[1:]
    separator = max((",", ";", "\t"), key=head.count)
    if not head.count(separator):
        separator = " " if head.count(" ") and all(line.count(" ") == head.count(" ") for line in body) else ","
    comma = separator != "," and any(DECIMAL_COMMA.search(cell) for line in body for cell in line.split(separator))
    dialect = Dialect(separator, "," if comma else ".")
    cells = [cell.strip().replace(dialect.decimal, ".") for cell in head.split(separator)]
    if all(re.fullmatch(r"[-+]?[\d.]+(e[-+]?\d+)?|nan|", cell, re.I) for cell in cells):
        raise UserError("the first line holds numbers", file=file, expected="a line with the columns' names", got=head)
    return dialect
