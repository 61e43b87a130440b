"""Writing results so that they appear whole or not at all, and never on top of a user's own files."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import signal
import threading
import uuid
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

from vispeg.core.disk import failed_in, why
from vispeg.core.errors import UserError
from vispeg.core.lock import claimed
from vispeg.core.marker import apart, mark, refuse_foreign


@contextmanager
def new_folder(
    path: str | Path,
    overwrite: bool = False,
    *,
    holds: str | None = "result",
    inputs: Iterable[str | Path | None] = (),
) -> Iterator[Path]:
    """Give a folder that takes its name only once everything in it has been written.

    The body writes into a temporary sibling, which is renamed to `path` at the end, and removed if the body raises or
    the process is interrupted or terminated; what stood at `path` before is then still there, untouched. What an
    earlier process could not clear away (SIGKILL, a power cut) is removed. An empty folder at `path` counts as none.

    Args:
        path: where the folder shall be; its parents are made.
        overwrite: whether an existing folder with content is replaced, as a whole.
        holds: what it is, in a word: kept in its marker (see `vispeg.core.marker`), and only a folder with the same
            word and no file of anybody else's is replaced. None for a part of a folder that is this program's own.
        inputs: what the body reads; `path` may be none of it, nor a folder above.

    Raises:
        UserError: `path` is a file, or a folder with content while `overwrite` is False, or one that must not be
            replaced (see `holds`, `inputs`; the working or home directory, one above them, a git checkout), or another
            process is writing it, or it cannot be written.
    """
    target = Path(path).expanduser().resolve()  # through a link: its target is replaced, not the link
    refuse(path, overwrite, holds=holds, inputs=inputs)
    with claimed(path) if holds is not None else nullcontext():
        part = _sibling(target)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            remove_abandoned(target)
            recover(target)
            refuse(path, overwrite, holds=holds)  # what was recovered, or what another process has just finished
            part.mkdir()
        except OSError as error:
            raise UserError(f"cannot be written: {why(error)}", file=path) from error
        try:
            with _terminable(), _held(part):
                yield part
                if holds is not None:
                    mark(part, holds)
                refuse(path, overwrite, holds=holds)  # something may have come to stand there meanwhile
                _swap(part, target)
        except BaseException as error:
            shutil.rmtree(part, ignore_errors=True)
            if isinstance(error, OSError) and failed_in(part, error):
                raise UserError(f"cannot be written: {why(error)}", file=path) from error
            if isinstance(error, UserError) and str(part) in str(error):  # a name that the user never sees
                raise UserError(str(error).replace(str(part), str(path))) from error
            raise


@contextmanager
def reserved(
    path: str | Path, overwrite: bool = False, *, holds: str = "result", inputs: Iterable[str | Path | None] = ()
) -> Iterator[None]:
    """Keep a folder's name for long work that ends with `new_folder` under the same arguments.

    Raises:
        UserError: as `new_folder`, before the body runs.
    """
    recover(Path(path).expanduser().resolve())
    refuse(path, overwrite, holds=holds, inputs=inputs)
    with claimed(path), _terminable():
        yield


def refuse(
    path: str | Path, overwrite: bool, *, holds: str | None = "result", inputs: Iterable[str | Path | None] = ()
) -> None:
    """Raise the UserError with which `new_folder` would refuse, for work that takes long before it comes to that."""
    target = Path(path).expanduser().resolve()
    apart(path, inputs)
    if not target.exists():
        return
    if not target.is_dir():
        raise UserError("is a file", file=path, expected="a folder, new or empty")
    if not any(target.iterdir()):
        return
    if not overwrite:
        raise UserError("exists already and is not empty; name another or pass --overwrite", file=path)
    for protected in (Path.cwd(), Path.home()):
        if protected.resolve().is_relative_to(target):
            raise UserError(f"holds {protected}, so it is not replaced", file=path, expected="a folder of results")
    if (target / ".git").exists():
        raise UserError("is a git checkout, so it is not replaced", file=path, expected="a folder of results")
    if holds is not None:
        refuse_foreign(target, holds, path)


def recover(target: Path) -> None:
    """Put back what a process that was killed in the act of replacing `target` had put aside; clear up after it."""
    if not target.parent.is_dir():
        return
    aside = _siblings(target, "old")
    with suppress(OSError):
        if aside and not target.exists():
            os.replace(aside.pop(), target)
        for old in aside:
            shutil.rmtree(old, ignore_errors=True)


def remove_abandoned(target: Path) -> None:
    """Remove the temporary siblings of `target` (made here: `.NAME.8 hex digits.part`) that no process holds."""
    for part in _siblings(target, "part"):
        with suppress(OSError), _held(part, surely=True):  # held by another, or a disk without locks: it stays
            shutil.rmtree(part, ignore_errors=True) if part.is_dir() else part.unlink()


def write_text_atomic(path: str | Path, text: str, *, overwrite: bool = False) -> Path:
    """Write a UTF-8 text file under a temporary name, then rename it. Returns the path.

    Raises:
        UserError: the file exists and `overwrite` is False, or it cannot be written.
    """
    return write_bytes_atomic(path, text.encode("utf-8"), overwrite=overwrite)


def write_bytes_atomic(path: str | Path, data: bytes, *, overwrite: bool = False) -> Path:
    """Like `write_text_atomic`, for bytes. What a killed process left of the same file is removed."""
    target = Path(path).expanduser().resolve()
    if target.is_dir():
        raise UserError("is a folder", file=path, expected="a file")
    if target.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=path)
    _write({Path(path): data})
    return Path(path)


def write_files_atomic(files: Mapping[Path, bytes], *, overwrite: bool = False) -> None:
    """Write a file and those beside it that it refers to: all of them or, where one cannot be, none.

    Args:
        files: path -> content.
        overwrite: whether files with another content are replaced; one with the same content is no conflict.

    Raises:
        UserError: one of them exists with another content and `overwrite` is False, or cannot be written.
    """
    for path, data in files.items():
        if path.is_dir():
            raise UserError("is a folder", file=path, expected="a file")
        if path.exists() and not overwrite and path.read_bytes() != data:
            raise UserError("exists already; name another or pass --overwrite", file=path)
    _write(files)


def _write(files: Mapping[Path, bytes]) -> None:
    """Write all files under temporary names, then rename them, so that a full disk leaves nothing behind.

    Raises:
        UserError: one of them cannot be written.
    """
    parts: dict[Path, tuple[Path, Path]] = {}
    new: list[Path] = []
    path = Path()
    try:
        with ExitStack() as held:
            for path, data in files.items():
                target = path.expanduser().resolve()
                new = [folder for folder in target.parents if not folder.exists()] + new
                target.parent.mkdir(parents=True, exist_ok=True)
                remove_abandoned(target)
                part = _sibling(target)
                parts[part] = path, target
                part.touch()
                held.enter_context(_held(part))
                part.write_bytes(data)
            for part in parts:
                path, target = parts[part]  # an error names this path
                os.replace(part, target)
    except BaseException as error:
        for part in parts:
            with suppress(OSError):  # where its folder is none, asking for it is an error too
                part.unlink()
        for folder in new:
            with suppress(OSError):
                folder.rmdir()
        if isinstance(error, OSError):
            raise UserError(f"cannot be written: {why(error)}", file=path) from error
        raise


def remove_unfinished(file: Path) -> None:
    """Remove a record of work in progress that is finished now, and its folder if nothing else is in it."""
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


def _sibling(target: Path, end: str = "part") -> Path:
    return target.with_name(f".{target.name}.{uuid.uuid4().hex[:8]}.{end}")


def _siblings(target: Path, end: str) -> list[Path]:
    """Give what `_sibling` has named, oldest first."""
    ours = re.compile(re.escape(f".{target.name}.") + rf"[0-9a-f]{{8}}\.{end}")
    matches = [p for p in target.parent.iterdir() if ours.fullmatch(p.name) and not p.is_symlink()]
    aged = []
    for path in matches:
        with suppress(OSError):  # another process has just cleared it away
            aged.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(aged)]


def _swap(part: Path, target: Path) -> None:
    """Rename `part` to `target`; content already there is removed only after the new stands in its place."""
    try:
        if not target.exists() or not any(target.iterdir()):
            os.replace(part, target)
            return
        old = _sibling(target, "old")
        os.replace(target, old)
        try:
            os.replace(part, target)
        except BaseException:
            os.replace(old, target)
            raise
        shutil.rmtree(old, ignore_errors=True)
    except OSError as error:
        raise UserError(f"cannot be replaced: {why(error)}", file=target) from error
