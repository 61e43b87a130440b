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

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # whatever is written, and wherever
NO_TEMPORARY = "No usable temporary directory"  # as `tempfile` says it, with the errno of a file that is not there


def why(error: OSError) -> str:
    """Return the reason of a file error; for a parent folder that is a file, the system would only say "exists"."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        return "a folder above it is a file"
    if isinstance(error, shutil.Error):  # of a whole tree: [(from, to, what was said), ...]
        said = str(error.args[0][0][-1])
        number = re.match(r"\[Errno (\d+)\]", said)  # the rest names temporary files
        return said if number is None else os.strerror(int(number[1]))
    return error.strerror or str(error)


def refused(error: OSError) -> bool:
    """Whether a disk that is full, broken or not to be written raised it."""
    if isinstance(error, PermissionError | shutil.Error) or error.errno in FULL:
        return True
    return error.errno == errno.ENOENT and NO_TEMPORARY in str(error.strerror)


def failed_in(folder: Path, error: OSError) -> bool:
    """Whether it was writing into `folder` that failed, not reading something else."""
    if error.filename is not None:
        return Path(os.fsdecode(error.filename)).is_relative_to(folder)
    return refused(error)


@contextmanager
def written(path: str | Path) -> Iterator[None]:
    """Make a failure to write `path` in the body an error of input. Raises UserError where the disk refuses."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot be written: {why(error)}", file=path) from error
