"""Parse a command's arguments, and turn the parser's framed error messages into one line."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Sequence
from contextlib import redirect_stderr, redirect_stdout
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from vispeg.cli.help import MARK, Page, laid_out
from vispeg.cli.values import checked
from vispeg.core.errors import UserError

if TYPE_CHECKING:
    from vispeg.cli.command import Command

RULE, PLAIN_RULE = "─", "-"  # frame characters; the second is used by terminals that show only ASCII
FRAME = "│╭╮╰╯ " + RULE
POINTERS = ("For full helptext", "Argument helptext")
UNKNOWN = "Unrecognized options: "
MISSING = "Missing from "
NAMES = ("{task}", "{cell}", "{held}", "{tolerance}")  # placeholders in help texts for names of the built-in task
NOT_OF_KIND = (  # the parser's message for a failed conversion, and what is expected instead
    (r"Error parsing (\S+): .*invalid literal for int\(\) with base 10: '(.*?)'.*", "a whole number"),
    (r"Error parsing (\S+): .*could not convert string to float: '(.*?)'.*", "a number"),
    (r"Error parsing (\S+): .* from \[(.*?)\]\. Got errors: .*tuple\[float, float, float\].*", "three numbers"),
    (r"Error parsing (\S+): .*arguments: \[(.*?)\]", "numbers"),
)
CHOICE = r"invalid choice '(.*?)' for argument '(\S+)'\. Expected one of \((.*)\)"  # the parser's for a word of a list
ELSEWHERE = {  # option that does not exist -> where to find what it would set
    "--modality": "what a policy sees is in the name of its task, as in TASK-depth, and in its folder",
    "--obs-mode": "what a policy sees is in the name of its task, as in TASK-depth, and in its folder",
}


def parsed(name: str, argv: Sequence[str]) -> tuple[Command, Any]:
    """Return the named command or sub-command and its arguments; see `parse`."""
    from vispeg.cli.command import found
    from vispeg.cli.overview import COMMANDS, page

    command = found(COMMANDS[name])
    if isinstance(command, dict):
        if argv and argv[0] in command:
            name, command, argv = f"{name} {argv[0]}", command[argv[0]], argv[1:]
        elif argv and argv[0] in ("-h", "--help"):
            print(page(name, {below: each.help.partition("\n")[0] for below, each in command.items()}))
            raise SystemExit(0)
        else:
            got = argv[0] if argv else None
            raise UserError("unknown command" if got else "which one?", key=f"vispeg {name}", got=got, choices=command)
    return command, parse(command, f"vispeg {name}", argv)


def parse(command: Command, program: str, argv: Sequence[str]) -> Any:
    """Parse the arguments of a command into a dataclass, see `form`.

    Raises:
        UserError: an argument is unknown, missing, without a value or of another type.
        SystemExit: the help text was requested and has been printed.
    """
    import tyro

    from vispeg.cli.command import form

    taken = command.taken().items()
    wordy = {n for n, (_, option, kind) in taken if kind not in (bool, bool | None) and not option.bare}
    valued = {command.word(name) for name in wordy.difference(command.positional)}
    for word, after in pairwise([*argv, "--"]):
        if word in valued and after.startswith("--"):  # such as `--effects $hidden` without the variable
            raise UserError("has no value", key=word, expected="one; leave the option out for its default")
    argv = repeated(argv, {command.word(name) for name, (_, option, _) in taken if option.repeats})
    page, text = Page(), io.StringIO()
    flags = (tyro.conf.FlagCreatePairsOff,)
    try:
        with redirect_stdout(page), redirect_stderr(text):
            args = tyro.cli(form(command), prog=program, description=MARK, args=list(argv), config=flags)
    except SystemExit as stop:
        if not stop.code:
            print(laid_out(page.getvalue(), filled(command.help)))
            raise
        raise UserError(f"{one_line(text.getvalue())}; see {program} --help") from None
    return checked(args)


def repeated(argv: Sequence[str], flags: Collection[str]) -> list[str]:
    """Repeat a flag before each of its values, so that a pattern such as `rig-*` may expand to several values."""
    out, flag, taken = list[str](), "", 0  # taken: number of values of the flag so far
    for word in argv:
        if word.startswith("--"):
            flag, taken = word.partition("=")[0], int("=" in word)
        elif flag in flags:
            if taken:
                out.append(flag)
            taken += 1
        out.append(word)
    return out


def filled(text: str) -> str:
    """Replace the placeholders NAMES in a help text by the names of the built-in task."""
    if not any(key in text for key in NAMES):
        return text
    from vispeg.cli.tolerance import FLAG
    from vispeg.recordings.cell import OPEN_CELL
    from vispeg.task.registry import FIRST, scene_of, task

    for key, name in zip(NAMES, (task(FIRST).label, OPEN_CELL, scene_of({}).held, FLAG), strict=True):
        text = text.replace(key, name)
    return text


def one_line(framed: str) -> str:
    """Return the parser's framed message in one line, without frame, title and pointers to the help text."""
    parts: list[list[str]] = [[]]
    for line in framed.splitlines()[1:]:
        row = line.strip(FRAME)
        if row.strip(PLAIN_RULE):
            parts[-1].append(row)
        elif RULE in line or PLAIN_RULE in line:
            parts.append([])
    texts = [" ".join(" ".join(part).split()) for part in parts]
    sentences = [text.rstrip(".") for text in texts if text and not text.startswith(POINTERS)]
    if sentences and sentences[0].startswith(MISSING):
        return _missing(framed, sentences[1:])
    if sentences and sentences[0].startswith(UNKNOWN):
        return _unknown(sentences[0].removeprefix(UNKNOWN), " ".join(sentences[1:]))
    for pattern, expected in NOT_OF_KIND:
        if sentences and (match := re.fullmatch(pattern, sentences[0])):
            got = match[2].strip("'").replace("', '", " ")
            return str(UserError("is not understood", key=match[1], expected=expected, got=got))
    if sentences and (match := re.fullmatch(CHOICE, sentences[0])):
        choices = sorted({*re.findall(r"'(.*?)'", match[3])} - {"None"})  # no value is given by leaving it out
        return str(UserError("is not one of the choices", key=match[2], got=match[1], choices=choices))
    return "; ".join(sentences) or "bad arguments"


def _missing(framed: str, others: Sequence[str]) -> str:
    """Return a message on missing arguments, without the parser's lines of help on each."""
    edges = FRAME.replace(" ", "")
    lines = [line.strip(edges).rstrip() for line in framed.splitlines()[1:]]
    depth = [len(line) - len(line.lstrip()) for line in lines]
    start = next(i for i, line in enumerate(lines) if line.lstrip().startswith(MISSING))
    names, indent = list[str](), 0  # the names have the indentation of the first line below the title
    for line, deep in list(zip(lines, depth, strict=True))[start + 1 :]:
        if not line.strip(RULE + PLAIN_RULE + " "):
            break
        indent = indent or (deep if deep > depth[start] else 0)
        if deep == indent and deep:
            names.append(line.strip())
    several = f"{', '.join(names[:-1])} and {names[-1]} are" if len(names) > 1 else f"{names[0]} is"
    return "; ".join([f"{several} required", *(text for text in others if text.startswith(UNKNOWN))])


def _unknown(options: str, hints: str) -> str:
    """Return a message on unknown options with their nearest matches, without the parser's lines of help."""
    near = dict.fromkeys(re.findall(r"(?<!\S)--[a-z][a-z-]*(?!\S)", hints))
    name = options.partition(",")[0].strip()
    if name in ELSEWHERE:
        return f"{UNKNOWN}{options}; {ELSEWHERE[name]}"
    return f"{UNKNOWN}{options}" + (f" (did you mean {' or '.join(near)}?)" if near else "")
