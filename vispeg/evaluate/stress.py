"""Reading the lists that suites and stress tests are made of."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.errors import UserError

HERE = Path(__file__).parent


def read_list(path: Path, form: str, key: str, allowed: tuple[str, ...]) -> list[dict[str, Any]]:
    """The entries under `key` of a YAML file of format `form`, each with a `name` of its own.

    Raises:
        UserError: naming file, entry and key for anything else.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UserError(f"cannot be read ({error.strerror})", file=path) from None
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise UserError(f"not readable as YAML ({str(error).splitlines()[0]})", file=path) from None
    if not isinstance(data, Mapping) or data.get("format") != form:
        got = data.get("format") if isinstance(data, Mapping) else data
        raise UserError("unknown format", file=path, key="format", expected=form, got=got)
    entries = data.get(key)
    if not isinstance(entries, list) or not entries:
        raise UserError("no entries", file=path, key=key, expected="a list")
    seen: set[str] = set()
    for i, entry in enumerate(entries):
        where = f"{key}[{i}]"
        if not isinstance(entry, Mapping) or not isinstance(entry.get("name"), str):
            raise UserError("an entry without a name", file=path, key=where, got=entry)
        for name in entry:
            if name not in allowed:
                raise UserError("unknown key", file=path, key=where, got=name, choices=allowed)
        if entry["name"] in seen:
            raise UserError("a name that stands twice", file=path, key=where, got=entry["name"])
        seen.add(entry["name"])
    return [dict(entry) for entry in entries]
