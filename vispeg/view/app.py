"""The app: a web server that only this machine can reach, and its pages."""

from __future__ import annotations

import contextlib
import io
import threading
from pathlib import Path
from threading import Lock
from typing import Any

from vispeg.view import html
from vispeg.view.data_page import DataPage
from vispeg.view.diagnose.page import StudyPage
from vispeg.view.gate import HOST, Gate, free_port, limit_uploads
from vispeg.view.import_page import ImportPage
from vispeg.view.opened import Opened
from vispeg.view.place import ARM, WIDE, Page, Place
from vispeg.view.policy_page import PolicyPage
from vispeg.view.run_page import RunPage
from vispeg.view.trials_page import TrialsPage
from vispeg.view.world_page import WorldPage

SYSTEM, LIGHT, DARK = "as the system", "light", "dark"


class App:
    """Serve the pages at `url`, which contains the access token, until `close`.

    Args:
        opened: what the pages show at first.
        out: folder that results are written to.
        port: port to listen on; None for the first free one.
        threads: number of threads for simulations.
        dark: begin with dark colours, whatever the system's setting.

    Raises:
        UserError: no valid port, or one in use.
    """

    def __init__(self, opened: Opened, out: Path, *, port: int | None = None, threads: int, dark: bool = False):
        import viser

        gate, port = Gate(), free_port(port)
        with contextlib.redirect_stdout(io.StringIO()), gate.guarding():  # the toolkit prints a greeting
            self.server = viser.ViserServer(host=HOST, port=port, label="vispeg", verbose=False)
        limit_uploads(self.server)
        self.url = gate.url(self.server.get_port())
        gui = self.server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDE)
        gui.add_html(html.style())
        place = Place(self.server, out, threads)
        place.look(ARM)
        # controls appear in the order in which they are added: the chooser comes before the pages
        titles = [kind.title for kind in (StudyPage, ImportPage, WorldPage, PolicyPage, DataPage, RunPage, TrialsPage)]
        self.chooser = gui.add_button_group("Page", titles)
        self.chooser.on_click(lambda _: self.show(str(self.chooser.value)))
        gui.add_html(html.below())
        self.study = StudyPage(place, opened.model, list(opened.recordings), self._dropped)
        self.logs = ImportPage(place, opened.logs, opened.model, self._recorded)
        self.policies = PolicyPage(place, opened.policy, opened.world)
        self.pages: list[Page] = [
            self.study,
            self.logs,
            WorldPage(place, opened.world),
            self.policies,
            DataPage(place, opened.dataset),
            RunPage(place, opened.run, self._play),
            TrialsPage(place, opened.trials),
        ]
        self.colours = Colours(self.server, dark)
        self.show(opened.page)

    def show(self, title: str) -> None:
        """Switch to a page; if it draws nothing of its own, show the arm in the 3D view."""
        self.server.gui.set_panel_label(f"vispeg · {title}")
        for page in self.pages:
            page.show(page.title == title)
        filled = any(page.title == title and page.fills for page in self.pages)
        self.study.traces.stand(not filled)

    def _dropped(self, log: Path, model: str) -> None:
        """Open the import page with a log that was dropped on the diagnosis page, and with its model."""
        self.show(self.logs.title)
        self.logs.take(log, model)

    def _recorded(self, folder: Path) -> None:
        """Offer a new recording on the diagnosis page, and open that page."""
        self.study.add(folder)
        self.show(self.study.title)

    def _play(self, policy: str) -> None:
        """Open the policy page and play a checkpoint of a training run."""
        self.show(self.policies.title)
        self.policies.choose(policy)

    def serve(self) -> None:
        """Serve until the program is interrupted, then close."""
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return
        finally:
            self.close()

    def close(self) -> None:
        """Stop the workers and the server."""
        for page in self.pages:
            page.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()


class Colours:
    """Choose light or dark colours; each window follows its own system until somebody chooses.

    Args:
        server: the toolkit's server.
        dark: begin with dark colours, whatever the system's setting.
    """

    def __init__(self, server: Any, dark: bool):
        self.server, gui = server, server.gui
        self.systems: dict[int, bool] = {}  # window -> whether its system is dark
        self.lock = Lock()  # a choice and a window's report may come at once: the later must see the earlier
        self.choice = gui.add_dropdown("Colours", (SYSTEM, LIGHT, DARK), initial_value=DARK if dark else SYSTEM)
        # a script in each window writes its system's setting into this field, and hides it
        self.reported = gui.add_text("System", "")
        server.on_client_connect(self._greet)
        self.choice.on_update(lambda _: self.apply())
        self.reported.on_update(self._receive)
        self._theme(gui, dark)

    def apply(self) -> None:
        """Apply the choice to each window in turn: a broadcast could overtake a message to one window."""
        with self.lock:
            for window in self.server.get_clients().values():
                self._recolour(window)

    async def _greet(self, window: Any) -> None:
        """Ask a new window for its system's setting; before it is connected, its answer would be lost."""
        window.gui.add_html(html.window(self.reported._impl.uuid))

    async def _receive(self, event: Any) -> None:
        """Keep a window's report; as a coroutine, so that another window's report cannot overwrite it before."""
        if event.client is None:
            return
        with self.lock:
            self.systems[event.client.client_id] = str(self.reported.value).startswith(DARK)
            self._recolour(event.client)

    def _recolour(self, window: Any) -> None:
        """Apply the choice to a window; light if it has not reported its system's setting."""
        chosen = self.choice.value
        self._theme(window.gui, self.systems.get(window.client_id, False) if chosen == SYSTEM else chosen == DARK)

    @staticmethod
    def _theme(gui: Any, dark: bool) -> None:
        gui.configure_theme(show_share_button=False, show_logo=False, dark_mode=dark)
