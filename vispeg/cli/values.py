"""Refuse values of options that no command can use, before any work: impossible paths, and numbers beyond all sense."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from pathlib import Path

from vispeg.core.errors import UserError

# Larger than every quantity of an arm in SI units (a steel contact's stiffness is 1e8 N/m) and than every count that
# a run finishes; a value beyond is a slip of the keyboard or another unit.
LARGEST = 1e9
SEEDS = 2**63  # exclusive: seeds are stored as 64-bit integers
LONGEST_NAME, LONGEST_PATH = 255, 4095  # bytes, of Linux' file systems


def check_values(args: object) -> None:
    """Refuse what cannot be meant among the values of a command's dataclass, groups of options included.

    Raises:
        UserError: names the option, what came, and what was expected.
    """
    for name, value in _values(args):
        if isinstance(value, str | Path):
            _check_text(name, str(value), isinstance(value, Path))
        elif isinstance(value, int | float) and not isinstance(value, bool):
            _check_number(name, value)


def _values(args: object) -> Iterator[tuple[str, object]]:
    """Name of the option and each of its values."""
    for field in fields(args) if is_dataclass(args) else ():
        value = getattr(args, field.name)
        if is_dataclass(value):
            yield from _values(value)
            continue
        for each in value if isinstance(value, tuple) else (value,):
            yield f"--{field.name.replace('_', '-')}", each


def _check_text(name: str, text: str, path: bool) -> None:
    shown = text.encode("utf-8", "backslashreplace").decode()
    shown = shown if len(shown) < 80 else f"{shown[:40]}... ({len(text)} characters)"
    if "\0" in text:
        raise UserError("holds a zero byte", key=name, got=shown.replace("\0", "\\0"))
    try:
        size = len(text.encode("utf-8"))
    except UnicodeEncodeError:  # results state their command and their inputs as UTF-8
        raise UserError("is not UTF-8", key=name, got=shown, expected="a name in UTF-8; rename the file") from None
    longest = max((len(os.fsencode(part)) for part in Path(text).parts), default=0)
    if (path or os.sep in text) and (longest > LONGEST_NAME or size > LONGEST_PATH):
        expected = f"names of at most {LONGEST_NAME} bytes, {LONGEST_PATH} in all"
        raise UserError("is too long for a path", key=name, got=shown, expected=expected)
    if path and text.startswith("~"):
        try:
            Path(text).expanduser()
        except RuntimeError:
            raise UserError("no such user", key=name, got=shown, expected="a home folder that is there") from None


def _check_number(name: str, value: float) -> None:
    if isinstance(value, float) and math.isnan(value):
        raise UserError("is not a number", key=name, got="nan")
    whole = isinstance(value, int)
    if name == "--seed" and not 0 <= value < SEEDS:
        raise UserError("no such seed", key=name, got=str(value), expected="a whole number from 0 to 2^63 - 1")
    if name != "--seed" and (abs(value) > LARGEST or (whole and value < 0)):
        low = "0" if whole else f"-{LARGEST:g}"
        raise UserError("out of range", key=name, got=f"{value:g}", expected=f"{low} to {LARGEST:g}")
