"""How a text table is written: found from its first lines."""

from __future__ import annotations

import re
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.recordings.tables.table import Dialect
from vispeg.recordings.tables.table_csv import COMMENT, MOST_COMMENTS, opened

LINES = 20
DECIMAL_COMMA = re.compile(r"(?<![\d.])-?\d+,\d+(?![\d,])")


def dialect_of(file: Path, names: tuple[str, ...] = ()) -> Dialect:
    """Give what separates cells in a text table, and what stands in its numbers.

    Args:
        file: the table.
        names: of the columns, for a table without a header line.

    Raises:
        UserError: not text.
    """
    try:
        with opened(file) as stream:
            lines, comments = [], 0
            while len(lines) < LINES and (raw := stream.readline(1 << 20)):
                line = raw.decode().rstrip("\r\n")
                comments += (comment := line.lstrip()[:1] in COMMENT and not lines)
                if line.strip() and not comment:
                    lines.append(line)
                if comments > MOST_COMMENTS:
                    break
    except UnicodeDecodeError as error:
        raise UserError("is not UTF-8 text", file=file) from error
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or error}", file=file) from error
    if not lines:
        raise UserError("is empty", file=file)
    head, body = lines[0], lines[1:] or lines
    separator = max((";", "\t", ","), key=head.count)
    if not head.count(separator):
        cells = len(head.split())
        separator = " " if cells > 1 and all(len(line.split()) == cells for line in body) else ","
    comma = separator != "," and any(DECIMAL_COMMA.search(cell) for line in body for cell in line.split(separator))
    return Dialect(separator, "," if comma else ".", names)
