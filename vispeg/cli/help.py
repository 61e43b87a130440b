"""Format the text of `--help`: the parser's text, with description and usage wrapped to the terminal's width."""

from __future__ import annotations

import inspect
import io
import re
import shutil
import sys
import textwrap
from itertools import groupby

MARK = "@description@"  # placeholder for the description, which the parser would not wrap
WIDEST = 100  # most columns of prose
STYLE = re.compile(r"\x1b\[\d*m")  # terminal codes, removed because they would count as columns


class Page(io.StringIO):
    """Collect what the parser prints, with the terminal properties of standard output."""

    def isatty(self) -> bool:
        """Return whether standard output is a terminal; then the parser uses colours."""
        return sys.__stdout__ is not None and sys.__stdout__.isatty()

    @property
    def encoding(self) -> str:  # pyright: ignore[reportIncompatibleVariableOverride]  # read alone
        """Encoding of standard output; the parser draws frames only in UTF-8."""
        return getattr(sys.__stdout__, "encoding", "ascii")


def laid_out(page: str, description: str) -> str:
    """Return the parser's text with the description in place of MARK, wrapped to the terminal except for examples."""
    columns = shutil.get_terminal_size().columns
    usage, mark, rest = page.partition(MARK)
    if not mark:
        return page
    parts = _filled(STYLE.sub("", usage), columns, 8), wrapped(description, min(columns, WIDEST))
    return "\n\n".join(parts) + "\n".join(line.rstrip() for line in rest.splitlines())


def wrapped(text: str, columns: int) -> str:
    """Wrap the paragraphs of a docstring; indented lines, such as commands, stay unchanged."""
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
