"""A result in a few lines and tables: printed on a terminal, and shown by a notebook, in the same words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vispeg.report.page import templates
from vispeg.report.text.tables import Sheet, terminal

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Line:
    """A sentence; `head` stands before it in bold, and with `path` it is not broken over two lines.

    A `warning` is set in, behind a coloured exclamation mark.
    """

    text: str
    head: str = ""
    path: bool = False
    warning: bool = False


Block = Line | Sheet


def print_summary(blocks: Iterable[Block], console: Console | None = None) -> None:
    """Print lines and tables to a console, or to the standard output."""
    from rich.text import Text

    console = console or terminal()
    for block in blocks:
        if isinstance(block, Line):
            head = f"{block.head}: " if block.head else ""
            text = Text("  ! ", style="yellow") if block.warning else Text()
            text.append(head, style="bold").append(block.text, style="none")
            console.print(text, soft_wrap=block.path or block.warning)
        else:
            console.print(block)


def html(blocks: Sequence[Block]) -> str:
    """Give the same as HTML for a notebook: no style sheet of its own, the notebook's colours."""
    parts = [{"line": b} if isinstance(b, Line) else {"sheet": b} for b in blocks]
    return templates().get_template("notebook.html.j2").render(parts=parts)
