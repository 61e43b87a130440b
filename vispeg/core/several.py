"""Arguments that may be one thing or several: a user may give a single thing in place of a list."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from vispeg.core.errors import UserError

T = TypeVar("T")


def several(given: T | Iterable[T]) -> list[T]:
    """Return the argument as a list. A text, a path or anything that is not iterable becomes its only element."""
    if isinstance(given, str | os.PathLike) or not isinstance(given, Iterable):
        return [given]  # type: ignore[list-item]  # a text is an Iterable to a type checker
    return [*given]


def single(given: T | Iterable[T], key: str) -> T:
    """Return the argument, or the only element if it is a list of one.

    Raises:
        UserError: an empty list, or more than one element; it names `key`.
    """
    listed = several(given)
    if len(listed) != 1:
        raise UserError("exactly one is needed", key=key, expected="one", got=f"{len(listed)}")
    return listed[0]


def each_once(paths: Iterable[Path], key: str | None = None) -> None:
    """Refuse a file or folder given twice, whose noise would count as new evidence. Raises UserError; names `key`."""
    earlier: set[Path] = set()
    for path in paths:
        if path.resolve() in earlier:
            raise UserError("given twice", file=path, key=key, expected="each once")
        earlier.add(path.resolve())
