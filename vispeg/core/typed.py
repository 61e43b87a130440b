"""Check values from YAML or JSON against the annotations of a dataclass: numbers, texts, and lists of them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any, ClassVar, get_args, get_origin, get_type_hints

from vispeg.core.errors import UserError


def checked(kind: type, values: Mapping[str, Any], file: str | None, at: str) -> dict[str, Any]:
    """Check values, and return them as keyword arguments of a dataclass, with lists as tuples.

    Fields with other annotations (a dataclass, a union) are not checked.

    Args:
        kind: the dataclass.
        values: by field.
        file, at: the file, and a prefix of keys, for errors.

    Raises:
        UserError: an unknown key, a wrong type.
    """
    hints, out = _hints(kind), {}
    for key, value in values.items():
        if key not in hints:
            raise UserError("unknown key", file=file, key=f"{at}{key}", got=key, choices=hints)
        out[key] = tuple(value) if isinstance(value, list) else value
        if not _fits(out[key], hints[key]):
            raise UserError("wrong type", file=file, key=f"{at}{key}", expected=_in_words(hints[key]), got=value)
    return out


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Return the annotations of a dataclass's fields, by name."""
    return {k: h for k, h in get_type_hints(kind).items() if get_origin(h) is not ClassVar}


def _fits(value: Any, hint: Any) -> bool:
    """Return whether a value fits a field's annotation; an int fits a float, a bool fits neither number nor text.

    The elements of a tuple must be of one type, such as `tuple[float, float]` or `tuple[float, ...]`.
    """
    if get_origin(hint) is tuple:
        parts = get_args(hint)
        has_length = isinstance(value, tuple) and (... in parts or len(value) == len(parts))
        return has_length and all(_fits(x, parts[0]) for x in value)
    if hint not in WORDS:
        return True
    return isinstance(value, (int, float) if hint is float else hint) and not isinstance(value, bool)


def _in_words(hint: Any) -> str:
    """Return an annotation in words: `a number`, or `a list of 3 numbers`."""
    kind, *others = get_args(hint) or (hint,)
    noun = WORDS[kind]
    if not others:
        return f"a {noun}"
    return f"a list of {noun}s" if ... in others else f"a list of {1 + len(others)} {noun}s"


WORDS = {int: "whole number", float: "number", str: "text"}
