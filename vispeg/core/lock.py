"""One writer at a time for each result: the second gets an error that names the first. A lock ends with its process."""

from __future__ import annotations

import fcntl
import json
import os
import socket
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from vispeg.core.disk import why
from vispeg.core.errors import UserError
from vispeg.core.provenance import command_line

_MINE: set[Path] = set()  # what this process holds: a command may ask again for what it has


@contextmanager
def claimed(out: str | Path) -> Iterator[None]:
    """Keep other processes from writing `out` while the body runs.

    The lock is `.NAME.lock` beside `out`, or in it where nothing may be written beside it, and goes with the body. One
    that a killed process left behind holds nothing. A file system without locks has none.

    Raises:
        UserError: another process writes `out`: its number, its command, since when; or no file can be made there.
    """
    target = Path(out).expanduser().resolve()
    if target in _MINE:
        yield
        return
    path = _place(target)
    try:
        handle = _open(path)
    except OSError as error:
        raise UserError(f"cannot be written: {why(error)}", file=out) from error
    try:
        if handle is None:
            raise UserError(f"{_holder(path)}; wait for it, stop it, or name another folder", file=out)
        _MINE.add(target)
        yield
    finally:
        _MINE.discard(target)
        if handle is not None:
            with suppress(OSError):
                path.unlink()
            os.close(handle)


def _place(target: Path) -> Path:
    beside = target.parent
    while not beside.exists():
        beside = beside.parent
    if target.is_dir() and not os.access(beside, os.W_OK):
        return target / ".lock"
    return target.with_name(f".{target.name}.lock")


def _open(path: Path) -> int | None:
    """Give a handle that holds the lock, with who holds it written in the file; None where another process has it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            return None
        except OSError:  # no locks here
            return handle
        with suppress(OSError):
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                break
        os.close(handle)  # its last holder has just removed it
    who = {"pid": os.getpid(), "host": socket.gethostname(), "command": command_line(sys.argv)}
    with suppress(OSError):  # a full disk: the lock holds without words
        os.ftruncate(handle, 0)
        os.write(handle, json.dumps({**who, "since": time.strftime("%Y-%m-%d %H:%M:%S")}).encode())
    return handle


def _holder(path: Path) -> str:
    try:
        who = json.loads(path.read_text(encoding="utf-8"))
        here = "" if who["host"] == socket.gethostname() else f" on {who['host']}"
        return f"process {who['pid']}{here} writes it since {who['since']} ({who['command']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process writes it"
