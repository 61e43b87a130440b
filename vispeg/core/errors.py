"""The error for everything that a user can correct."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import ClassVar

MANY = 30  # greatest number of choices that are all listed
NEAREST = 5  # number of choices that are listed if there are more than MANY
FLAG = re.compile(r"(?<![\w-])--([a-z][a-z0-9-]*)")


class UserError(Exception):
    """Bad input, reported in one line: place, problem, expected value, actual value, choices.

    Args:
        message: what is wrong.
        file: the file at fault, if there is one.
        key: the key, column or row at fault inside the file.
        expected: what would be valid.
        got: the actual value.
        choices: the legal values. The one most similar to `got` is suggested; of more than `MANY` a few are listed.
        see: how to list all choices, such as a command.
        meant: the choice to suggest if its spelling is not similar to `got`.

    Write an option of a command as `--hold-out`; to users of Python it is shown as the argument `hold_out`.
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
    """Replace options by the names of Python's arguments (`--hold-out` by `hold_out`), except inside backticks."""
    parts = text.split("`")
    parts[::2] = [FLAG.sub(lambda m: m[1].replace("-", "_"), part) for part in parts[::2]]
    return "`".join(parts)


def _listed(got: str, choices: tuple[str, ...]) -> str:
    """Return the choices as text or, if there are more than `MANY`, those most similar to `got`."""
    if len(choices) <= MANY:
        return f"choices: {', '.join(choices)}"
    near = difflib.get_close_matches(got, choices, n=NEAREST, cutoff=0.0)
    return f"nearest of {len(choices)} choices: {', '.join(near)}"


def _printable(text: str) -> str:
    """Return the text with escape sequences in place of control and other unprintable characters."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def _short(value: object, limit: int = 80) -> str:
    text = repr(value)
    return text if len(text) <= limit else text[: limit - 3] + "..."
