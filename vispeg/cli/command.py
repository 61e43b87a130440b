"""Make commands from functions of `vispeg.api`: the parameters of the function are the options of the command.

    @command("vispeg.api.policies:tune", "policy", out=Option(default=REQUIRED), settings=None)
    def tune(call: Call, films: int = 0) -> None:
        \"\"\"Tune a policy.

        What `vispeg tune --help` prints.

        Args:
            films: episodes to film.
        \"\"\"
        call.give(call(say=call.output.line))

`vispeg tune POLICY --out OUT` then has the options of `vispeg.api.policies.tune`, with the defaults and the words of
its signature and docstring, and those of the command's own parameters (`--films`). A parameter that the command line
cannot express, such as a callback, gets no option.
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
SEVERAL = (Sequence, list)  # types of a parameter that takes several values
SAME: Any = object()  # the default of the parameter
NAMED_IN = re.compile(r"`(\w+)`")  # a parameter in a docstring
ARGS = re.compile(r"\n\s*Args:\n.*\Z", re.DOTALL)


@dataclass(frozen=True)
class Option:
    """Differences between an option and the parameter that it sets.

    Attributes:
        name: name of the option; "" for that of the parameter.
        default: REQUIRED, or another default than in Python.
        repeats: whether the option is repeated for each of its values.
        group: heading above the option in the help text.
        bare: whether the option may stand without a value, which means none of the default's.
    """

    name: str = ""
    default: Any = SAME
    repeats: bool = False
    group: str = ""
    bare: bool = False


TOLERANCE = Option(FLAG.removeprefix("--"))  # the tolerance has a name of its own on the command line


@dataclass(frozen=True, eq=False)
class Command:
    """A command, see `command`.

    Attributes:
        place: MODULE:FUNCTION of the function that shows the result.
        functions: MODULE:NAME of the functions and dataclasses whose parameters are its options; the first is called.
        positional: names of the parameters that are positional arguments, in order.
        special: parameter -> its option if that differs from the default, or None for no option.
    """

    place: str
    functions: Sequence[str]
    positional: Sequence[str]
    special: Mapping[str, Option | None]

    @property
    def name(self) -> str:
        """Name of the function that shows the result."""
        return self.place.partition(":")[2]

    @property
    def help(self) -> str:
        """The help text above the options."""
        return ARGS.sub("", doc(self.place))

    def taken(self) -> dict[str, tuple[Parameter, Option, Any]]:
        """Return name -> (parameter, option, type of the value) for all parameters that are options."""
        own = {k: v for k, v in parameters(self.place).items() if k != "call"}
        called: dict[str, Parameter] = {}
        for place in self.functions:
            for key, parameter in parameters(place).items():
                called.setdefault(key, parameter)
        assert not own.keys() & called.keys(), f"{self.place} declares again {own.keys() & called.keys()}"
        found = {}
        for name, parameter in {**called, **own}.items():
            option = self.special.get(name, Option())
            kind = typed(parameter.hint, option.name or name) if option is not None else None
            if option is not None and kind is not None:
                found[name] = parameter, option, kind | None if option.default is None else kind
        lost = [name for name in self.positional if name not in found]
        assert not lost, f"{self.place}: no argument can have the type of {lost}, see `vispeg.cli.command.typed`"
        first = [*self.positional, *(name for name, what in found.items() if _default(*what) is REQUIRED)]
        return {name: found[name] for name in dict.fromkeys([*first, *found])}

    def word(self, name: str) -> str:
        """Return a parameter as written on the command line: --name, or NAME if positional."""
        word = (self.special.get(name) or Option()).name or name
        return word.upper() if name in self.positional else f"--{word.replace('_', '-')}"

    def run(self, args: Any) -> int:
        """Run the command with the arguments read by `form`; return the exit code."""
        from vispeg.core.errors import UserError

        values, taken = dict(_flat(args)), self.taken()
        given = {name: values[_field(name, option)] for name, (_, option, _) in taken.items()}
        changed = [self.word(name) for name, what in taken.items() if given[name] != _default(*what)]
        for name, (parameter, _, _) in taken.items():
            if (number := _pairs(parameter.hint)) is not None:
                given[name] = paired(given[name], self.word(name), number)
            if name in self.positional and given[name] == () and _default(*taken[name]) is REQUIRED:
                raise UserError("nothing given", key=self.word(name), expected="at least one")
        own = {k: v for k, v in given.items() if k in parameters(self.place)}
        module, _, function = self.place.partition(":")
        call = Call(self.functions, {k: v for k, v in given.items() if k not in own}, values["output"], changed)
        return int(getattr(importlib.import_module(module), function)(call, **own) or 0)


class Call:
    """The function of a command, with the arguments from the command line.

    Attributes:
        given: parameter of the function -> value; each is also an attribute of this object.
        output: the form in which results and progress are shown.
        changed: the arguments that differ from their default, as written on the command line.
    """

    def __init__(self, functions: Sequence[str], given: Mapping[str, Any], output: Output, changed: Sequence[str]):
        self._functions, self.given, self.output, self.changed = functions, given, output, changed

    def __call__(self, **more: Any) -> Any:
        """Call the function; `more` adds or replaces arguments."""
        place = self._functions[0]
        module, _, function = place.partition(":")
        return getattr(importlib.import_module(module), function)(**{**self.given_to(place), **more})

    def given_to(self, place: str) -> dict[str, Any]:
        """Return the arguments from the command line for one of several functions, MODULE:FUNCTION."""
        return {key: value for key, value in self.given.items() if key in parameters(place)}

    def __getattr__(self, name: str) -> Any:
        try:
            return self.given[name]
        except KeyError:
            raise AttributeError(name) from None

    def saved(self, out: Path, overwrite: bool, holds: str, inputs: Iterable[Any] = (), **more: Any) -> Any:
        """Check and reserve the folder `out`, call the function, and save the result there."""
        from vispeg.core.files import reserved

        with reserved(out, overwrite, holds=holds, inputs=tuple(inputs)):
            result = self(**more)
            result.save(out, overwrite=overwrite)
        return result

    def give(self, result: Any, *lines: str | Block) -> None:
        """Print a result's record (JSON) or its summary and further lines (text)."""
        self.output.give(result.record, [*result.summary, *lines])


def command(
    function: str = "", /, *positional: str, also: Any = (), **special: Option | None
) -> Callable[[Callable[..., Any]], Any]:
    """Make a command from the decorated function, which shows the result; its own parameters are options too.

    Args:
        function: MODULE:FUNCTION that the command calls, whose parameters are options; "" if it calls none.
        positional: names of the parameters that are positional arguments, in order.
        also: MODULE:NAME of other functions or dataclasses whose parameters are options.
        special: parameter -> its option if that differs from the default, or None for no option.
    """

    functions = [*filter(None, [function]), *also]

    def made(show: Callable[..., Any]) -> Callable[..., Any]:
        show.command = Command(f"{show.__module__}:{show.__name__}", functions, positional, special)  # type: ignore[attr-defined]  # kept on the function
        return show

    return made


def under(group: str, *names: str) -> dict[str, Option]:
    """Return options for these parameters, under a common heading in the help text."""
    return dict.fromkeys(names, Option(group=group))


def found(place: str) -> Command | dict[str, Command]:
    """Return the command at MODULE:FUNCTION; for MODULE, its sub-commands by name."""
    module, _, name = place.partition(":")
    names = vars(importlib.import_module(module))
    if name:
        return names[name].command
    return {key: value.command for key, value in names.items() if hasattr(value, "command")}


def leaves() -> dict[str, Command]:
    """Return all commands by name; a sub-command's name has two words, as in `camera show`."""
    out = {}
    for name, place in COMMANDS.items():
        if name != "doctor":  # it has a parser of its own, since it must work where tyro is missing
            one = found(place)
            out |= {f"{name} {sub}": each for sub, each in one.items()} if isinstance(one, dict) else {name: one}
    return out


@cache
def form(command: Command) -> type[Any]:
    """Return a dataclass from whose fields tyro makes the parser of a command."""
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
        if re.split("[^a-z0-9-]", about)[0] not in choices(kind):  # a value such as `auto: ...` keeps its case
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
    """Return the type of an option's value from a parameter's type; None if the command line cannot express it.

    A sequence or list becomes a tuple, a mapping a tuple of texts NAME=VALUE. Text or path becomes a path, except for
    options that take names of bundled things (`NAMED`). Of other unions the first type counts.
    """
    parts = [*_members(hint)]
    if _pairs(hint) is not None:
        return tuple[str, ...] | None if NoneType in parts else tuple[str, ...]
    several = any(get_origin(part) in SEVERAL for part in parts)
    inner = []  # the types of a single value
    for part in parts:
        inner += _members(get_args(part)[0]) if get_origin(part) in SEVERAL else [part]
    kinds = [p for p in dict.fromkeys(inner) if p in (bool, int, float, str, Path) or get_origin(p) in (Literal, tuple)]
    if {str, Path} <= {*kinds}:
        kinds.remove(Path if name in NAMED else str)
    if not kinds:
        return None
    kind = kinds[0]
    kind = tuple[kind, ...] if several else kind
    return kind | None if NoneType in parts else kind


def paired(texts: Iterable[str] | None, key: str, number: bool) -> dict[str, Any] | None:
    """Parse texts `NAME=VALUE` into a dictionary; None if empty.

    Raises:
        UserError: a text of another form, a name given twice, or, if `number`, a value that is no number.
    """
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
    """Return whether the values of a mapping type are numbers; None if it is no mapping to text or numbers."""
    for part in _members(hint):
        if get_origin(part) is Mapping and get_args(part)[1] in (str, float):
            return get_args(part)[1] is float
    return None


def _members(hint: Any) -> Iterable[Any]:
    """Yield the members of a union type, or the type itself."""
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
    """Yield (name, value) of the fields of a form, including those in its groups."""
    for each in fields(args):
        value = getattr(args, each.name)
        if is_dataclass(value) and each.name != "output":
            yield from _flat(value)
        else:
            yield each.name, value
