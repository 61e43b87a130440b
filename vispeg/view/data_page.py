"""The dataset page: frames one by one, the values drawn for each, and their distribution over all episodes."""

from __future__ import annotations

from bisect import bisect_right
from typing import Any

from vispeg.core.provenance import command_line
from vispeg.report.dataset.drawn import drawn
from vispeg.view import html
from vispeg.view.choice import Choice
from vispeg.view.frames import Frame, Frames, Holding
from vispeg.view.gallery import Gallery
from vispeg.view.job import Job
from vispeg.view.place import Page, Place


class DataPage(Page):
    """Browse a dataset.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        dataset: the dataset's folder; "" for none yet.
    """

    title = "Data"

    def __init__(self, place: Place, dataset: str):
        self.place, gui = place, place.gui
        self.holding: Holding | None = None
        self.waits = False  # whether a frame was requested while the worker was busy
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html("")
            with gui.add_folder("Dataset"):
                self.folder = Choice(place, "Dataset", "dataset", {}, dataset, lambda _: self.open())
                self.make = gui.add_button("Render a small one: 8 frames of the world S", color="teal")
            self.job = Job(place, self.receive, self.idle)
            self.steps = gui.add_folder("Frame", visible=False)
            with self.steps:
                self.number = gui.add_slider("Frame", 0, 1, 1, 0)
                self.episode = gui.add_slider("Episode", 0, 1, 1, 0)
                self.back = gui.add_button("One frame back")
                self.on = gui.add_button("One frame on")
            self.facts = gui.add_html("")
            self.same = gui.add_folder("The same as a command", visible=False)
            with self.same:
                self.commands = gui.add_html("")
        self.left = gui.add_panel(visible=False)
        self.visible = False
        with self.left.add_tab("Pictures"):
            self.gallery = Gallery(place)
        with self.left.add_tab("All draws"):
            self.draws = gui.add_html(html.note("How drawn values spread over the episodes comes here."))
        place.beside(self.left)
        self.make.on_click(lambda _: self._make())
        self.number.on_update(lambda _: self.look())
        self.episode.on_update(lambda _: self._to_episode())
        self.back.on_click(lambda _: self._by(-1))
        self.on.on_click(lambda _: self._by(1))
        if dataset:
            self.open()

    def open(self) -> None:
        """Open the chosen dataset."""
        self.holding = None
        self._guided()
        self.job.begin(Frames, ())
        self.job.ask("open", self.folder.value)

    def look(self) -> None:
        """Show the frame at the slider; if another is being read, do it afterwards."""
        if self.holding is None:
            return
        self.waits = self.job.busy
        if not self.waits:
            self.job.ask("frame", int(self.number.value))

    def receive(self, name: str, value: Any) -> None:
        """Handle a message (name, value) from the worker."""
        if name == "dataset":
            self._opened(value)
        elif name == "frame":
            self._show(value)
        elif name == "render done":
            self.place.seen.clear()
            self.folder.value = str(value)

    def idle(self, idle: bool) -> None:
        """Show the frame that was requested while the worker was busy."""
        for button in (self.back, self.on):
            button.disabled = self.holding is None
        if idle and self.waits:
            self.look()

    def show(self, visible: bool) -> None:
        """Show or hide the page, and offer what is in the working folder now."""
        self.visible = self.root.visible = visible
        if visible:
            self.folder.refresh()
        self._guided()

    def close(self) -> None:
        """End the worker."""
        self.job.end()

    def _guided(self) -> None:
        """Say what to do next, and show the controls of an open dataset."""
        opened, offered = self.holding is not None, bool(self.folder.found())
        self.steps.visible = self.same.visible = opened
        self.left.visible = opened and self.visible
        self.make.visible = not opened and not offered
        if opened:
            text = "Step through frames and episodes; `All draws` shows what varied."
        elif offered:
            text = "Choose a dataset: LeRobot's layout or BOP's."
        else:
            text = "There is no dataset under this folder. Render a small one, or name the path of one."
        self.guide.content = html.next_step("Frames, and what was drawn for them", text)

    def _make(self) -> None:
        if self.job.start is None:
            self.job.begin(Frames, ())
        self.job.ask("render", self.place.out / "dataset")

    def _opened(self, holding: Holding) -> None:
        self.number.max, self.episode.max = max(1, holding.frames - 1), max(1, len(holding.starts) - 1)
        self.number.value = self.episode.value = 0
        self.draws.content = html.draws(drawn(holding.worlds))
        out = str(self.place.out / "dataset-page")
        self.commands.content = html.commands(
            [
                command_line(["vispeg", "dataset", "show", self.folder.value, "--out", out]),
                command_line(["vispeg", "dataset", "check", self.folder.value]),
            ]
        )
        self.holding = holding
        self._guided()

    def _show(self, frame: Frame) -> None:
        assert self.holding is not None
        with self.place.server.atomic():
            self.gallery.show(frame.pictures)
            self.facts.content = html.frame(frame, self.holding)

    def _to_episode(self) -> None:
        """Show the first frame of the chosen episode, unless the shown frame is in it."""
        if self.holding is None:
            return
        start = self.holding.starts[min(int(self.episode.value), len(self.holding.starts) - 1)]
        if int(self.episode.value) != bisect_right(self.holding.starts, int(self.number.value)) - 1:
            self.number.value = start

    def _by(self, step: int) -> None:
        if self.holding is not None:
            self.number.value = min(max(int(self.number.value) + step, 0), self.holding.frames - 1)
