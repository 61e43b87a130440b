"""What every page of the app is given, and what it offers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import viser


View = tuple[tuple[float, float, float], tuple[float, float, float]]
ARM: View = (1.7, -1.5, 1.1), (0.1, 0.0, 0.55)  # of an arm alone
CELL: View = (1.55, -1.35, 0.9), (0.45, -0.1, 0.25)  # between the walls of a cell


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

    def look(self, view: View) -> None:
        """Turns every window, and those that are opened later, to a point: position of the viewer, and the point, m."""
        first = self.server.initial_camera
        for camera in (first, *(client.camera for client in self.server.get_clients().values())):
            camera.position, camera.look_at = view


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
