"""What a command takes, read from its dataclass: its options, their choices, and the words for their values in help."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import tyro

WORDS: dict[object, str] = {int: "N", float: "X", str: "NAME", Path: "PATH"}
TEXTS = {  # words for values that are no names, by field
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
POSITIONAL = get_args(tyro.conf.Positional[int])[-1]  # the mark that tyro puts on a positional argument
NAMED = {  # fields whose values are names of what comes with the package
    "world": "worlds",
    "worlds": "worlds",
    "known_world": "worlds",
    "train": "worlds",
    "target": "worlds",
    "model": "robots",
    "policy": "policies",
    "policies": "policies",
    "teacher": "policies",
    "motion": "motions",
    "effect": "effects",
}


@dataclass(frozen=True)
class Option:
    """One argument.

    Attributes:
        name: of its field.
        flag: `--name`, or "" where it is positional.
        choices: the legal values, where they are few.
        takes: whether a value follows the flag.
        path: whether that is a file or a folder.
        repeats: whether the flag may come several times, with a value each.
    """

    name: str
    flag: str
    choices: tuple[str, ...] = ()
    takes: bool = True
    path: bool = False
    repeats: bool = False


def options(kind: type[Any]) -> list[Option]:
    """Those of a command's dataclass, in order; of a command with sub-commands, none."""
    return [_option(field, hint) for field, hint in _leaves(kind) if not _subcommands(hint)]


def subcommands(kind: type[Any]) -> dict[str, type[Any]]:
    """Name -> dataclass of each sub-command."""
    return {name: leaf for _, hint in _leaves(kind) for name, leaf in _subcommands(hint).items()}


def subcommand(kind: type[Any]) -> object:
    """Tyro's mark of a sub-command: its name, and the first line of its docstring for the list of them."""
    return tyro.conf.subcommand(kind.__name__.lower(), description=(kind.__doc__ or "").partition("\n")[0])


def changed(args: Any, besides: Collection[str] = ()) -> list[Option]:
    """Give the options of a command, those in its groups included, whose value is not the default; none of
    `besides`.
    """
    out = list[Option]()
    hints = get_type_hints(type(args), include_extras=True)
    for field in fields(args):
        value = getattr(args, field.name)
        if is_dataclass(value):
            out += changed(value, besides)
        elif field.name not in besides and value != field.default:
            out.append(_option(field, hints[field.name]))
    return out


def describe(kind: type[Any]) -> None:
    """Give the values in a command's help words: MODEL for STR, no `{None}`, and defaults as people type them."""
    for leaf in (kind, *subcommands(kind).values()):
        if "_described" in leaf.__dict__:
            continue
        hints = get_type_hints(leaf, include_extras=True)
        for group in map(_bare, hints.values()):
            if isinstance(group, type) and is_dataclass(group):
                describe(group)
        leaf.__annotations__ = {**leaf.__annotations__}
        for field in fields(leaf):
            hint = hints[field.name]
            if _config(hint) is not None or _subcommands(hint) or is_dataclass(_bare(hint)):
                continue
            word = _metavar(field, hint)
            words = tyro.conf.arg(metavar=word, help_behavior_hint=default_shown(field.default))
            leaf.__annotations__[field.name] = Annotated[hint, words]
        leaf._described = True


def _leaves(kind: type[Any]) -> Iterator[tuple[Field[Any], Any]]:
    """Yield the fields with their hints; those of a group without a prefix in its place."""
    hints = get_type_hints(kind, include_extras=True)
    for field in fields(kind):
        bare = _bare(hints[field.name])
        if is_dataclass(bare) and isinstance(bare, type):
            yield from _leaves(bare)
        else:
            yield field, hints[field.name]


def _subcommands(hint: Any) -> dict[str, type[Any]]:
    commands = {}
    for part in get_args(_bare(hint)) if get_origin(_bare(hint)) in (Union, UnionType) else ():
        if is_dataclass(_bare(part)):
            name = next((m.name for m in getattr(part, "__metadata__", ()) if getattr(m, "name", None)), None)
            commands[str(name or _bare(part).__name__.lower())] = _bare(part)
    return commands


def _option(field: Field[Any], hint: Any) -> Option:
    positional = POSITIONAL in getattr(hint, "__metadata__", ())
    bare, kind = _bare(hint), plain(hint)
    word = getattr(_config(hint), "name", None) or field.name
    flag = "" if positional else f"--{word.replace('_', '-')}"
    repeats = "UseAppendAction" in repr(hint)
    return Option(field.name, flag, choices(bare), bare is not bool, kind is Path, repeats)


def _bare(hint: Any) -> Any:
    """Give the type without its annotations."""
    while get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    return hint


def _parts(bare: Any) -> list[Any]:
    """Give what the elements of a container, or a value that may be absent, are made of."""
    if get_origin(bare) in (Union, UnionType):
        return [p for part in get_args(bare) if part is not NoneType for p in _parts(_bare(part))]
    if get_origin(bare) is tuple:
        return [p for part in get_args(bare) if part is not ... for p in _parts(_bare(part))]
    return [bare]


def choices(bare: Any) -> tuple[str, ...]:
    """Give the values that an option of a type may have; none where they are not few."""
    return tuple(str(c) for part in _parts(bare) if get_origin(part) is Literal for c in get_args(part))


def plain(hint: Any) -> type[Any] | None:
    """Give int, float, str or Path, where values are of one of these; None where tyro's own words are right."""
    kinds = set(_parts(_bare(hint)))
    kind = kinds.pop() if len(kinds) == 1 else None
    return kind if kind in WORDS else None


def _config(hint: Any) -> Any:
    return next((m for m in getattr(hint, "__metadata__", ()) if isinstance(m, type(tyro.conf.arg(name="x")))), None)


def _metavar(field: Field[Any], hint: Any) -> str | None:
    positional = POSITIONAL in getattr(hint, "__metadata__", ())
    return metavar(field.name, _bare(hint), positional, field.default)


def metavar(name: str, kind: Any, positional: bool, default: Any) -> str | None:
    """Give the words for the values of an option in help, such as NAME or {a,b}; None for a switch.

    Args:
        name: of the option.
        kind: type of its value.
        positional: whether it is a positional argument.
        default: MISSING where it is required.
    """
    basic = plain(kind)
    many = next((p for p in (kind, *get_args(kind)) if get_origin(p) is tuple), None)
    if few := choices(kind):
        word = f"{{{','.join(few)}}}"
    elif positional:
        word = name.upper().replace("_", "-")
        word = f"{word[:-3]}Y" if many and word.endswith("IES") else word[:-1] if many and word[-1] == "S" else word
    elif basic is None:
        return None  # a switch
    else:
        word = TEXTS.get(name, WORDS[basic]) if basic is str else WORDS[basic]
    if many is None:
        return f"[{word}]" if positional and default is not MISSING else word
    if ... not in get_args(many):
        return " ".join(word for _ in get_args(many))
    return f"[{word} ...]" if default is not MISSING and positional else f"{word} [{word} ...]"


def default_shown(value: Any) -> str:
    """Give what help says of a default, as people type it; nothing of one that means "none"."""
    if value is MISSING:
        return "(required)"
    if value is None or value is False or value == () or value == "":
        return ""
    parts = value if isinstance(value, tuple) else (value,)
    return f"(default: {' '.join(f'{v:g}' if isinstance(v, float) else str(v) for v in parts)})"
