"""Reads a table of samples, whichever format it has."""

from __future__ import annotations

from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.formats.guard import refuse_special
from vispeg.recordings.tables.table import MAX_BYTES, Reading, Table
from vispeg.recordings.tables.table_csv import read_csv
from vispeg.recordings.tables.table_parquet import read_parquet

EVERYTHING = Reading()


def read_table(file: Path, reading: Reading = EVERYTHING) -> Table:
    """Reads a .csv, .csv.gz or .parquet file. Raises UserError for what is no table of a header and samples."""
    import pyarrow

    refuse_special(file)
    try:
        size = file.stat().st_size
        if size > MAX_BYTES:
            raise UserError("is too large", file=file, expected=f"at most {MAX_BYTES} bytes; split it", got=size)
        table = (read_parquet if file.suffix.lower() == ".parquet" else read_csv)(file, reading)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or error}", file=file) from error
    pyarrow.default_memory_pool().release_unused()  # half as much again as the columns, kept for a next time
    if table.rows == 0:
        raise UserError("holds no samples", file=file)
    return table
