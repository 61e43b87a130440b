"""Reading this project's YAML files: a mapping with a format line and known keys, or one clear error."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from vispeg.core.errors import UserError


def read_mapping(path: Path, form: str, keys: Sequence[str], what: str) -> Mapping[str, Any]:
    """The top mapping of a file.

    Args:
        path: of the file.
        form: what its key `format` must say.
        keys: that it may have.
        what: the kind of file, for the error.

    Raises:
        UserError: unreadable, not YAML, not a mapping, another format, an unknown key.
    """
    try:
        data = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError, ValueError) as error:
        raise UserError(f"not readable as YAML ({str(error).splitlines()[0]})", file=path) from None
    except OSError as error:
        raise UserError(f"cannot be read ({error.strerror})", file=path) from None
    if not isinstance(data, Mapping):
        raise UserError(f"not a {what} file", file=path, expected="a mapping", got=type(data).__name__)
    if data.get("format") != form:
        raise UserError("unknown format", file=path, key="format", expected=form, got=data.get("format"))
    for key in data:
        if key not in keys:
            raise UserError("unknown key", file=path, key=str(key), got=key, choices=keys)
    return data
