"""Read bytes and text of untrusted files, and check the limits that their content must keep."""

from __future__ import annotations

import codecs
import math
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from vispeg.core.errors import UserError

MB = 1_000_000
DEPTH = 64  # levels of lists and mappings in each other
DIGITS = 40  # of a whole number: the state of a random generator has 39
NOT_TEXT = re.compile("[\x00\ud800-\udfff]")  # no path may hold the first, no terminal can print the others
MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF32_BE: "UTF-32"}  # first: they begin like those of UTF-16
MARKS |= {codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


def is_file(path: str | Path) -> bool:
    """Return whether there is a regular file; a name that no file can have (too long, with a NUL) names none."""
    try:
        return Path(path).expanduser().is_file()
    except (OSError, ValueError, RuntimeError):
        return False


def refuse_special(path: str | Path) -> None:
    """Refuse a pipe, a socket or a device, before a library opens it and waits for it to begin or to end.

    Raises:
        UserError: what the path leads to is neither a file nor a folder; a path to nothing passes.
    """
    try:
        mode = os.stat(Path(path).expanduser()).st_mode
    except (OSError, ValueError, RuntimeError):
        return  # for the reader to say
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise UserError("is not a regular file", file=path, expected="a file")


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """Return a regular file, open for reading.

    Raises:
        UserError: no such file, not a regular one (a folder, pipe or device), or one that cannot be read.
    """
    try:
        handle = os.open(Path(path).expanduser(), os.O_RDONLY | os.O_NONBLOCK)  # a pipe without a writer must not block
        try:
            mode = os.fstat(handle).st_mode
            if not stat.S_ISREG(mode):
                what = "a folder" if stat.S_ISDIR(mode) else "not a regular file"
                raise UserError(f"is {what}", file=path, expected="a file")
            with open(handle, "rb", closefd=False) as file:
                yield file
        finally:
            os.close(handle)
    except FileNotFoundError:
        raise UserError("no such file", file=path) from None
    except OSError as error:
        raise UserError(f"cannot be read: {(error.strerror or str(error)).lower()}", file=path) from None
    except (ValueError, RuntimeError) as error:  # a NUL in the name, no home directory
        raise UserError(f"cannot be read: {error}", file=path) from None


def read_bytes(path: str | Path, most: int = MB) -> bytes:
    """Return a file's content.

    Args:
        path: of the file; a `~` stands for the home directory.
        most: bytes that it may have.

    Raises:
        UserError: as `opened`, or a larger one.
    """
    with opened(path) as file:
        data, there = file.read(most + 1), os.fstat(file.fileno()).st_size
    if len(data) > most:
        raise UserError("is too large", file=path, expected=f"at most {size(most)}", got=size(there))
    return data


def read_text(path: str | Path, most: int = MB) -> str:
    """Return a file's content as text: UTF-8, with or without a byte-order mark.

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
    """Hold plain data (mappings, list, numbers, text) to the limits.

    Args:
        data: what was parsed.
        file, key: where it stands, for the error.
        finite: whether infinite numbers and NaN are refused.

    Raises:
        UserError: nesting, a number, or a character beyond them; names the place.
    """
    fault = _beyond(data, finite, DEPTH)
    if fault is not None:
        message, expected, parts = fault
        at = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in reversed(parts))
        raise UserError(
            message, file=file, key=": ".join(filter(None, (key, at.lstrip(".")))) or None, expected=expected
        )


def _beyond(value: Any, finite: bool, levels: int) -> tuple[str, str | None, list[str | int]] | None:
    """Return the violation, what was expected, and the keys that lead to it, innermost first; None if there is none."""
    if isinstance(value, float):
        return ("is not finite", "a finite number", []) if finite and not math.isfinite(value) else None
    if isinstance(value, str):
        return ("holds a character that is not text", None, []) if NOT_TEXT.search(value) else None
    if isinstance(value, int):
        return ("is a number with too many digits", f"at most {DIGITS}", []) if abs(value) >= 10**DIGITS else None
    if not isinstance(value, dict | list):
        return None
    if levels == 0:
        return "is nested too deeply", f"at most {DEPTH} levels", []
    for key, item in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(key, str) and NOT_TEXT.search(key):
            return "a key holds a character that is not text", None, []
        if fault := _beyond(item, finite, levels - 1):
            fault[2].append(key)
            return fault
    return None


@contextmanager
def as_written(file: str | Path, command: str, hint: str = "") -> Iterator[None]:
    """Say that what trips over the content of a file that only the program itself writes trips over a damaged file.

    Args:
        file: which.
        command: that wrote it.
        hint: what to do about it.

    Raises:
        UserError: in place of the error that a missing key, a value of another kind or an impossible one gives.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError) as error:
        said = f"{type(error).__name__}: {error}"
        expected = f"it as `{command}` wrote it" + (f"; {hint}" if hint else "")
        raise UserError(f"is damaged, or of another version ({said[:200]})", file=file, expected=expected) from error
    except UserError as error:
        raise (UserError(f"{error}; {hint}") if hint else error) from None


def size(count: int) -> str:
    """`1 MB`, `350 kB`, `12 bytes`."""
    for unit, name in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= unit:
            return f"{count / unit:.3g} {name}"
    return f"{count} bytes"
