"""The base class of stress test results, which have their own page."""

from __future__ import annotations

import json
from abc import abstractmethod
from pathlib import Path

from vispeg.api.playing import Played
from vispeg.core.files import write_text_atomic


class Stressed(Played):
    """A result of a stress test; see `Played`."""

    @property
    def page(self) -> str:
        """The file name of the page."""
        return f"{self.command}.html"

    @abstractmethod
    def _render(self) -> str:
        """Return the page as HTML."""

    def _write(self, folder: Path) -> None:
        text = json.dumps(self.record, indent=1, allow_nan=False) + "\n"
        write_text_atomic(folder / f"{self.command}.json", text, overwrite=True)
        write_text_atomic(folder / self.page, self._render(), overwrite=True)
