"""Read untrusted JSON as plain data."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vispeg.core.errors import UserError
from vispeg.formats.guard import MB, check, read_text


class _RepeatedKeyError(Exception):
    """A key that is given twice in one mapping."""


def read_json(path: str | Path, *, most: int = 64 * MB, finite: bool = True) -> Any:
    """Read a JSON file.

    Args:
        path: of the file.
        most: greatest size, bytes.
        finite: whether infinite numbers and NaN are refused.

    Raises:
        UserError: an unreadable file, not JSON, a repeated key, or data beyond the limits of `vispeg.formats.guard`.
    """
    return parse_json(read_text(path, most), path, finite=finite)


def parse_json(text: str | bytes, file: str | Path, key: str | None = None, *, finite: bool = True) -> Any:
    """Parse JSON text; `file` and `key` are named in messages. Raises UserError as `read_json` does."""
    try:
        data = json.loads(text, object_pairs_hook=_mapping)
    except json.JSONDecodeError as error:
        at = key or f"line {error.lineno}"
        raise UserError(f"is not JSON ({error.msg.lower()})", file=file, key=at) from None
    except _RepeatedKeyError as error:
        at = f"{key}: {error}" if key else str(error)
        raise UserError("is given twice", file=file, key=at) from None
    except RecursionError:
        raise UserError("is nested too deeply", file=file, key=key) from None
    except UnicodeDecodeError as error:
        raise UserError(f"is not UTF-8 text (byte {error.start})", file=file, key=key) from None
    except ValueError:  # Python's own limit of some thousand digits
        raise UserError("holds a number with too many digits", file=file, key=key) from None
    check(data, file, key, finite=finite)
    return data


def _mapping(pairs: Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dictionary. Raises _RepeatedKeyError."""
    data = dict(pairs)
    if len(data) < len(pairs):
        earlier: set[str] = set()
        for key, _ in pairs:
            if key in earlier:
                raise _RepeatedKeyError(key)
            earlier.add(key)
    return data
