"""Read Parquet files of unknown origin, with clear errors for damaged or wrong ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.datasets.layout import Feature, is_image
from vispeg.formats.guard import is_file

if TYPE_CHECKING:
    import pyarrow as pa

T = TypeVar("T")
LARGEST = 4 * 10**9  # most bytes of a table in memory


def opened(path: Path) -> Any:
    """Open a file as `pyarrow.parquet.ParquetFile`.

    Raises:
        UserError: no such file, a truncated file, or not a Parquet file.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if not is_file(path):
        raise UserError("is missing, or no file", file=path)
    try:
        return pq.ParquetFile(path)
    except OSError as error:
        raise UserError(f"cannot be read: {error.strerror or _short(error)}", file=path) from None
    except (pa.ArrowException, ValueError, TypeError, MemoryError):
        raise UserError("is cut short, or is not a Parquet file", file=path) from None


def read(action: Callable[[], T], path: Path) -> T:
    """Return the result of reading a part of a file. Raises UserError if that part is damaged."""
    import pyarrow as pa

    try:
        return action()
    except (OSError, pa.ArrowException, KeyError, ValueError, TypeError, MemoryError, OverflowError) as error:
        raise UserError(f"cannot be read ({_short(error)})", file=path) from None


def table(file: Any, path: Path, columns: list[str] | None, group: int | None = None) -> pa.Table:
    """Read columns of a file or of one of its row groups.

    Raises:
        UserError: a missing column, damaged content, or a stated size above LARGEST.
    """
    groups = range(file.num_row_groups) if group is None else [group]
    size = sum(read(lambda i=i: file.metadata.row_group(i).total_byte_size, path) for i in groups)
    if size > LARGEST:
        raise UserError("states that it is too large", file=path, expected=f"at most {LARGEST} bytes", got=size)
    available = file.schema_arrow.names
    for name in columns or ():
        if name not in available:
            raise UserError("is missing", file=path, key=name)
    if group is None:
        return read(lambda: file.read(columns), path)
    return read(lambda: file.read_row_group(group, columns), path)


def values(feature: Feature, column: Any, path: Path, name: str) -> Any:
    """Return a column's values: (T, ...) numbers, or T encoded pictures as a list of bytes.

    Args:
        feature: the expected feature.
        column: a chunked column of pyarrow.
        path, name: file and column, for error messages.

    Raises:
        UserError: values that are missing or of another type or number.
    """
    import pyarrow as pa

    shape = tuple(feature["shape"])
    flat = column.combine_chunks()
    if is_image(feature):
        kind = flat.type
        if not pa.types.is_struct(kind) or kind.get_field_index("bytes") < 0:
            raise UserError("holds no encoded pictures", file=path, key=name, got=str(kind))
        return [b if isinstance(b, bytes) else b"" for b in flat.field("bytes").to_pylist()]
    if flat.null_count:
        raise UserError(f"has no value in {count(flat.null_count, 'frame')}", file=path, key=name)
    if feature["dtype"] == "string":
        return np.array(flat.to_pylist(), object)
    rows = len(flat)
    while pa.types.is_list(flat.type) or pa.types.is_fixed_size_list(flat.type) or pa.types.is_large_list(flat.type):
        flat = flat.flatten()
    each = int(np.prod(shape))
    right = {"b": pa.types.is_boolean, "i": pa.types.is_integer, "u": pa.types.is_integer}
    suits = right.get(np.dtype(feature["dtype"]).kind, lambda t: pa.types.is_floating(t) or pa.types.is_integer(t))
    if not suits(flat.type) or flat.null_count or len(flat) != rows * each:
        expected = f"{each} numbers of type {feature['dtype']} a frame"
        raise UserError("holds other values", file=path, key=name, expected=expected, got=str(column.type))
    array = flat.to_numpy(zero_copy_only=False).astype(feature["dtype"], copy=False)
    return array.reshape(rows, *(() if shape == (1,) else shape))


def checked(rows: Sequence[Mapping[str, object]], kinds: Mapping[str, Callable[[Any], bool]], path: Path) -> None:
    """Raise UserError if an entry of a row fails the test of its key; None and keys without a test pass."""
    for i, row in enumerate(rows):
        for key, right in kinds.items():
            if row.get(key) is not None and not right(row[key]):
                raise UserError("has the wrong type", file=path, key=f"row {i}, {key}", got=row[key])


def _short(error: BaseException) -> str:
    return " ".join(str(error).split())[:80] or type(error).__name__
