"""What `--help` prints: the parser's text, in which description and usage are wrapped at the terminal's width."""

from __future__ import annotations

import inspect
import io
import re
import shutil
import sys
import textwrap
from itertools import groupby

MARK = "@description@"  # what the parser gets as the description, whose lines it would not break
WIDEST = 100  # columns of prose
STYLE = re.compile(r"\x1b\[\d*m")  # a terminal's codes, which would count as columns


class Page(io.StringIO):
    """Takes what the parser prints; the parser asks it what standard output can show."""

    def isatty(self) -> bool:
        """Whether standard output is a terminal, where the parser uses colours."""
        return sys.__stdout__ is not None and sys.__stdout__.isatty()

    @property
    def encoding(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]  # read alone
        """Encoding of standard output; the parser draws frames only in UTF-8."""
        return getattr(sys.__stdout__, "encoding", "ascii")


def laid_out(page: str, description: str) -> str:
    """Give the parser's text with the description in place of the mark; only examples are wider than the terminal."""
    columns = shutil.get_terminal_size().columns
    usage, mark, rest = page.partition(MARK)
    if not mark:
        return page
    parts = _filled(STYLE.sub("", usage), columns, 8), wrapped(description, min(columns, WIDEST))
    return "\n\n".join(parts) + "\n".join(line.rstrip() for line in rest.splitlines())


def wrapped(text: str, columns: int) -> str:
    """Give a docstring whose paragraphs are wrapped; indented lines, such as commands, stay as they are."""
    lines = inspect.cleandoc(text).splitlines()
    groups = groupby(lines, lambda line: bool(line) and line[0] != " ")
    return "\n".join(_filled(" ".join(block), columns) if prose else "\n".join(block) for prose, block in groups)


def _filled(text: str, columns: int, indent: int = 0) -> str:
    return textwrap.fill(
        " ".join(text.split()),
        columns,
        subsequent_indent=" " * indent,
        break_long_words=False,
        break_on_hyphens=False,
    )
