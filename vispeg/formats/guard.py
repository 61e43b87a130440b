"""The bytes and the text of a file of unknown origin, and the limits that whatever it says must keep to."""

from __future__ import annotations

import codecs
import math
import os
import re
import stat
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError

MB = 1_000_000
DEPTH = 64  # levels of lists and mappings in each other
DIGITS = 40  # of a whole number: the state of a random generator has 39
NOT_TEXT = re.compile("[\x00\ud800-\udfff]")  # no path may hold the first, no terminal can print the others
MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF32_BE: "UTF-32"}  # first: they begin like those of UTF-16
MARKS |= {codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


def is_file(path: str | Path) -> bool:
    """Whether there is a regular file; a name that no file can have (too long, with a NUL) names none."""
    try:
        return Path(path).expanduser().is_file()
    except (OSError, ValueError, RuntimeError):
        return False


def read_bytes(path: str | Path, most: int = MB) -> bytes:
    """A file's content.

    Args:
        path: of the file; a `~` stands for the home directory.
        most: bytes that it may have.

    Raises:
        UserError: no such file, not a regular one (a folder, pipe or device), one that cannot be read, or a larger one.
    """
    try:
        handle = os.open(Path(path).expanduser(), os.O_RDONLY | os.O_NONBLOCK)  # a pipe without a writer must not block
        try:
            found = os.fstat(handle)
            if not stat.S_ISREG(found.st_mode):
                what = "a folder" if stat.S_ISDIR(found.st_mode) else "no regular file"
                raise UserError(f"is {what}", file=path, expected="a file")
            with open(handle, "rb", closefd=False) as file:
                data = file.read(most + 1)
        finally:
            os.close(handle)
    except FileNotFoundError:
        raise UserError("no such file", file=path) from None
    except OSError as error:
        raise UserError(f"cannot be read: {(error.strerror or str(error)).lower()}", file=path) from None
    except (ValueError, RuntimeError) as error:  # a NUL in the name, no home directory
        raise UserError(f"cannot be read: {error}", file=path) from None
    if len(data) > most:
        raise UserError("is too large", file=path, expected=f"at most {size(most)}", got=size(found.st_size))
    return data


def read_text(path: str | Path, most: int = MB) -> str:
    """A file's content as text: UTF-8, with or without a byte-order mark.

    Raises:
        UserError: as `read_bytes`; nothing but white space; another encoding.
    """
    data = read_bytes(path, most)
    for mark, name in MARKS.items():
        if data.startswith(mark):
            raise UserError(f"is {name} text", file=path, expected="UTF-8")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(f"is not UTF-8 text (byte {error.start})", file=path) from None
    if not text.strip():
        raise UserError("is empty", file=path)
    return text


def check(data: Any, file: str | Path, key: str | None = None, *, finite: bool = True) -> None:
    """Holds plain data (mappings, lists, numbers, text) to the limits.

    Args:
        data: what was parsed.
        file, key: where it stands, for the error.
        finite: whether infinite numbers and NaN are refused.

    Raises:
        UserError: nesting, a number, or a character beyond them; names the place.
    """
    found = _beyond(data, finite, DEPTH)
    if found is not None:
        message, expected, parts = found
        at = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in reversed(parts))
        raise UserError(
            message, file=file, key=": ".join(filter(None, (key, at.lstrip(".")))) or None, expected=expected
        )


def _beyond(value: Any, finite: bool, levels: int) -> tuple[str, str | None, list[str | int]] | None:
    """What is wrong, what was expected, and the way there, innermost first; None if nothing is."""
    if isinstance(value, float):
        return ("is not finite", "a finite number", []) if finite and not math.isfinite(value) else None
    if isinstance(value, str):
        return ("holds a character that is no text", None, []) if NOT_TEXT.search(value) else None
    if isinstance(value, int):
        return ("is a number with too many digits", f"at most {DIGITS}", []) if abs(value) >= 10**DIGITS else None
    if not isinstance(value, dict | list):
        return None
    if levels == 0:
        return "is nested too deeply", f"at most {DEPTH} levels", []
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(key, str) and NOT_TEXT.search(key):
            return "a key holds a character that is no text", None, []
        if found := _beyond(item, finite, levels - 1):
            found[2].append(key)
            return found
    return None


def size(count: int) -> str:
    """`1 MB`, `350 kB`, `12 bytes`."""
    for unit, name in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= unit:
            return f"{count / unit:.3g} {name}"
    return f"{count} bytes"
