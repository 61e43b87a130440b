"""Read a Parquet table block by block; a column of lists becomes one column per element, `state[0]`, `state[1]`, ..."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.recordings.tables.table import Columns, Reading, Table, check_rows, checked_names, is_date, seconds_of

BLOCK = 65_536  # rows


def read_parquet(file: Path, reading: Reading) -> Table:
    """Read the wanted columns of a table. Raises UserError if the file is not a readable Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(file, buffer_size=1 << 20, pre_buffer=False) as source:
            total = source.metadata.num_rows
            check_rows(total, file)
            fields = {name: _width(source, name) for name in _plain_names(source, file)}
            names = checked_names([n for name, width in fields.items() for n in _split(name, width)], file)
            wanted = reading.wanted(names)
            origin = {name: [n for n in _split(name, width) if n in set(wanted)] for name, width in fields.items()}
            columns = [name for name, parts in origin.items() if parts]
            dates = frozenset(name for name in names if fields.get(name) == 0 and is_date(_type(source, name)))
            text = {n: (0, f"a column of {_type(source, n)}") for n in wanted if fields.get(n, 0) is None}
            collected = Columns([name for name in reading.retained(names) if name not in text], total)
            for batch in source.iter_batches(BLOCK, columns=columns, use_threads=False):
                block: dict[str, np.ndarray] = {}
                for name in columns:
                    if name not in text:
                        block |= _values(batch.column(name), name, fields[name], origin[name], pa)
                if reading.look is not None:
                    end = collected.rows + batch.num_rows
                    reading.look(Table(file, block, names, batch.num_rows, range(collected.rows, end), text))
                collected.add(block, batch.num_rows)
                reading.progress(collected.rows / max(total, 1))
                if reading.enough(collected.rows):
                    break
            rows = collected.rows if columns else total
    except (pa.ArrowException, OSError, ValueError, OverflowError, NotImplementedError, MemoryError) as error:
        raise UserError(f"is not a Parquet file that can be read: {error}", file=file) from error
    return Table(file, collected.done(), names, rows, range(rows), text, dates=dates)


def _plain_names(source: Any, file: Path) -> list[str]:
    return checked_names(list(source.schema_arrow.names), file)


def _type(source: Any, name: str) -> Any:
    return source.schema_arrow.field(name).type


def _width(source: Any, name: str) -> int | None:
    """Return 0 for a column of numbers or dates, the length for one of lists of numbers, None for any other type."""
    import pyarrow as pa

    kind = _type(source, name)
    numeric = [pa.types.is_floating, pa.types.is_integer, pa.types.is_boolean, pa.types.is_null]
    if is_date(kind) or any(test(kind) for test in numeric):
        return 0
    if not (pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)):
        return None
    if not any(test(kind.value_type) for test in numeric[:2]):
        return None
    if pa.types.is_fixed_size_list(kind):
        return kind.list_size
    first = next(source.iter_batches(1, columns=[name], use_threads=False), None)
    return 1 if first is None or not first.num_rows else max(len(first.column(name)[0].as_py() or ()), 1)


def _split(name: str, width: int | None) -> list[str]:
    return [f"{name}[{i}]" for i in range(width)] if width else [name]


def _values(column: Any, name: str, width: int | None, parts: list[str], pa: Any) -> dict[str, np.ndarray]:
    if not width and is_date(column.type):
        return {name: seconds_of(column)}
    if not width:
        return {name: column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)}
    flat = column.flatten()
    if len(flat) != width * len(column):
        raise ValueError(f"column {name} holds lists of several lengths")
    rows = flat.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False).reshape(-1, width)
    return {part: rows[:, int(part[len(name) + 1 : -1])] for part in parts}
