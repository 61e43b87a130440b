"""One thing or several: what a user names alone, in place of a list of one."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar

from vispeg.core.errors import UserError

T = TypeVar("T")


def several(given: T | Iterable[T]) -> list[T]:
    """Give a list; a text or a path is one thing, not its characters, and so is what cannot be walked."""
    if isinstance(given, str | os.PathLike) or not isinstance(given, Iterable):
        return [given]  # type: ignore[list-item]  # a text is an Iterable to a type checker
    return [*given]


def single(given: T | Iterable[T], key: str) -> T:
    """Give the one thing that is meant, also where it stands alone in a list.

    Raises:
        UserError: there are none or several; names `key`.
    """
    listed = several(given)
    if len(listed) != 1:
        raise UserError("one is meant", key=key, expected="one", got=f"{len(listed)}")
    return listed[0]
