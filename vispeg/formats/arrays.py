"""Read untrusted NumPy archives."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, opened, size

# exceptions of zipfile and NumPy for damaged archives
DAMAGED = (OSError, ValueError, LookupError, TypeError, EOFError, SyntaxError, RuntimeError, MemoryError)
DAMAGED += (zipfile.BadZipFile, zlib.error, NotImplementedError, OverflowError, RecursionError)


def read_arrays(path: str | Path, *, most: int = 2000 * MB) -> dict[str, np.ndarray]:
    """Read the arrays of an .npz file by name, without unpickling anything.

    Args:
        path: of the file.
        most: greatest size of the unpacked arrays, bytes.

    Raises:
        UserError: an unreadable file, not an archive, a damaged one, one with Python objects, or too large a one.
    """
    with _archive(path, most) as data:
        return {name: _array(data[name]) for name in data.files}


def array_names(path: str | Path, *, most: int) -> tuple[str, ...]:
    """Return the names of the arrays in an .npz file without reading them; arguments and errors as `read_arrays`."""
    with _archive(path, most) as data:
        return tuple(data.files)


@contextmanager
def _archive(path: str | Path, most: int) -> Iterator[Any]:
    """Open an archive for the body. Raises UserError as `read_arrays` does, also for errors of the body."""
    with opened(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(entry.file_size for entry in archive.infolist())
            if unpacked > most:
                expected = f"at most {size(most)} unpacked"
                raise UserError("is too large", file=path, expected=expected, got=size(unpacked))
            file.seek(0)
            with np.load(file, allow_pickle=False) as data:
                yield data
        except DAMAGED as error:
            raise _refusal(path, error) from None


def _array(value: object) -> np.ndarray:
    if not isinstance(value, np.ndarray):
        raise ValueError("an entry that is not an array")
    return value


def _refusal(path: str | Path, error: Exception) -> UserError:
    what = "holds Python objects" if "allow_pickle" in str(error) else "is not a NumPy archive that can be read"
    return UserError(what, file=path, expected="plain numeric arrays")
