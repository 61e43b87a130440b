"""What every page of the app is given, and what it offers."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vispeg.view.around import Around, around

if TYPE_CHECKING:
    import viser


View = tuple[tuple[float, float, float], tuple[float, float, float]]
ARM: View = (1.7, -1.5, 1.1), (0.1, 0.0, 0.55)  # of an arm alone
WIDE = 370  # px of a panel
FRESH = 3.0  # s that a look at the working folder holds: pages ask one after the other
CELL: View = (1.55, -1.35, 0.9), (0.45, -0.1, 0.25)  # between the walls of a cell


@dataclass
class Stage:
    """The middle of the page: what a page draws there, and else the arm.

    Attributes:
        rest: shows or hides the arm that stands there where a page draws nothing of its own.
    """

    rest: Callable[[bool], None] = lambda visible: None


@dataclass(frozen=True)
class Place:
    """Where a page stands.

    Attributes:
        server: of the toolkit; its state is every window's.
        out: folder of results.
        threads: of simulations.
        stage: the middle of the page.
    """

    server: viser.ViserServer
    out: Path
    threads: int
    stage: Stage = field(default_factory=Stage)
    seen: dict[Path, tuple[float, Around]] = field(default_factory=dict)

    @property
    def gui(self) -> Any:
        """The elements of the panels."""
        return self.server.gui

    def around(self) -> Around:
        """Give what lies under the working folder, and under the folder of results where that is elsewhere."""
        here, now = Path.cwd(), time.monotonic()
        when, known = self.seen.get(here, (-FRESH, Around()))
        if now - when >= FRESH:
            known = around(here)
            if not self.out.resolve().is_relative_to(here):
                for kind, paths in around(self.out.resolve()).places.items():
                    known.places.setdefault(kind, []).extend(paths)
            self.seen[here] = time.monotonic(), known
        return known

    def beside(self, panel: Any) -> None:
        """Put a page's second panel on the left; in a narrow window it is the end of the one sheet, and open too."""
        panel.dock_left()
        panel.set_width(WIDE)
        panel.expand()

    def look(self, view: View) -> None:
        """Turn every window, and those that are opened later, to a point: position of the viewer, and the point, m."""
        first = self.server.initial_camera
        for camera in (first, *(client.camera for client in self.server.get_clients().values())):
            camera.position, camera.look_at = view


class Page(ABC):
    """One of the app's pages: controls in the panel on the right, pictures in one on the left, a drawing between.

    Attributes:
        title: of its button.
        fills: whether it has something of its own in the middle now.
    """

    title: str
    fills: bool = False

    @abstractmethod
    def show(self, visible: bool) -> None:
        """Whether it is the one that is seen."""

    def close(self) -> None:
        """End what it has running."""
