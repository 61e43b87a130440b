"""Paths as users write them."""

from __future__ import annotations

from pathlib import Path

from vispeg.core.errors import UserError


def expanded(path: str | Path, file: str | Path | None = None, key: str | None = None) -> Path:
    """Return a path with the home folder in place of `~` or `~USER`.

    Args:
        path: the path.
        file, key: where it is stated, for the error message.

    Raises:
        UserError: no such user.
    """
    try:
        return Path(path).expanduser()
    except RuntimeError:
        raise UserError("no such user", file=file, key=key, expected="an existing home folder", got=str(path)) from None
