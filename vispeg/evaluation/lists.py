"""Read the files with the lists of suites and stress tests."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.formats.format import Format

HERE = Path(__file__).parent


def read_list(path: Path, form: Format, key: str, allowed: tuple[str, ...]) -> list[Mapping[str, object]]:
    """Return the entries under `key` of a file of format `form`.

    Args:
        path: the file.
        form: its format.
        key: key of the list.
        allowed: keys that an entry may have.

    Raises:
        UserError: no entries, or an entry without a name of its own or with an unknown key; names file and entry.
    """
    entries = form.read(path).get(key)
    if not isinstance(entries, list) or not entries:
        raise UserError("no entries", file=path, key=key, expected="a list")
    names: set[str] = set()
    for i, entry in enumerate(entries):
        where = f"{key}[{i}]"
        if not isinstance(entry, Mapping) or not isinstance(entry.get("name"), str):
            raise UserError("an entry without a name", file=path, key=where, got=entry)
        for name in entry:
            if name not in allowed:
                raise UserError("unknown key", file=path, key=where, got=name, choices=allowed)
        if entry["name"] in names:
            raise UserError("two entries share a name", file=path, key=where, got=entry["name"])
        names.add(entry["name"])
    return [dict(entry) for entry in entries]
