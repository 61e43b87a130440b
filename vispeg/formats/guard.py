"""Read bytes and text of untrusted files, and check limits on their content."""

from __future__ import annotations

import codecs
import math
import os
import re
import shlex
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded

MB = 1_000_000
DEPTH = 64  # greatest number of nested lists and mappings
DIGITS = 40  # greatest number of digits of a whole number; the state of a random generator has 39
NOT_TEXT = re.compile("[\x00\ud800-\udfff]")  # NUL cannot be in a path, surrogates cannot be printed
# UTF-32 is tested first, because its little-endian mark begins with that of UTF-16
MARKS = {codecs.BOM_UTF32_LE: "UTF-32", codecs.BOM_UTF32_BE: "UTF-32"}
MARKS |= {codecs.BOM_UTF16_LE: "UTF-16", codecs.BOM_UTF16_BE: "UTF-16"}


def is_file(path: str | Path) -> bool:
    """Return whether a path leads to a regular file; False for names that are impossible (too long, with a NUL)."""
    return os.path.isfile(os.path.expanduser(path))


def refuse_special(path: str | Path) -> None:
    """Refuse pipes, sockets and devices, which would block a library that opens them.

    Raises:
        UserError: the path leads to something that is neither a file nor a folder. A missing path is not an error here.
    """
    try:
        mode = os.stat(os.path.expanduser(path)).st_mode
    except (OSError, ValueError):
        return  # the reader will report it
    if not (stat.S_ISREG(mode) or stat.S_ISDIR(mode)):
        raise UserError("is not a regular file", file=path, expected="a file")


@contextmanager
def opened(path: str | Path) -> Iterator[BinaryIO]:
    """Open a regular file for reading, in binary mode.

    Raises:
        UserError: no such file, not a regular one (a folder, pipe or device), or one that cannot be read.
    """
    try:
        handle = os.open(expanded(path), os.O_RDONLY | os.O_NONBLOCK)  # a pipe without a writer must not block
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
    except ValueError as error:  # a NUL in the name
        raise UserError(f"cannot be read: {error}", file=path) from None


def read_bytes(path: str | Path, most: int = MB) -> bytes:
    """Read a file's content as bytes.

    Args:
        path: of the file; `~` stands for the home directory.
        most: greatest size, bytes.

    Raises:
        UserError: as `opened`, or a larger file.
    """
    with opened(path) as file:
        data, there = file.read(most + 1), os.fstat(file.fileno()).st_size
    if len(data) > most:
        raise UserError("is too large", file=path, expected=f"at most {size(most)}", got=size(there))
    return data


def read_text(path: str | Path, most: int = MB) -> str:
    """Read a file's content as text: UTF-8, with or without a byte-order mark.

    Raises:
        UserError: as `read_bytes`; also for another encoding, or a file with only white space.
    """
    data = read_bytes(path, most)
    for mark, name in MARKS.items():
        if data.startswith(mark):
            raise UserError(f"is {name} text", file=path, expected=recoded(path, name))
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise UserError(
            f"is not UTF-8 text (byte {error.start})", file=path, expected=recoded(path, data=data)
        ) from None
    if not text.strip():
        raise UserError("is empty", file=path)
    return text


def recoded(path: str | Path, encoding: str = "CP1252", data: bytes = b"") -> str:
    """Say how a text file becomes UTF-8, by default one in the encoding of Western European Windows programs.

    With a zero byte in `data`, of its content, it is no text.
    """
    if b"\0" in data:
        return "text"
    name = shlex.quote(Path(path).name)
    return f"UTF-8: iconv -f {encoding} -t UTF-8 {name} > NEW" + (", if it is Latin-1" if encoding == "CP1252" else "")


def check(data: Any, file: str | Path, key: str | None = None, *, finite: bool = True) -> None:
    """Check plain data (mappings, lists, numbers, text) against the limits.

    Args:
        data: as parsed.
        file, key: file and key of the data, for the error.
        finite: whether infinite numbers and NaN are refused.

    Raises:
        UserError: too deep nesting, a number with too many digits or that is not finite, or a character that is not
            text; it names the place.
    """
    fault = _violation(data, finite, DEPTH)
    if fault is not None:
        message, expected, parts = fault
        at = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in reversed(parts)).lstrip(".")
        where = ": ".join(filter(None, (key, at)))
        raise UserError(message, file=file, key=where or None, expected=expected)


def _violation(value: Any, finite: bool, levels: int) -> tuple[str, str | None, list[str | int]] | None:
    """Return the first violation, the expected value, and the keys that lead to it, innermost first; else None.

    `levels` more levels of nesting are allowed.
    """
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
        if fault := _violation(item, finite, levels - 1):
            fault[2].append(key)
            return fault
    return None


@contextmanager
def as_written(file: str | Path, command: str, hint: str = "") -> Iterator[None]:
    """Report errors in the body as a damaged file: for code that uses a file that only this program writes.

    Args:
        file: the file.
        command: the command that writes it.
        hint: advice for the user.

    Raises:
        UserError: in place of errors from a missing key, or a value of the wrong type or size.
    """
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, MemoryError) as error:
        reason = f"{type(error).__name__}: {error}"
        expected = f"it as `{command}` wrote it" + (f"; {hint}" if hint else "")
        raise UserError(f"is damaged, or of another version ({reason[:200]})", file=file, expected=expected) from error
    except UserError as error:
        raise (UserError(f"{error}; {hint}") if hint else error) from None


def size(count: int) -> str:
    """Return a number of bytes as text, such as `1 MB`, `350 kB` or `12 bytes`."""
    for unit, name in ((10**9, "GB"), (10**6, "MB"), (10**3, "kB")):
        if count >= unit:
            return f"{count / unit:.3g} {name}"
    return f"{count} bytes"
