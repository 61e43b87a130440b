"""A result in a few lines and tables, for a terminal and a notebook alike."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from vispeg.report.page import templates
from vispeg.report.text.tables import Sheet, terminal

if TYPE_CHECKING:
    from rich.console import Console


@dataclass(frozen=True)
class Line:
    """A line of text, after a bold `head`; with `path` it is not wrapped, and a `warning` gets an exclamation mark."""

    text: str
    head: str = ""
    path: bool = False
    warning: bool = False


Block = Line | Sheet


class Summarised(ABC):
    """A result that a notebook shows as its summary."""

    @property
    @abstractmethod
    def summary(self) -> list[Block]:
        """Lines and tables for a reader."""

    def _repr_html_(self) -> str:
        return html(self.summary)


def print_summary(blocks: Iterable[Block], console: Console | None = None) -> None:
    """Print lines and tables to a console, by default the standard output."""
    from rich.text import Text

    console = console or terminal()
    for block in blocks:
        if isinstance(block, Line):
            head = f"{block.head}: " if block.head else ""
            text = Text("  ! ", style="yellow") if block.warning else Text()
            text.append(head, style="bold").append(block.text, style="none")
            console.print(text, soft_wrap=block.path or block.warning)
        else:
            console.print(block, crop=False)  # a word wider than the terminal runs over its edge, and is not cut off


def html(blocks: Sequence[Block]) -> str:
    """Return lines and tables as HTML for a notebook, in the notebook's style."""
    parts = [{"line": b} if isinstance(b, Line) else {"sheet": b} for b in blocks]
    return templates().get_template("notebook.html.j2").render(parts=parts)
