"""Compare plain data with a TypedDict, nested ones included: required keys, unknown keys, and types."""

from collections.abc import Mapping, Sequence
from types import NoneType, UnionType
from typing import Any, NotRequired, Union, get_args, get_origin, get_type_hints, is_typeddict


def mistakes(kind: Any, value: Any, at: str = "record") -> list[str]:
    """List where a value differs from its type."""
    if kind is Any:
        return []
    if is_typeddict(kind):
        if not isinstance(value, dict):
            return [f"{at}: {value!r} is no {kind.__name__}"]
        hints = get_type_hints(kind)
        extras = get_type_hints(kind, include_extras=True)  # not __required_keys__: annotations are strings
        needed = [key for key, hint in extras.items() if get_origin(hint) is not NotRequired]
        out = [f"{at}.{key} is missing" for key in needed if key not in value]
        out += [f"{at}.{key} is unknown" for key in set(value) - set(hints)]
        return out + [m for key, v in value.items() if key in hints for m in mistakes(hints[key], v, f"{at}.{key}")]
    if get_origin(kind) in (Union, UnionType):
        tried = [mistakes(one, value, at) for one in get_args(kind)]
        return [] if [] in tried else min(tried, key=len)
    if get_origin(kind) in (list, Sequence):
        (one,) = get_args(kind)
        if not isinstance(value, list):
            return [f"{at}: {value!r} is no list"]
        return [m for i, v in enumerate(value) for m in mistakes(one, v, f"{at}[{i}]")]
    if get_origin(kind) is tuple:
        if not isinstance(value, tuple | list) or len(value) != len(get_args(kind)):
            return [f"{at}: {value!r} is no {kind}"]
        return [
            m
            for i, (one, v) in enumerate(zip(get_args(kind), value, strict=True))
            for m in mistakes(one, v, f"{at}[{i}]")
        ]
    if get_origin(kind) in (dict, Mapping):
        if not isinstance(value, dict):
            return [f"{at}: {value!r} is no mapping"]
        return [m for key, v in value.items() for m in mistakes(get_args(kind)[1], v, f"{at}.{key}")]
    right = isinstance(value, int | float) if kind is float else isinstance(value, kind)
    return [] if right or (kind is NoneType and value is None) else [f"{at}: {value!r} is no {kind.__name__}"]
