"""The app: a server that listens on this machine alone, and its pages."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from vispeg.view import html
from vispeg.view.import_page import ImportPage
from vispeg.view.opened import Opened
from vispeg.view.place import Page, Place
from vispeg.view.policy_page import PolicyPage
from vispeg.view.study_page import StudyPage
from vispeg.view.world_page import WorldPage

HOST = "127.0.0.1"
OURS = re.compile(r"https?://(127\.0\.0\.1|localhost|\[::1\])(:\d+)?")


class App:
    """The page at `url`, until it is closed.

    Args:
        opened: what to show.
        out: folder of results.
        port: to listen at; the next free one where it is taken.
        threads: of simulations.
        dark: light on dark.
    """

    def __init__(self, opened: Opened, out: Path, *, port: int = 8080, threads: int = 2, dark: bool = False):
        import viser

        with contextlib.redirect_stdout(io.StringIO()), _own_windows_alone():  # the toolkit greets on stdout
            self.server = viser.ViserServer(host=HOST, port=port, label="vispeg", verbose=False)
        self.url = f"http://{HOST}:{self.server.get_port()}"
        gui = self.server.gui
        gui.configure_theme(show_share_button=False, show_logo=False, dark_mode=dark)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(370)
        gui.add_html(html.style())
        camera = self.server.initial_camera
        camera.position, camera.look_at = (1.7, -1.5, 1.1), (0.1, 0.0, 0.55)
        place = Place(self.server, out, threads)
        titles = [kind.title for kind in (ImportPage, StudyPage, WorldPage, PolicyPage)]
        self.chooser = gui.add_button_group("Page", titles)
        self.chooser.on_click(lambda _: self.show(str(self.chooser.value)))
        self.dark = gui.add_checkbox("Dark", initial_value=dark)
        self.dark.on_update(lambda _: self._themed())
        self.study = StudyPage(place, opened.model, list(opened.recordings))
        self.pages: list[Page] = [
            ImportPage(place, opened.logs, opened.model, self._recorded),
            self.study,
            WorldPage(place, opened.world),
            PolicyPage(place, opened.policy, opened.world),
        ]
        self.show(opened.page)

    def show(self, title: str) -> None:
        """Turns to a page."""
        self.server.gui.set_panel_label(f"vispeg · {title}")
        for page in self.pages:
            page.show(page.title == title)

    def _recorded(self, folder: Path) -> None:
        """A log has become a recording: the page of diagnoses offers it."""
        self.study.add(folder)
        self.show(self.study.title)

    def close(self) -> None:
        """Ends the workers and the server."""
        for page in self.pages:
            page.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()

    def _themed(self) -> None:
        gui = self.server.gui
        gui.configure_theme(show_share_button=False, show_logo=False, dark_mode=bool(self.dark.value))


@contextlib.contextmanager
def _own_windows_alone() -> Iterator[None]:
    """A server that is made in the body answers no page of another site, which a browser would let it talk to."""
    import websockets.asyncio.server as library

    plain: Any = library.serve
    library.serve = partial(plain, origins=[OURS, None])  # type: ignore[misc, assignment]
    try:
        yield
    finally:
        library.serve = plain  # type: ignore[misc]
