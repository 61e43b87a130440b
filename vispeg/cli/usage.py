"""The argument parser's complaints, as the one line that every other mistake gets."""

from __future__ import annotations

import io
from collections.abc import Sequence
from contextlib import redirect_stderr
from typing import Any

from vispeg.core.errors import UserError

RULE = "─"
FRAME = "│╭╮╰╯ " + RULE
POINTERS = ("For full helptext", "Argument helptext")


def parse(kind: type[Any], program: str, description: str | None, argv: Sequence[str]) -> Any:
    """The arguments of a command, an instance of the dataclass `kind`.

    Raises:
        UserError: an argument is unknown, missing or of another kind; the parser's framed text becomes its message.
        SystemExit: `--help` was asked for and has been printed.
    """
    import tyro

    text = io.StringIO()
    flags = (tyro.conf.FlagCreatePairsOff,)
    try:
        with redirect_stderr(text):
            return tyro.cli(kind, prog=program, description=description, args=list(argv), config=flags)
    except SystemExit as stop:
        if not stop.code:
            raise
        raise UserError(f"{one_line(text.getvalue())}; see {program} --help") from None


def one_line(framed: str) -> str:
    """The message in a box of the parser's, without its frame, its title and what only points to the help."""
    parts: list[list[str]] = [[]]
    for line in framed.splitlines()[1:]:
        row = line.strip(FRAME)
        if row:
            parts[-1].append(row)
        elif RULE in line:
            parts.append([])
    said = [" ".join(" ".join(part).split()) for part in parts]
    return "; ".join(text.rstrip(".") for text in said if text and not text.startswith(POINTERS)) or "bad arguments"
