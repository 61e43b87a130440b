"""Damage a file in one place: a value of another kind, a missing or new key, or something that is no regular file."""

import copy
import json
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError

NUMBERS = [-1, 0, 1e-300, 1.5, 10**18, 10**40, float("nan"), float("inf")]
BAD = [None, True, "", "x", "../../x", "\x00", *NUMBERS, [], {}, [[1]], {"a": 1}]
FILES = ["missing", "empty", "half", "garbage", "folder", "fifo", "loop", "utf16", "deep", "list", "flipped"]


def values(data: Any, bad: list[Any] = BAD, most: int = 3) -> Iterator[tuple[str, Any]]:
    """Yield each change in words, and the data with it. In lists only the first `most` entries are changed."""
    for way in list(_ways(data, most)):
        place = ".".join(map(str, way)) or "all"
        for value in bad:
            yield f"{place} = {value!r}", _with(data, way, lambda holder, key, v=value: holder.__setitem__(key, v))
        if way:
            yield f"{place} removed", _with(data, way, lambda holder, key: holder.__delitem__(key))
        if isinstance(_at(data, way), dict):
            yield f"{place} with a key more", _with(data, (*way, "unheard_of"), lambda h, key: h.__setitem__(key, 1))


def _ways(data: Any, most: int, way: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield way
    entries = data.items() if isinstance(data, dict) else enumerate(data[:most]) if isinstance(data, list) else ()
    for key, value in entries:
        yield from _ways(value, most, (*way, key))


def _at(data: Any, way: tuple[Any, ...]) -> Any:
    for key in way:
        data = data[key]
    return data


def _with(data: Any, way: tuple[Any, ...], change: Callable[[Any, Any], None]) -> Any:
    box = {"all": copy.deepcopy(data)}
    holder = _at(box, ("all", *way)[:-1])
    change(holder, ("all", *way)[-1])
    return box["all"]


def json_files(path: Path, every: int = 1, **more: Any) -> Iterator[str]:
    """Writes each (or every n-th) change of a JSON file in its place, and the file itself again at the end."""
    with kept(path):
        for what, data in islice(values(json.loads(path.read_text(encoding="utf-8")), **more), 0, None, every):
            path.write_text(json.dumps(data), encoding="utf-8")
            yield f"{path.name}: {what}"


def files(folder: Path, names: list[str]) -> Iterator[str]:
    """Replace each of the files by something else, one at a time; yield what was done."""
    for name in names:
        path = folder / name
        content = path.read_bytes()
        for how in FILES:
            with kept(path):
                _spoil(path, how, content)
                yield f"{name} {how}"


def _spoil(path: Path, how: str, content: bytes) -> None:
    path.unlink()
    text = {"empty": b"", "half": content[: len(content) // 2], "garbage": bytes(range(256)) * 8, "list": b"[1, 2]"}
    text |= {"utf16": "{}".encode("utf-16"), "deep": b"[" * 100_000, "flipped": _flipped(content)}
    if how in text:
        path.write_bytes(text[how])
    elif how == "folder":
        path.mkdir()
    elif how == "fifo":
        os.mkfifo(path)
    elif how == "loop":
        path.symlink_to(path)


def _flipped(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes(255 - b for b in content[middle : middle + 16]) + content[middle + 16 :]


@contextmanager
def kept(path: Path) -> Iterator[None]:
    """Restore the file after the block."""
    content = path.read_bytes()
    try:
        yield
    finally:
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
        path.write_bytes(content)


def tried(action: Callable[[], Any]) -> str:
    """Return how an action ends: `fine`, one line of a UserError, or `TRACEBACK ...`."""
    try:
        found = action()
    except UserError as error:
        text = str(error)
        return text if "\n" not in text else f"TRACEBACK of several lines: {text}"
    except Exception as error:
        return f"TRACEBACK {type(error).__name__}: {error}"
    return "; ".join(found) if isinstance(found, list) and found else "fine"


def unclear(outcomes: dict[str, str]) -> list[str]:
    """List the changes that ended in a traceback."""
    return [f"{what}: {how}" for what, how in outcomes.items() if how.startswith("TRACEBACK")]
