"""The app: a server that listens on this machine alone, and its pages."""

from __future__ import annotations

import contextlib
import io
import threading
from pathlib import Path

from vispeg.view import html
from vispeg.view.colours import Colours
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


class App:
    """The page at `url`, which holds its token, until it is closed.

    Args:
        opened: what to show.
        out: folder of results.
        port: to listen at; None for the first free one.
        threads: of simulations.
        dark: light on dark, whatever the system says.

    Raises:
        UserError: the port is none, or taken.
    """

    def __init__(self, opened: Opened, out: Path, *, port: int | None = None, threads: int = 2, dark: bool = False):
        import viser

        gate, port = Gate(), free_port(port)
        with contextlib.redirect_stdout(io.StringIO()), gate.guarding():  # the toolkit greets on stdout
            self.server = viser.ViserServer(host=HOST, port=port, label="vispeg", verbose=False)
        limit_uploads(self.server)
        self.url = gate.url(self.server.get_port())
        gui = self.server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDE)
        gui.add_html(html.style())
        place = Place(self.server, out, threads)
        place.look(ARM)
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
        """Turn to a page; where it draws nothing of its own, the arm stands in the middle."""
        self.server.gui.set_panel_label(f"vispeg · {title}")
        for page in self.pages:
            page.show(page.title == title)
        self.study.traces.stand(all(page.title != title or not page.fills for page in self.pages))

    def _dropped(self, log: Path, model: str) -> None:
        """Note that a log was dropped beside a model: it becomes a recording first."""
        self.show(self.logs.title)
        self.logs.take(log, model)

    def _recorded(self, folder: Path) -> None:
        """Note that a log has become a recording: the page of diagnoses offers it."""
        self.study.add(folder)
        self.show(self.study.title)

    def _play(self, policy: str) -> None:
        """Note that a run's checkpoint is to be played: the page of policies does it."""
        self.show(self.policies.title)
        self.policies.choose(policy)

    def serve(self) -> None:
        """Answers until the program is interrupted, then closes."""
        try:
            threading.Event().wait()
        except KeyboardInterrupt:
            return
        finally:
            self.close()

    def close(self) -> None:
        """End the workers and the server."""
        for page in self.pages:
            page.close()
        with contextlib.redirect_stdout(io.StringIO()):
            self.server.stop()
