"""Markers in folders of results, which say what this program wrote and may replace; checks that protect inputs."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.lock import LOCK
from vispeg.core.paths import expanded

MARKER, FORMAT = ".vispeg.json", "vispeg-output/1"
PART = f"{MARKER}.part"
ELSEWHERE = "so it is not replaced; move it away or name another folder"


def mark(folder: Path, holds: str, files: Iterable[str] | None = None) -> None:
    """Write a folder's marker: the kind of result that it holds, and the names of its files.

    Args:
        folder: to mark.
        holds: kind of result, in a word.
        files: names relative to the folder; None for all that are in it.

    Raises:
        OSError: the marker cannot be written.
    """
    names = sorted(name for name in _names(folder) if name != MARKER) if files is None else [*files]
    text = json.dumps({"format": FORMAT, "holds": holds, "files": names}, indent=0) + "\n"
    part = folder / PART
    try:  # renamed when complete: a folder with half a marker could not be replaced any more
        part.write_text(text, encoding="utf-8", errors="surrogateescape")
        part.replace(folder / MARKER)
    except OSError:
        part.unlink(missing_ok=True)
        raise


def untouched(folder: Path) -> bool:
    """Return whether a folder is empty, or holds only its lock or the unfinished marker of a killed process."""
    return all(path.name in (PART, LOCK) for path in folder.iterdir())


def holds(folder: Path) -> str | None:
    """Return the kind of result in a folder's marker; None without a valid marker."""
    record = _marker(folder)
    return None if record is None else record["holds"]


def refuse_foreign(folder: Path, holds: str, named: str | Path | None = None) -> None:
    """Raise UserError unless everything in `folder` was written by this program, as a result of one kind.

    Args:
        folder: to be replaced.
        holds: kind of the new result, as for `mark`.
        named: the folder as the user named it, for the error; None for `folder`.
    """
    file, record = named or folder, _marker(folder)
    if record is None:
        raise UserError(
            f"has no {MARKER} (this program did not write it, or an old version did), {ELSEWHERE}", file=file
        )
    if record["holds"] != holds:
        raise UserError(f"holds another kind of result ({record['holds']}, not {holds}), {ELSEWHERE}", file=file)
    ours = {MARKER, *record["files"]}
    for name in _names(folder):
        if name not in ours:
            raise UserError(f"holds {name}, which this program did not write, {ELSEWHERE}", file=file)


def apart(out: str | Path, inputs: Iterable[str | Path | None]) -> None:
    """Raise UserError if `out` is one of the files and folders that a command reads, or a folder above one.

    Paths are compared as the file system does, so links, relative paths and ignored case do not matter. A `str` without
    a separator or suffix is the name of something built in, not a path.
    """
    for source in inputs:
        if source is None or (isinstance(source, str) and not (os.sep in source or Path(source).suffix)):
            continue
        path = expanded(source)
        if not path.exists():
            continue
        named, real = Path(os.path.abspath(path)), path.resolve()
        if any(_same(alias, out) for alias in (named, real)):
            raise UserError("is read by this command", file=out, expected="another place for what it writes")
        if any(_same(ancestor, out) for ancestor in (*named.parents, *real.parents)):
            raise UserError(f"holds {source}, which this command reads", file=out, expected="another place to write to")


def _same(path: Path, out: str | Path) -> bool:
    """Return whether two paths lead to the same existing file or folder."""
    try:
        return os.path.samefile(path, expanded(out))
    except OSError:  # one of them does not exist
        return False


def _marker(folder: Path) -> dict | None:
    """Return the content of a folder's marker; None without a valid one."""
    try:
        data = json.loads((folder / MARKER).read_text(encoding="utf-8", errors="surrogateescape"))
        valid = data["format"] == FORMAT and isinstance(data["holds"], str) and isinstance(data["files"], list)
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return data if valid else None


def _names(folder: Path) -> Iterator[str]:
    """Yield the relative paths of all files and links in a folder and its subfolders; links are not followed."""
    for place, folders, files in os.walk(folder):
        for name in (*files, *(d for d in folders if os.path.islink(os.path.join(place, d)))):
            yield os.path.relpath(os.path.join(place, name), folder)
