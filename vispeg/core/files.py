"""Write results so that they appear completely or not at all, and never replace a user's own files."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import signal
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path

from vispeg.core.disk import failed_in, why
from vispeg.core.errors import UserError
from vispeg.core.lock import claimed
from vispeg.core.marker import apart, mark, refuse_foreign
from vispeg.core.paths import expanded


@contextmanager
def new_folder(
    path: str | Path,
    overwrite: bool = False,
    *,
    holds: str | None = "result",
    inputs: Iterable[str | Path | None] = (),
) -> Iterator[Path]:
    """Create a folder that gets its name only after everything in it has been written.

    The body writes into a temporary sibling folder (yielded), which is renamed to `path` at the end. If the body raises
    or the process is interrupted or terminated, the temporary folder is removed, and `path` stays as it was. Temporary
    folders of earlier processes that could not clean up (SIGKILL, a power cut) are removed. An empty folder at `path`
    counts as none.

    Args:
        path: of the folder; its parents are created.
        overwrite: whether an existing folder with content is replaced, as a whole.
        holds: kind of result, in a word. It is written into the folder's marker (see `vispeg.core.marker`); only a
            folder of the same kind, without files of others, is replaced. None for a subfolder of a result.
        inputs: files and folders that the body reads; `path` must not be one of them or contain one.

    Raises:
        UserError: `path` is a file, or a folder with content although `overwrite` is False, or must not be replaced
            (see `holds` and `inputs`; also the working directory, the home directory, their parents, and git
            checkouts), or another process is writing it, or it cannot be written.
    """
    target = expanded(path).resolve()  # through a link: its target is replaced, not the link
    with reserved(path, overwrite, holds=holds, inputs=inputs):
        part = _sibling(target)
        try:
            target.parent.mkdir(parents=True, exist_ok=True)
            part.mkdir()
        except OSError as error:
            raise UserError(f"cannot be written: {why(error)}", file=path) from error
        try:
            with _locked(part):
                yield part
                if holds is not None:
                    mark(part, holds)
                refuse(path, overwrite, holds=holds)  # again: something may have been written there meanwhile
                _swap(part, target)
        except BaseException as error:
            shutil.rmtree(part, ignore_errors=True)
            if isinstance(error, OSError) and failed_in(part, error):
                raise UserError(f"cannot be written: {why(error)}", file=path) from error
            if isinstance(error, UserError) and str(part) in str(error):  # name the folder as the user does
                raise UserError(str(error).replace(str(part), str(path))) from error
            raise


@contextmanager
def reserved(
    path: str | Path, overwrite: bool, *, holds: str | None, inputs: Iterable[str | Path | None] = ()
) -> Iterator[None]:
    """Reserve a folder's name for the body: long work that ends with `new_folder` with the same arguments.

    Raises:
        UserError: as `new_folder`, before the body runs.
    """
    refuse(path, overwrite, holds=holds, inputs=inputs)
    with claimed(path) if holds is not None else nullcontext(), _terminable():
        try:
            recover(expanded(path).resolve())  # under the lock: another process may have put a folder aside
        except OSError as error:
            raise UserError(f"cannot be written: {why(error)}", file=path) from error
        refuse(path, overwrite, holds=holds)  # again: a folder was recovered, or another process has just finished
        yield


@contextmanager
def set_aside(path: str | Path, kept: Callable[[], bool]) -> Iterator[None]:
    """Move a folder aside while the body makes a new one of the same name, and remove the old one afterwards.

    For work that, unlike the body of `new_folder`, uses its folder under the final name from the start. If the body
    raises before the new folder holds something to keep, the old folder is put back in its place; if the process is
    killed before that, `recover` with the same `kept` puts it back.

    Args:
        path: of the folder, which must exist.
        kept: whether the new folder holds something to keep.

    Raises:
        UserError: the folder cannot be moved, or cannot be put back; then the message says where it is.
    """
    target = expanded(path).resolve()
    old, failed = _sibling(target, "old"), _sibling(target)
    try:
        os.replace(target, old)
    except OSError as error:
        raise UserError(f"cannot be replaced: {why(error)}", file=path) from error
    try:
        yield
    except BaseException:
        if not kept():
            try:
                if target.exists():
                    os.replace(target, failed)  # renamed, as its removal could stop half-way
                os.replace(old, target)
            except OSError as error:
                what = f"cannot be put back as it was: {why(error)}; move its content from {old} before the next run"
                raise UserError(what, file=path) from error
            shutil.rmtree(failed, ignore_errors=True)
        else:
            _discard(old, target)
        raise
    _discard(old, target)


def refuse(
    path: str | Path, overwrite: bool, *, holds: str | None = "result", inputs: Iterable[str | Path | None] = ()
) -> None:
    """Raise UserError if `new_folder` would refuse these arguments; call it before long work."""
    target = expanded(path).resolve()
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


def recover(target: Path, kept: Callable[[], bool] = lambda: True) -> bool:
    """Restore the content of `target` if a process was killed while it replaced it, and remove leftovers.

    Args:
        target: a resolved path.
        kept: whether an existing `target` holds something to keep. If not, what was put aside for it comes back.

    Returns:
        Whether the content was restored.
    """
    if not target.parent.is_dir():
        return False
    set_aside, restored = _siblings(target, "old"), False
    with suppress(OSError):
        if set_aside and not (target.exists() and kept()):
            if target.exists():
                _discard(target, target)
            os.replace(set_aside.pop(), target)  # the newest
            restored = True
        for old in set_aside:
            _discard(old, target)
        remove_abandoned(target)
    return restored


def _discard(folder: Path, target: Path) -> None:
    """Remove a folder beside `target`, or `target` itself, if possible.

    It is renamed first: `recover` must not restore what is left of it if the removal stops half-way.
    """
    with suppress(OSError):
        os.replace(folder, doomed := _sibling(target))
        shutil.rmtree(doomed, ignore_errors=True)


def remove_abandoned(target: Path) -> None:
    """Remove the temporary siblings of `target` (named `.NAME.8 hex digits.part`) that no process has locked."""
    for part in _siblings(target, "part"):
        with suppress(OSError), _locked(part, required=True):  # kept if another process locks it, or without locks
            if part.is_dir():
                shutil.rmtree(part, ignore_errors=True)
            else:
                part.unlink()


def write_text_atomic(path: str | Path, text: str, *, overwrite: bool = False) -> Path:
    """Write a UTF-8 text file under a temporary name, then rename it; return the path.

    Raises:
        UserError: the file exists and `overwrite` is False, or it cannot be written.
    """
    return write_bytes_atomic(path, text.encode("utf-8"), overwrite=overwrite)


def write_bytes_atomic(path: str | Path, data: bytes, *, overwrite: bool = False) -> Path:
    """Write bytes as `write_text_atomic` writes text; return the path. Leftovers of killed processes are removed."""
    target = expanded(path).resolve()
    if target.is_dir():
        raise UserError("is a folder", file=path, expected="a file")
    if target.exists() and not overwrite:
        raise UserError("exists already; name another or pass --overwrite", file=path)
    _write({Path(path): data})
    return Path(path)


def write_files_atomic(files: Mapping[Path, bytes], *, overwrite: bool) -> None:
    """Write several files, such as one and those to which it refers: all of them or, if one fails, none.

    Args:
        files: path -> content.
        overwrite: whether existing files with different content are replaced; equal content is no conflict.

    Raises:
        UserError: one exists with different content and `overwrite` is False, is a folder, or cannot be written.
    """
    for path, data in files.items():
        target = expanded(path).resolve()
        if target.is_dir():
            raise UserError("is a folder", file=path, expected="a file")
        if target.exists() and not overwrite and target.read_bytes() != data:
            raise UserError("exists already; name another or pass --overwrite", file=path)
    _write(files)


def _write(files: Mapping[Path, bytes]) -> None:
    """Write all files under temporary names, then rename them; if one fails, each path is as it was before.

    Raises:
        UserError: one of them cannot be written.
    """
    temporary: list[Path] = []
    renames: list[tuple[Path, Path, Path, Path | None]] = []  # path, its resolved form, new content, copy of the old
    renamed: list[tuple[Path, Path | None]] = []  # resolved path, copy of the old content
    new: list[Path] = []  # folders to create, the deepest first
    path = Path()
    try:
        with ExitStack() as locks:

            def begun(target: Path) -> Path:
                temporary.append(part := _sibling(target))
                part.touch()
                locks.enter_context(_locked(part))
                return part

            for path, data in files.items():
                target = expanded(path).resolve()
                new = [folder for folder in target.parents if not folder.exists()] + new
                target.parent.mkdir(parents=True, exist_ok=True)
                remove_abandoned(target)
                part = begun(target)
                part.write_bytes(data)
                old = None
                if target.exists() and len(files) > 1:  # a single rename succeeds or changes nothing
                    old = begun(target)
                    shutil.copy2(target, old)
                renames.append((path, target, part, old))
            for rename in renames:
                path, target, part, old = rename  # `path` is named by an error below
                os.replace(part, target)
                renamed.append((target, old))
    except BaseException as error:
        for target, old in renamed:
            with suppress(OSError):
                if old is None:
                    target.unlink()
                else:
                    os.replace(old, target)
        _unlink(temporary)
        for folder in new:
            with suppress(OSError):
                folder.rmdir()
        if isinstance(error, OSError):
            raise UserError(f"cannot be written: {why(error)}", file=path) from error
        raise
    _unlink(temporary)


def _unlink(files: Iterable[Path]) -> None:
    """Remove files if they exist and can be removed."""
    for file in files:
        with suppress(OSError):
            file.unlink()


def remove_unfinished(file: Path) -> None:
    """Remove the file that recorded unfinished work, once the work is done, and its folder if that is then empty."""
    file.unlink(missing_ok=True)
    if file.parent.is_dir():
        remove_abandoned(file)
        if not any(file.parent.iterdir()):
            file.parent.rmdir()


@contextmanager
def _locked(part: Path, required: bool = False) -> Iterator[None]:
    """Lock a temporary sibling during the body, if possible. The lock always ends with the process.

    Raises:
        OSError: `required` is True, and another process has the lock or the file system has no locks.
    """
    handle = os.open(part, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            if required:
                raise
        yield
    finally:
        os.close(handle)


@contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM unwind the stack (exit code 143), like an interrupt, unless the program has its own handler."""
    in_main = threading.current_thread() is threading.main_thread()  # no other thread may set handlers
    if not in_main or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
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
    """List the existing paths that `_sibling` named, oldest first."""
    pattern = re.compile(re.escape(f".{target.name}.") + rf"[0-9a-f]{{8}}\.{end}")
    matches = [p for p in target.parent.iterdir() if pattern.fullmatch(p.name) and not p.is_symlink()]
    aged = []
    for path in matches:
        with suppress(OSError):  # another process may have just removed it
            aged.append((path.stat().st_mtime_ns, path))
    return [path for _, path in sorted(aged)]


def _swap(part: Path, target: Path) -> None:
    """Rename `part` to `target`; the old content of `target` is removed only after that.

    Raises:
        UserError: `target` cannot be replaced.
    """
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
        _discard(old, target)
    except OSError as error:
        raise UserError(f"cannot be replaced: {why(error)}", file=target) from error
