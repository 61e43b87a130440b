"""What every function of the public face gives back: it shows itself and saves itself."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

from vispeg.core.files import new_folder
from vispeg.report.text.summary import Block, html, print_summary
from vispeg.report.text.tables import PIPED


class Result(ABC):
    """A result with a summary; a notebook shows it as tables, `print` as text.

    Attributes:
        holds: the kind of folder that `save` writes, see `vispeg.core.marker`.
        sources: files and folders that were read; `save` replaces none of them.
    """

    holds: ClassVar[str]
    sources: Sequence[str | Path] = ()

    @property
    @abstractmethod
    def summary(self) -> list[Block]:
        """Lines and tables for a reader."""

    @abstractmethod
    def _write(self, folder: Path) -> None:
        """Writes everything into an empty folder."""

    def save(self, out: str | Path, *, overwrite: bool = False) -> Path:
        """Writes the folder that the command of the same name writes; returns its path.

        Raises:
            UserError: `out` holds something else, or the same while `overwrite` is False, or cannot be written.
        """
        with new_folder(out, overwrite=overwrite, holds=self.holds, inputs=self.sources) as folder:
            self._write(folder)
        return Path(out)

    def _repr_html_(self) -> str:
        return html(self.summary)

    def __str__(self) -> str:
        from rich.console import Console

        console = Console(highlight=False, width=PIPED, no_color=True)
        with console.capture() as text:
            print_summary(self.summary, console)
        return text.get().rstrip("\n")
