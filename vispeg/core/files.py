"""Writing results so that they appear whole or not at all, and never on top of a user's own files."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import signal
import threading
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from vispeg.core.errors import UserError


@contextmanager
def new_folder(path: str | Path, overwrite: bool = False) -> Iterator[Path]:
    """A folder that takes its name only once everything in it has been written.

    The body writes into a temporary sibling, which is renamed to `path` at the end, and removed if the body raises or
    the process is interrupted or terminated; what stood at `path` before is then still there, untouched. What an
    earlier process could not clear away (SIGKILL, a power cut) is removed. An empty folder at `path` counts as none.

    Args:
        path: where the folder shall be; its parents are made.
        overwrite: whether an existing folder with content is replaced, as a whole.

    Raises:
        UserError: `path` is a file, or a folder with content while `overwrite` is False, or not a folder of results at
            all (the working or home directory, one above them, a git checkout), or cannot be written.
    """
    target = Path(path).expanduser().resolve()  # through a link: its target is replaced, not the link
    _refuse(target, path, overwrite)
    part = _sibling(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        remove_abandoned(target)
        part.mkdir()
    except OSError as error:
        raise UserError(f"cannot be written: {_why(error)}", file=path) from error
    try:
        with _terminable(), _held(part):
            yield part
            _refuse(target, path, overwrite)  # something may have come to stand there meanwhile
            _swap(part, target)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def remove_abandoned(target: Path) -> None:
    """Removes the temporary siblings of `target` (made here: `.NAME.8 hex digits.part`) that no process holds."""
    ours = re.compile(re.escape(f".{target.name}.") + r"[0-9a-f]{8}\.part")
    for part in [p for p in target.parent.iterdir() if ours.fullmatch(p.name) and not p.is_symlink()]:
        with suppress(OSError), _held(part, surely=True):  # held by another, or a disk without locks: it stays
            shutil.rmtree(part, ignore_errors=True) if part.is_dir() else part.unlink()


def write_text_atomic(path: str | Path, text: str, *, overwrite: bool = False) -> Path:
    """Writes a UTF-8 text file under a temporary name, then renames it. Returns the path.

    Raises:
        UserError: the file exists and `overwrite` is False, or it cannot be written.
    """
    return write_bytes_atomic(path, text.encode("utf-8"), overwrite=overwrite)


def write_bytes_atomic(path: str | Path, data: bytes, *, overwrite: bool = False) -> Path:
    """Like `write_text_atomic`, for bytes."""
    target = Path(path).expanduser().resolve()
    if target.is_dir():
        raise UserError("is a folder", file=path, expected="a file")
    if target.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=path)
    part = _sibling(target)
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        part.touch()
        with _held(part):
            part.write_bytes(data)
            os.replace(part, target)
    except OSError as error:
        with suppress(OSError):  # where its folder is none, asking for it is an error too
            part.unlink()
        raise UserError(f"cannot be written: {_why(error)}", file=path) from error
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return Path(path)


def remove_unfinished(file: Path) -> None:
    """Removes a record of work in progress that is finished now, and its folder if nothing else is in it."""
    file.unlink(missing_ok=True)
    if file.parent.is_dir():
        remove_abandoned(file)
        if not any(file.parent.iterdir()):
            file.parent.rmdir()


@contextmanager
def _held(part: Path, surely: bool = False) -> Iterator[None]:
    """Locks a temporary sibling while it is being written: the lock ends with the process, however that ends.

    Raises:
        OSError: `surely`, and another process holds it or the file system knows no locks.
    """
    handle = os.open(part, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if surely:
                raise
        yield
    finally:
        os.close(handle)


@contextmanager
def _terminable() -> Iterator[None]:
    """SIGTERM unwinds the stack (exit code 143) as an interrupt does, unless the program has a handler of its own."""
    ours = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
    if not ours:
        yield
        return
    owner = os.getpid()

    def stop(number: int, _: object) -> None:
        if os.getpid() != owner:  # a forked helper has nothing to clean up
            os._exit(128 + number)
        raise SystemExit(128 + number)

    signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


def _why(error: OSError) -> str | None:
    """What the system said; of a parent that is a file it says no more than that it exists."""
    return "a folder above it is a file" if isinstance(error, FileExistsError | NotADirectoryError) else error.strerror


def _sibling(target: Path, end: str = "part") -> Path:
    return target.with_name(f".{target.name}.{uuid.uuid4().hex[:8]}.{end}")


def _refuse(target: Path, said: str | Path, overwrite: bool) -> None:
    if not target.exists():
        return
    if not target.is_dir():
        raise UserError("is a file", file=said, expected="a folder, new or empty")
    if not any(target.iterdir()):
        return
    if not overwrite:
        raise UserError("exists already and is not empty; name another or pass --overwrite", file=said)
    for kept in (Path.cwd(), Path.home()):
        if kept.resolve().is_relative_to(target):
            raise UserError(f"holds {kept}, so it is not replaced", file=said, expected="a folder of results")
    if (target / ".git").exists():
        raise UserError("is a git checkout, so it is not replaced", file=said, expected="a folder of results")


def _swap(part: Path, target: Path) -> None:
    """Renames `part` to `target`; content already there is removed only after the new stands in its place."""
    try:
        if not target.exists() or not any(target.iterdir()):
            os.replace(part, target)
            return
        old = _sibling(target, "old")
        os.replace(target, old)
        try:
            os.replace(part, target)
        except OSError:
            os.replace(old, target)
            raise
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise UserError(f"cannot be replaced: {error.strerror}", file=target) from error
