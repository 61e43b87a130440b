"""The placeholders for option values in help texts, and the choices that options have."""

from __future__ import annotations

from dataclasses import MISSING
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

WORDS: dict[object, str] = {int: "N", float: "X", str: "NAME", Path: "PATH"}
TEXTS = {  # field -> placeholder, for text values other than names
    "search": "TEXT",
    "size": "WxH",
    "pattern": "CxR",
    "look": "WORLD/SEED",
    "episodes": "FIRST:LAST",
    "sweep": "SWEEP",
    **dict.fromkeys(("noise", "set", "resolution", "accuracy", "conditions", "columns"), "KEY=VALUE"),
    **dict.fromkeys(("topic", "command_topic", "pose_topic", "wrench_topic"), "TOPIC"),
    "effects": "EFFECT:WHERE",
}
NAMED = {  # field -> kind of named thing, for values that can be names of bundled things
    "world": "worlds",
    "worlds": "worlds",
    "known_world": "worlds",
    "train": "worlds",
    "target": "worlds",
    "model": "models",
    "policy": "policies",
    "policies": "policies",
    "teacher": "policies",
    "motion": "motions",
    "effect": "effects",
}


def _parts(bare: Any) -> list[Any]:
    """Return the types inside a tuple or union, without None; else the type itself."""
    if get_origin(bare) in (Union, UnionType):
        return [p for part in get_args(bare) if part is not NoneType for p in _parts(part)]
    if get_origin(bare) is tuple:
        return [p for part in get_args(bare) if part is not ... for p in _parts(part)]
    return [bare]


def choices(bare: Any) -> tuple[str, ...]:
    """Return the values that a Literal type allows; empty for other types."""
    return tuple(str(c) for part in _parts(bare) if get_origin(part) is Literal for c in get_args(part))


def plain(hint: Any) -> type[Any] | None:
    """Return the type of the values if all are int, float, str or Path; else None."""
    kinds = set(_parts(hint))
    kind = kinds.pop() if len(kinds) == 1 else None
    return kind if kind in WORDS else None


def metavar(name: str, kind: Any, positional: bool, default: Any) -> str | None:
    """Return the placeholder for an option's values in the help text, such as NAME or {a,b}; None for a switch.

    Args:
        name: name of the option.
        kind: type of the value.
        positional: whether it is a positional argument.
        default: default value; MISSING if required.
    """
    basic = plain(kind)
    tuple_type = next((p for p in (kind, *get_args(kind)) if get_origin(p) is tuple), None)
    if few := choices(kind):
        word = f"{{{','.join(few)}}}"
    elif positional:
        word = name.upper().replace("_", "-")
        if tuple_type and word.endswith("IES"):  # in the singular, as each value is shown by one word
            word = f"{word[:-3]}Y"
        elif tuple_type:
            word = word.removesuffix("S")
    elif basic is None:
        return None  # a switch
    else:
        word = TEXTS.get(name, WORDS[basic]) if basic is str else WORDS[basic]
    if tuple_type is None:
        return f"[{word}]" if positional and default is not MISSING else word
    if ... not in get_args(tuple_type):
        return " ".join(word for _ in get_args(tuple_type))
    return f"[{word} ...]" if default is not MISSING and positional else f"{word} [{word} ...]"


def default_shown(value: Any) -> str:
    """Return a default as users would type it, for the help text; "" for a default that means "none"."""
    if value is MISSING:
        return "(required)"
    if value is None or value is False or value == () or value == "":
        return ""
    parts = value if isinstance(value, tuple) else (value,)
    return f"(default: {' '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in parts)})"
