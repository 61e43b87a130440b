"""One thing or several: what a user names alone, in place of a list of one."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar

T = TypeVar("T")


def several(given: T | Iterable[T]) -> list[T]:
    """Give a list; a text or a path is one thing, not its characters, and so is what cannot be walked."""
    if isinstance(given, str | os.PathLike) or not isinstance(given, Iterable):
        return [given]  # type: ignore[list-item]  # a text is an Iterable to a type checker
    return [*given]
