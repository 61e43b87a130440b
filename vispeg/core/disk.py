"""What the disk may refuse, and how it is said in one line."""

from __future__ import annotations

import errno
import os
from pathlib import Path

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # whatever is written, and wherever


def why(error: OSError) -> str:
    """What the system said; of a parent that is a file it says no more than that it exists."""
    if isinstance(error, FileExistsError | NotADirectoryError):
        return "a folder above it is a file"
    return error.strerror or str(error)


def failed_in(folder: Path, error: OSError) -> bool:
    """Whether it was writing into `folder` that failed, not reading something else."""
    if error.filename is not None:
        return Path(os.fsdecode(error.filename)).is_relative_to(folder)
    return error.errno in FULL
