"""One kind of error for everything a user can put right."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

MANY = 30  # choices beyond which only the nearest are listed
NEAREST = 5
FLAG = re.compile(r"(?<![\w-])--([a-z][a-z0-9-]*)")


class UserError(Exception):
    """Bad input, said in one line: where, what was expected, what came, the choices.

    Args:
        message: what is wrong.
        file: the file at fault, if there is one.
        key: the key, column or row at fault inside the file.
        expected: what would have been right.
        got: what came.
        choices: the legal values; the one nearest to `got` is suggested, and of very many only a few near ones listed.
        see: how to get at all the choices, such as a command.
        meant: the choice to suggest where spelling does not tell it.

    An option of a command is written `--hold-out`; from Python it is shown as the argument `hold_out`.
    """

    in_command: ClassVar[bool] = False  # whether a command line is what the user typed; `vispeg.cli.main` sets it

    def __init__(
        self,
        message: str,
        *,
        file: str | Path | None = None,
        key: str | None = None,
        expected: object = None,
        got: object = None,
        choices: Iterable[str] = (),
        see: str = "",
        meant: str = "",
    ):
        self.file, self.key, self.expected, self.got = file, key, expected, got
        self.choices = tuple(choices)
        where = ": ".join(str(part) for part in (file, key) if part is not None)
        text = f"{where}: {message}" if where else message
        if expected is not None:
            text += f"; expected {expected}"
        if got is not None:
            text += f"; got {_short(got)}"
        if self.choices:
            near = [meant] if meant else difflib.get_close_matches(str(got), self.choices, n=1)
            text += f" (did you mean '{near[0]}'?)" if near else ""
            text += f"; {_listed(str(got), self.choices)}"
            text += f"; {see}" if see else ""
        super().__init__(_printable(" ".join(text.split())))

    def __str__(self) -> str:
        text = str(self.args[0])
        return text if self.in_command else _as_arguments(text)


def _as_arguments(text: str) -> str:
    """Name options as the arguments that they are in Python; commands in backticks stay as they are typed."""
    parts = text.split("`")
    parts[::2] = [FLAG.sub(lambda m: m[1].replace("-", "_"), part) for part in parts[::2]]
    return "`".join(parts)


def _listed(got: str, choices: tuple[str, ...]) -> str:
    """Give the choices, or where they are very many those that are most like what came."""
    if len(choices) <= MANY:
        return f"choices: {', '.join(choices)}"
    near = difflib.get_close_matches(got, choices, n=NEAREST, cutoff=0.0)
    return f"nearest of {len(choices)} choices: {', '.join(near)}"


def _printable(text: str) -> str:
    """Give the text with an escape in place of what a terminal would obey or could not show."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _short(value: object, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
