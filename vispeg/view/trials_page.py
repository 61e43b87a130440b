"""The trials page: a run on a robot in progress, with a stop button, and a table of finished episodes."""

from __future__ import annotations

import threading
from pathlib import Path

from vispeg.core.errors import UserError
from vispeg.core.paths import expanded
from vispeg.trials.live import State, ask_stop, read_live
from vispeg.trials.trial import FILE, Said, is_trial, read_said
from vispeg.view import html
from vispeg.view.choice import Choice
from vispeg.view.place import Page, Place

EVERY = 0.25  # s between readings of the folder; a step of the policy takes 0.16 s
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
        self.said: dict[str, Said] = {}
        self.seen: list[tuple[str, int]] | None = None
        self.visible, self.ended, self.lock = False, threading.Event(), threading.RLock()
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html("")
            with gui.add_folder("Trials"):
                self.folder = Choice(place, "Folder", "trials", {}, trials, lambda _: self._chosen())
            self.stop = gui.add_button("Stop the arm", color=RED, visible=False)
            self.trouble = gui.add_html("", visible=False)
            self.now = gui.add_html("", visible=False)
            self.over = gui.add_folder("Episodes", visible=False)
            with self.over:
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
        self.ended.set()

    def follow(self) -> None:
        """Read the folder, and show what is new."""
        with self.lock:
            if not self.folder.value:
                return
            place = expanded(self.folder.value)
            try:
                state = read_live(place)
                self._trials(place)
            except (UserError, OSError) as error:
                self._trouble(str(error))
                return
            if state != self.state:
                self.state = state
                self.now.content = "" if state is None else html.live(state)
                self.now.visible = state is not None
                self.stop.visible = state is not None and state.phase != "over"
                self._guided()

    def halt(self) -> None:
        """Ask the run to end the shown episode, as the space bar in its terminal does."""
        with self.lock:
            if self.state is None:
                return
            try:
                ask_stop(expanded(self.folder.value), self.state.id)
                self.trouble.visible = False
            except (UserError, OSError) as error:
                self._trouble(str(error))

    def _trials(self, place: Path) -> None:
        """List the newest trials, if any has changed."""
        there = sorted(p for p in place.iterdir() if not p.name.startswith(".") and is_trial(p))[-MOST:]
        seen = [(p.name, (p / FILE).stat().st_mtime_ns) for p in there]
        if seen != self.seen:
            self.said, self.seen = {p.name: read_said(p) for p in there}, seen
            self.table.content, self.over.visible = html.trials(self.said), True
            self.trouble.visible = False

    def _chosen(self) -> None:
        with self.lock:
            self.state, self.seen, self.trouble.visible = None, None, False
            self.now.visible = self.stop.visible = self.over.visible = False
        self.follow()

    def _trouble(self, text: str) -> None:
        self.trouble.content, self.trouble.visible = html.error(text), True

    def _guided(self) -> None:
        if self.state is not None:
            text = "A policy is on the robot. `Stop the arm` does what the space bar does in its terminal; the robot's"
            text += " emergency stop stays in charge."
        else:
            text = "No run is in progress here. `vispeg run POLICY --robot ROBOT --out FOLDER` begins one; this page"
            text += " follows it."
        self.guide.content = html.next_step("How a run on a robot goes", text)

    def _watch(self) -> None:
        while not self.ended.wait(EVERY):
            if self.visible:
                self.follow()
