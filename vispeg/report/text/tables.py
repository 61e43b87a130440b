"""Tables for a terminal of any width, in which numbers, names and intervals are never wrapped.

A table that is too wide is printed in its narrow form if it has one, else as a list, one block per row; a cell that is
too wide for that takes several lines.
A pipe or a file has 80 columns unless COLUMNS says otherwise, so that redirected output looks like that on a screen.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType

PIPED = 80  # columns of a pipe or file
GAP = 2  # columns between cells
PROSE = 24  # fewest columns for a sentence


@dataclass(frozen=True)
class Column:
    """A column: its heading, and whether it holds numbers (right-aligned) or prose (which may wrap)."""

    head: str
    right: bool = False
    prose: bool = False


@dataclass(frozen=True)
class Sheet:
    """A table of text, which rich can print.

    Attributes:
        columns: the columns.
        rows: rows of one cell per column; markup in cells is not interpreted.
        keys: number of leading cells that form a row's title if the table is printed as a list.
        narrow: the same content in fewer columns, for a terminal that is too narrow for these.
    """

    columns: Sequence[Column]
    rows: Sequence[Sequence[str]]
    keys: int = 1
    narrow: Sheet | None = None

    def width(self) -> int:
        """Return the least width of the table in terminal columns."""
        return sum(self._widths()) + GAP * (len(self.columns) - 1)

    def _widths(self) -> list[int]:
        """Return the least width of each column in terminal columns; of prose at most PROSE."""
        from rich.cells import cell_len

        widths = []
        for i, column in enumerate(self.columns):
            cells = [column.head, *(row[i] for row in self.rows)]
            widest = max(cell_len(line) for cell in cells for line in cell.split("\n"))
            widths.append(min(widest, PROSE) if column.prose else widest)
        return widths

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[RenderableType]:
        fitting = (s for s in (self, self.narrow) if s is not None and s.width() <= options.max_width)
        sheet = next(fitting, None)
        yield self._list(options.max_width) if sheet is None else sheet._table()

    def _table(self) -> Any:
        from rich import box
        from rich.table import Table
        from rich.text import Text

        padding = (0, GAP - 1, 0, 0)  # the box adds one blank between columns
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=padding, header_style="bold", show_edge=False)
        for column, width in zip(self.columns, self._widths(), strict=True):
            side: Any = "right" if column.right else "left"
            table.add_column(column.head, justify=side, no_wrap=not column.prose, overflow="fold", min_width=width)
        for row in self.rows:
            table.add_row(*map(Text, row))
        return table

    def _list(self, width: int) -> Any:
        """Return the table as blocks of `heading  cell` lines, without empty cells."""
        from rich.text import Text

        text = Text()
        indent = 2 + GAP + max((len(" ".join(c.head.split())) for c in self.columns[self.keys :]), default=0)
        for row in self.rows:
            text.append(" ".join(cell for cell in row[: self.keys] if cell) + "\n", style="bold")
            for column, cell in zip(self.columns[self.keys :], row[self.keys :], strict=True):
                if cell:
                    lines = [part for line in cell.split("\n") for part in wrapped(line, width - indent)]
                    text.append(f"  {' '.join(column.head.split())}".ljust(indent), style="dim")
                    text.append(f"\n{' ' * indent}".join(lines) + "\n")
        text.right_crop(1)
        text.no_wrap, text.overflow = True, "ignore"
        return text


def terminal() -> Console:
    """Return a rich console for the standard output, 80 columns wide if that is a pipe or a file."""
    from rich.console import Console

    if sys.stdout.isatty() or os.environ.get("COLUMNS", "").isdigit():
        return Console(highlight=False)
    return Console(highlight=False, width=PIPED)


def wrapped(text: str, width: int) -> list[str]:
    """Wrap text into lines of at most `width` columns, at least PROSE, without breaking words."""
    import textwrap

    return textwrap.wrap(text, max(width, PROSE), break_long_words=False, break_on_hyphens=False) or [""]
