"""What all pages of the app share, and the interface of a page."""

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
ARM: View = (1.7, -1.5, 1.1), (0.1, 0.0, 0.55)  # view of an arm alone
WIDE = 370  # px, width of a panel
FRESH = 3.0  # s for which a listing of the working folder is reused, as several pages ask for it
CELL: View = (1.55, -1.35, 0.9), (0.45, -0.1, 0.25)  # view into a cell, between its walls


@dataclass
class Stage:
    """The 3D view in the middle of the page.

    Attributes:
        rest: shows or hides the arm, which is shown while a page draws nothing of its own.
    """

    rest: Callable[[bool], None] = lambda visible: None


@dataclass(frozen=True)
class Place:
    """What all pages share.

    Attributes:
        server: the toolkit's server; all windows share its state.
        out: folder that results are written to.
        threads: number of threads for simulations.
        stage: the 3D view.
        seen: the last listing of each folder, and when it was made (s, monotonic clock).
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
        """Return what the working folder contains, and the folder of results if that is elsewhere."""
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
        """Place a page's second panel on the left, unfolded; a narrow window shows it below the first panel."""
        panel.dock_left()
        panel.set_width(WIDE)
        panel.expand()

    def look(self, view: View) -> None:
        """Set the view of every window, present and future: position of the viewer and the point looked at, m."""
        first = self.server.initial_camera
        for camera in (first, *(client.camera for client in self.server.get_clients().values())):
            camera.position, camera.look_at = view


class Page(ABC):
    """A page of the app: controls in a panel on the right, pictures in one on the left, a 3D view between them.

    Attributes:
        title: label of the page's button.
        fills: whether the page now draws something of its own in the 3D view.
    """

    title: str
    fills: bool = False

    @abstractmethod
    def show(self, visible: bool) -> None:
        """Show or hide the page."""

    def close(self) -> None:
        """Stop the page's running work."""
