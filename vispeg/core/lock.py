"""Locks that allow one writer per result; a second one gets an error that names the first.

A lock always ends with its process.
"""

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
from vispeg.core.paths import expanded
from vispeg.core.provenance import command_line

LOCK = ".lock"  # name of the lock's file if it is in the result, because the folder above is not writable
_MINE: set[Path] = set()  # results that this process has locked; it may claim them again


@contextmanager
def claimed(out: str | Path) -> Iterator[None]:
    """Keep other processes from writing `out` while the body runs.

    The lock is the file `.NAME.lock` beside `out`, or `.lock` in it if the folder above is not writable. It is removed
    after the body. The file of a killed process does not lock anything. On a file system without locks there is no
    protection.

    Raises:
        UserError: another process writes `out` (it states the process, its command and since when), or the lock's file
            cannot be created.
    """
    target = expanded(out).resolve()
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
    """Return the path of a result's lock."""
    beside = target.parent
    while not beside.exists():
        beside = beside.parent
    if target.is_dir() and not os.access(beside, os.W_OK):
        return target / LOCK
    return target.with_name(f".{target.name}.lock")


def _open(path: Path) -> int | None:
    """Lock a file, write this process into it, and return the open handle; None if another process has the lock."""
    path.parent.mkdir(parents=True, exist_ok=True)
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(handle)
            return None
        except OSError:  # a file system without locks
            return handle
        with suppress(OSError):
            if os.path.samestat(os.fstat(handle), os.stat(path)):
                break
        os.close(handle)  # the last holder has just removed this file: try again with a new one
    who = {"pid": os.getpid(), "host": socket.gethostname(), "command": command_line(sys.argv)}
    with suppress(OSError):  # on a full disk the lock holds although the file stays empty
        os.ftruncate(handle, 0)
        os.write(handle, json.dumps({**who, "since": time.strftime("%Y-%m-%d %H:%M:%S")}).encode())
    return handle


def _holder(path: Path) -> str:
    """Say which process has the lock, as its file states it."""
    try:
        who = json.loads(path.read_text(encoding="utf-8"))
        here = "" if who["host"] == socket.gethostname() else f" on {who['host']}"
        return f"process {who['pid']}{here} writes it since {who['since']} ({who['command']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process writes it"
