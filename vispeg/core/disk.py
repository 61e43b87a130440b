"""Reasons of file system errors in words, and which of them mean that a place cannot be written."""

from __future__ import annotations

import errno
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from vispeg.core.errors import UserError

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # the disk takes no more data
NO_TEMPORARY = "No usable temporary directory"  # in the message of `tempfile`; its errno is that of a missing file


def why(error: OSError) -> str:
    """Return the reason of an error in words, in one line: the system's own, with one exception.

    If a file stands in the place of a folder of the path, the system says only that a file exists, or that something is
    not a directory.
    """
    if isinstance(error, FileExistsError | NotADirectoryError):
        return "a folder above it is a file"
    if isinstance(error, shutil.Error):  # of copying a tree: [(from, to, message), ...], of which the first is taken
        message = str(error.args[0][0][-1])
        number = re.match(r"\[Errno (\d+)\]", message)  # what follows the number names temporary files
        return message if number is None else os.strerror(int(number[1]))
    return error.strerror or str(error)


def refused(error: OSError) -> bool:
    """Return whether an error means that a place cannot be written.

    These are a disk that is full, broken or read-only, a file above the size limit, missing permission, a folder that
    could not be copied or moved, and a system without a usable temporary folder.
    """
    if isinstance(error, PermissionError | shutil.Error) or error.errno in FULL:
        return True
    return error.errno == errno.ENOENT and NO_TEMPORARY in str(error.strerror)


def failed_in(folder: Path, error: OSError) -> bool:
    """Return whether an error came from writing into `folder`: it names a file there, or none and is `refused`."""
    if error.filename is not None:
        return Path(os.fsdecode(error.filename)).is_relative_to(folder)
    return refused(error)


@contextmanager
def written(path: str | Path) -> Iterator[None]:
    """Turn any OSError of the body into a UserError that `path` cannot be written, with the reason."""
    try:
        yield
    except OSError as error:
        raise UserError(f"cannot be written: {why(error)}", file=path) from error
