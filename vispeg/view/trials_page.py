"""The trials page: a run on a robot in progress, with a stop button, and a table of finished episodes."""

from __future__ import annotations

import threading
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.trials.live import State, ask_stop, read_live
from vispeg.trials.trial import FILE, is_trial, read_said
from vispeg.view import html
from vispeg.view.choice import Choice
from vispeg.view.place import Page, Place

PERIOD = 0.25  # s between readings of the folder
RED = (179, 38, 30)  # a red of the style sheet on which white text is legible
MOST = 100  # number of trials listed, the newest


class TrialsPage(Page):
    """Follow a folder of trials.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        trials: folder of trials; "" for none yet.
    """

    title = "Trials"

    def __init__(self, place: Place, trials: str):
        gui = place.gui
        self.state: State | None = None
        self.listed: dict[str, int] | None = None  # trials in the table: name -> time of the last change, ns
        self.visible, self.closed, self.lock = False, threading.Event(), threading.RLock()
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html("")
            with gui.add_folder("Trials"):
                self.folder = Choice(place, "Folder", "trials", {}, trials, lambda _: self._chosen())
            self.stop = gui.add_button("Stop the arm", color=RED, visible=False)
            self.refused = gui.add_html("", visible=False)  # why the button could not stop the arm
            self.trouble = gui.add_html("", visible=False)  # what in the folder cannot be read
            self.now = gui.add_html("", visible=False)
            self.episodes = gui.add_folder("Episodes", visible=False)
            with self.episodes:
                self.table = gui.add_html("")
        self.stop.on_click(lambda _: self.halt())
        self._guided()
        threading.Thread(target=self._watch, daemon=True).start()

    def show(self, visible: bool) -> None:
        """Show or hide the page, and offer what is in the working folder now."""
        self.visible = self.root.visible = visible
        if visible:
            self.folder.refresh()
            self.follow()

    def close(self) -> None:
        """Stop following."""
        self.closed.set()

    def follow(self) -> None:
        """Read the folder, and show what is new."""
        with self.lock:
            if not self.folder.value:
                return
            place = expanded(self.folder.value)
            try:
                self._run(read_live(place))
                self._trials(place)
                self.trouble.visible = False
            except Exception as error:  # whatever it is, the next reading may find a run that must be stopped
                self.trouble.content, self.trouble.visible = html.error(str(error)), True

    def halt(self) -> None:
        """Ask the run to end the shown episode, as the space bar in its terminal does."""
        state = self.state  # without the lock: a stop must not wait until the trials are read
        if state is None:
            return
        try:
            ask_stop(expanded(self.folder.value), state.id)
            self.refused.visible = False
        except (UserError, OSError) as error:
            self.refused.content, self.refused.visible = html.error(str(error)), True

    def _run(self, state: State | None) -> None:
        """Show the run, if its state has changed."""
        if state == self.state:
            return
        if state is not None and (self.state is None or state.id != self.state.id):
            self.refused.visible = False  # it was about another episode
        # the button comes first: what follows may fail
        self.state, self.stop.visible = state, state is not None and state.phase != "over"
        self._guided()
        self.now.visible = state is not None
        self.now.content = "" if state is None else html.live(state)

    def _trials(self, place: Path) -> None:
        """List the newest trials, if any has changed."""
        found = sorted(p for p in place.iterdir() if not p.name.startswith(".") and is_trial(p))[-MOST:]
        listed = {p.name: (p / FILE).stat().st_mtime_ns for p in found}
        if listed == self.listed:
            return
        said, errors = {}, []
        for folder in found:
            try:
                said[folder.name] = read_said(folder)
            except UserError as error:
                errors.append(html.error(str(error)))
        self.table.content, self.episodes.visible, self.listed = "".join([html.trials(said), *errors]), True, listed

    def _chosen(self) -> None:
        with self.lock:
            self.state = self.listed = None
            for part in (self.refused, self.trouble, self.now, self.stop, self.episodes):
                part.visible = False
        self.follow()

    def _guided(self) -> None:
        if self.state is not None:
            text = "A policy is on the robot. `Stop the arm` does what the space bar does in its terminal; the robot's"
            text += " emergency stop stays in charge."
        else:
            text = "No run is in progress here. `vispeg run POLICY --robot ROBOT --out FOLDER` begins one; this page"
            text += " follows it."
        self.guide.content = html.next_step("How a run on a robot goes", text)

    def _watch(self) -> None:
        while not self.closed.wait(PERIOD):
            if self.visible:
                self.follow()
