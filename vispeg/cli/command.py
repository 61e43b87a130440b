"""A command: the function of `vispeg.api` that it calls, whose parameters are its options, and how it shows the result.

    @command("vispeg.api.policies:tune", "policy", out=Option(default=REQUIRED), settings=None)
    def tune(call: Call, films: int = 0) -> None:
        \"\"\"Tune a policy.

        What `vispeg tune --help` prints.

        Args:
            films: episodes to film.
        \"\"\"
        call.give(call(say=call.output.line))

`vispeg tune POLICY --out OUT` then has the options of `vispeg.api.policies.tune`, with the defaults and the words of
its signature and docstring, and those of the command's own parameters (`--films`). What the command line cannot say,
such as a callback, is no option.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, make_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Union, get_args, get_origin

from vispeg.cli.declared import Parameter, parameters
from vispeg.cli.options import NAMED, choices, default_shown, metavar
from vispeg.cli.output import Output, OutputOptions
from vispeg.cli.overview import COMMANDS, doc
from vispeg.cli.tolerance import FLAG

if TYPE_CHECKING:
    from vispeg.report.text.summary import Block

REQUIRED: Any = MISSING
SAME: Any = object()
NAMED_IN = re.compile(r"`(\w+)`")  # a parameter in a docstring
ARGS = re.compile(r"\n\s*Args:\n.*\Z", re.DOTALL)


@dataclass(frozen=True)
class Option:
    """How an option differs from the parameter that it is.

    Attributes:
        name: of the option, where it is another than the parameter's.
        default: REQUIRED, or another one than in Python.
        repeats: whether the option stands before each of its values.
        group: heading of the option in help.
    """

    name: str = ""
    default: Any = SAME
    repeats: bool = False
    group: str = ""


TOLERANCE = Option(FLAG.removeprefix("--"))  # what a task calls it


@dataclass(frozen=True, eq=False)
class Command:
    """A command, see `command`.

    Attributes:
        place: MODULE:FUNCTION of the command itself.
        functions: of what it calls; the parameters of all are its options.
        positional: the parameters that are positional arguments, in order.
        special: parameter -> its option, where it differs; None where there is none.
    """

    place: str
    functions: Sequence[str]
    positional: Sequence[str]
    special: Mapping[str, Option | None]

    @property
    def name(self) -> str:
        """Name of the function."""
        return self.place.partition(":")[2]

    @property
    def help(self) -> str:
        """What is printed above the options."""
        return ARGS.sub("", doc(self.place))

    def taken(self) -> dict[str, tuple[Parameter, Option, Any]]:
        """Give parameter -> itself, its option, and the type of the values, of all that are options."""
        own = {k: v for k, v in parameters(self.place).items() if k != "call"}
        called: dict[str, Parameter] = {}
        for place in self.functions:
            called = {**called, **{k: v for k, v in parameters(place).items() if k not in called}}
        assert not own.keys() & called.keys(), f"{self.place} declares again {own.keys() & called.keys()}"
        found = {}
        for name, parameter in {**called, **own}.items():
            option = self.special.get(name, Option())
            kind = typed(parameter.hint, option.name or name) if option is not None else None
            if option is not None and kind is not None:
                found[name] = parameter, option, kind | None if option.default is None else kind
        first = [*self.positional, *(name for name, what in found.items() if _default(*what) is REQUIRED)]
        return {name: found[name] for name in dict.fromkeys([*first, *found])}

    def word(self, name: str) -> str:
        """Return a parameter as written on the command line: --name, or NAME if it is positional."""
        word = (self.special.get(name) or Option()).name or name
        return word.upper() if name in self.positional else f"--{word.replace('_', '-')}"

    def run(self, args: Any) -> int:
        """Run it with what `form` has read."""
        values, taken = dict(_flat(args)), self.taken()
        given = {name: values[_field(name, option)] for name, (_, option, _) in taken.items()}
        changed = [self.word(name) for name, what in taken.items() if given[name] != _default(*what)]
        for name, (parameter, _, _) in taken.items():
            if (number := _pairs(parameter.hint)) is not None:
                given[name] = paired(given[name], self.word(name), number)
        own = {k: v for k, v in given.items() if k in parameters(self.place)}
        module, _, function = self.place.partition(":")
        call = Call(self.functions, {k: v for k, v in given.items() if k not in own}, values["output"], changed)
        return int(getattr(importlib.import_module(module), function)(call, **own) or 0)


class Call:
    """The function of a command, with the arguments that were typed.

    Attributes:
        given: parameter of the function -> value; also attributes.
        output: how results and progress are shown.
        changed: the arguments that are not the default, as they stand on the command line.
    """

    def __init__(self, functions: Sequence[str], given: Mapping[str, Any], output: Output, changed: Sequence[str]):
        self._functions, self.given, self.output, self.changed = functions, given, output, changed

    def __call__(self, **more: Any) -> Any:
        """Call it, with more or other arguments than were typed."""
        place = self._functions[0]
        module, _, function = place.partition(":")
        return getattr(importlib.import_module(module), function)(**{**self.given_to(place), **more})

    def given_to(self, place: str) -> dict[str, Any]:
        """Give the arguments that were typed for one of several functions, MODULE:FUNCTION."""
        return {key: value for key, value in self.given.items() if key in parameters(place)}

    def __getattr__(self, name: str) -> Any:
        try:
            return self.given[name]
        except KeyError:
            raise AttributeError(name) from None

    def saved(self, out: Path, overwrite: bool, holds: str, inputs: Iterable[Any] = (), **more: Any) -> Any:
        """Call it and save the result in a folder, which is refused or reserved before anything is worked out."""
        from vispeg.core.files import reserved

        with reserved(out, overwrite, holds=holds, inputs=tuple(inputs)):
            result = self(**more)
            result.save(out, overwrite=overwrite)
        return result

    def give(self, result: Any, *lines: str | Block) -> None:
        """Print a result with a record and a summary, and more lines."""
        self.output.give(result.record, [*result.summary, *lines])


def command(
    function: str = "", /, *positional: str, also: Any = (), **special: Option | None
) -> Callable[[Callable[..., Any]], Any]:
    """Make a command of the function that shows its result, whose own parameters are options too.

    Args:
        function: MODULE:FUNCTION of `vispeg.api`, whose parameters are its options.
        positional: the parameters that are positional arguments.
        also: MODULE:NAME of other functions or dataclasses whose parameters are options.
        special: parameters whose option is another one, or None for those that are none.
    """

    functions = [*filter(None, [function]), *also]

    def made(show: Callable[..., Any]) -> Callable[..., Any]:
        show.command = Command(f"{show.__module__}:{show.__name__}", functions, positional, special)  # type: ignore[attr-defined]  # kept on the function
        return show

    return made


def under(group: str, *names: str) -> dict[str, Option]:
    """Give options that stand under a heading of their own in help."""
    return dict.fromkeys(names, Option(group=group))


def found(place: str) -> Command | dict[str, Command]:
    """Give the command at MODULE:FUNCTION; of a module, its commands by name, which are sub-commands."""
    module, _, name = place.partition(":")
    there = vars(importlib.import_module(module))
    if name:
        return there[name].command
    return {key: value.command for key, value in there.items() if hasattr(value, "command")}


def leaves() -> dict[str, Command]:
    """Give every command that the parser reads, `camera show` where it has sub-commands."""
    out = {}
    for name, place in COMMANDS.items():
        if name != "doctor":
            here = found(place)
            out |= {f"{name} {sub}": each for sub, each in here.items()} if isinstance(here, dict) else {name: here}
    return out


@cache
def form(command: Command) -> type[Any]:
    """Give a dataclass whose fields are what the parser reads."""
    import tyro

    groups: dict[str, list[Any]] = {"": []}
    taken = command.taken()
    for name, (parameter, option, kind) in taken.items():
        positional = name in command.positional
        default = _default(parameter, option, kind)
        hint: Any = kind
        if positional:
            hint = tyro.conf.Positional[hint]
        elif option.repeats:
            hint = tyro.conf.UseAppendAction[hint]
        key = _field(name, option)
        about = NAMED_IN.sub(lambda m: command.word(m[1]) if m[1] in taken else m[0], parameter.help)
        if re.split("[^a-z0-9-]", about)[0] not in choices(kind):  # `auto: ...` stays
            about = about[:1].upper() + about[1:]
        word = metavar(key, kind, positional, default)
        words = tyro.conf.arg(help=about, metavar=word, help_behavior_hint=default_shown(default))
        row = key, Annotated[hint, words], field(default=default)
        groups.setdefault(option.group, []).append(row)
    rows = groups.pop("")
    for title, members in groups.items():
        made = make_dataclass(title.capitalize(), members, frozen=True, kw_only=True)
        heading = Annotated[made, tyro.conf.arg(name=title), tyro.conf.OmitArgPrefixes]
        rows.append((f"{title}_options", heading, field(default=made())))
    rows.append(("output", OutputOptions, field(default=Output())))
    return make_dataclass(command.name, rows, frozen=True, kw_only=True)


def typed(hint: Any, name: str) -> Any:
    """Give the type of an option's values, from that of a parameter; None where the command line cannot give one.

    A sequence is a tuple, pairs are texts NAME=VALUE; of text and path it is a path, except for what has names.
    """
    parts = [*_members(hint)]
    if _pairs(hint) is not None:
        return tuple[str, ...] | None if NoneType in parts else tuple[str, ...]
    several = any(get_origin(part) is Sequence for part in parts)
    inner = [p for part in parts for p in (_members(get_args(part)[0]) if get_origin(part) is Sequence else (part,))]
    kinds = [p for p in dict.fromkeys(inner) if p in (bool, int, float, str, Path) or get_origin(p) in (Literal, tuple)]
    if {str, Path} <= {*kinds}:
        kinds.remove(Path if name in NAMED else str)
    if not kinds:
        return None
    kind = kinds[0]
    kind = tuple[kind, ...] if several else kind
    return kind | None if NoneType in parts else kind


def paired(texts: Iterable[str] | None, key: str, number: bool) -> dict[str, Any] | None:
    """Give a dictionary of `NAME=VALUE` texts. Raises UserError for others, and for a name given twice."""
    from vispeg.core.errors import UserError

    out: dict[str, Any] = {}
    for text in texts or ():
        name, equals, value = text.partition("=")
        if not equals or not name or name in out:
            expected = "NAME=NUMBER" if number else "NAME=TEXT"
            raise UserError("given twice" if name in out else "not a pair", key=key, expected=expected, got=text)
        try:
            out[name] = float(value) if number else value
        except ValueError:
            raise UserError("not a number", key=f"{key} {name}", expected="a number", got=value) from None
    return out or None


def _pairs(hint: Any) -> bool | None:
    """Whether a mapping of names has numbers for values; None for what is no mapping of names to text or numbers."""
    for part in _members(hint):
        if get_origin(part) is Mapping and get_args(part)[1] in (str, float):
            return get_args(part)[1] is float
    return None


def _members(hint: Any) -> Iterable[Any]:
    """Yield the types that a union is of."""
    if get_origin(hint) in (Union, UnionType):
        for part in get_args(hint):
            yield from _members(part)
    else:
        yield hint


def _default(parameter: Parameter, option: Option, kind: Any) -> Any:
    default: Any = parameter.default if option.default is SAME else option.default
    is_path = kind is Path or Path in get_args(kind)
    return Path(default) if is_path and isinstance(default, str) else default


def _field(name: str, option: Option) -> str:
    return (option.name or name).replace("-", "_")


def _flat(args: Any) -> Iterable[tuple[str, Any]]:
    """Yield the fields of a form, those of its groups in their place."""
    for each in fields(args):
        value = getattr(args, each.name)
        if is_dataclass(value) and each.name != "output":
            yield from _flat(value)
        else:
            yield each.name, value
