"""What every page of the app is given, and what it offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import viser


@dataclass(frozen=True)
class Place:
    """Where a page stands.

    Attributes:
        server: of the toolkit; its state is every window's.
        out: folder of results.
        threads: of simulations.
    """

    server: viser.ViserServer
    out: Path
    threads: int

    @property
    def gui(self) -> Any:
        """The elements of the panels."""
        return self.server.gui


class Page(ABC):
    """One of the app's pages: controls in the panel on the right, pictures in one on the left, a drawing between.

    Attributes:
        title: of its button.
    """

    title: str

    @abstractmethod
    def show(self, visible: bool) -> None:
        """Whether it is the one that is seen."""

    def close(self) -> None:
        """Ends what it has running."""
