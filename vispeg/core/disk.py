"""Errors of the file system, reported in one line."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vispeg.core.errors import UserError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # a disk that cannot be written at all
NO_TEMPORARY = "No usable temporary directory"  # message of `tempfile`, whose errno is that of a missing file


def why(error: OSError) -> str:
    """Return the reason of a file error in words.

    If a parent folder is a file, say so: the system's own message is only that something exists.
    """
    if isinstance(error, FileExistsError | NotADirectoryError):
        return "a folder above it is a file"
    if isinstance(error, shutil.Error):  # of a whole tree: [(from, to, what was said), ...]
        said = str(error.args[0][0][-1])
        number = re.match(r"\[Errno (\d+)\]", said)  # the rest names temporary files
        return said if number is None else os.strerror(int(number[1]))
    return error.strerror or str(error)


def refused(error: OSError) -> bool:
    """Return whether an error is due to a disk that is full, broken or read-only, or to missing permission."""
    if isinstance(error, PermissionError | shutil.Error) or error.errno in FULL:
        return True
    return error.errno == errno.ENOENT and NO_TEMPORARY in str(error.strerror)


def failed_in(folder: Path, error: OSError) -> bool:
    """Return whether an error came from writing into `folder`, not from reading something else."""
    if error.filename is not None:
        return Path(os.fsdecode(error.filename)).is_relative_to(folder)
    return refused(error)


@contextmanager
def written(path: str | Path) -> Iterator[None]:
    """Raise UserError, which names `path`, for any OSError in the body."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot be written: {why(error)}", file=path) from error
