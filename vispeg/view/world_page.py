"""The world page: a slider for each range; moving one draws the cell and pictures again; the result can be saved."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from vispeg.api.library.catalogue import worlds
from vispeg.core.provenance import command_line
from vispeg.datasets.shards.plan import Plan
from vispeg.report.text import effect_words
from vispeg.view import html
from vispeg.view.choice import Choice
from vispeg.view.drawing import Drawing
from vispeg.view.gallery import Gallery
from vispeg.view.job import Job
from vispeg.view.place import CELL, Page, Place
from vispeg.view.world_draw import Drawn, Draws, Range

NEXT = "Draw other seeds, or move the ends of a range: the cell is drawn again. Then keep the world as a file."
STEPS = 200  # number of steps of a slider
FRAMES = 8  # number of frames that the command renders


class WorldPage(Page):
    """Show a world and change its ranges.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        world: name or file of the world to begin with; "" for the world `randomized`.
    """

    title = "Worlds"

    def __init__(self, place: Place, world: str = ""):
        self.place, gui = place, place.gui
        self.sliders: list[tuple[Range, Any]] = []
        self.folders: list[Any] = []
        self.cell: Drawing | None = None
        self.visible, self.opened, self.again = False, "", False
        self.saving: Any = None  # the file that is being written, the world on which it is based, its moved ranges
        self.saved: Any = None  # the same of the file that was written last
        built_in = {w.name: w.name for w in worlds()}
        self.root = gui.add_folder(None)
        with self.root:
            gui.add_html(html.next_step("A world, and what it draws", NEXT))
            with gui.add_folder("World"):
                self.world = Choice(place, "World", "world", built_in, world or "randomized", lambda _: self.open())
                self.seed = gui.add_number("Seed", 0, min=0, step=1)
                self.other = gui.add_button("Draw another seed", color="teal")
            self.job = Job(place, self.receive, self.idle)
            with gui.add_folder("Save"):
                self.name = gui.add_text("Name", "mine")
                self.save = gui.add_button("Write the world file")
                self.done = gui.add_html("")
            with gui.add_folder("The same as a command"):
                self.commands = gui.add_html("")
            self.ranges = gui.add_folder("Ranges", expand_by_default=True)
        self.left = gui.add_panel()
        with self.left.add_tab("What cameras see"):
            self.gallery = Gallery(place)
            with gui.add_folder("Drawn this time"):
                self.drawn = gui.add_html("")
        place.beside(self.left)
        self.seed.on_update(lambda _: self.draw())
        self.other.on_click(lambda _: self._next())
        self.save.on_click(lambda _: self._save())
        self.name.on_update(lambda _: self._renamed())

    def open(self) -> None:
        """Show the ranges of the chosen world, and draw it."""
        self.opened = self.world.value
        self._ranges([])  # those of another world do not apply, also if this one cannot be opened
        if self.job.start is None:
            self.job.begin(Draws, ())
        self.job.ask("open", self.opened)
        self.draw()

    def draw(self) -> None:
        """Draw the first episode of the command; if another is being drawn, do it afterwards."""
        self._commands()
        if self.job.busy:
            self.again = True
            return
        self.again = False
        command = Plan(self.opened, "", FRAMES, seed=int(self.seed.value))
        self.job.ask("draw", self.opened, command.episode_seed(0, 0), self._moved())

    def receive(self, name: str, value: Any) -> None:
        """Handle a message (name, value) from the worker."""
        if name == "ranges":
            self._ranges(value)
        elif name == "drawn":
            self._show(value)
        elif name == "save done":
            self.done.content = html.note(f"{value} is written")
            self.saved = self.saving
            self._renamed()

    def idle(self, idle: bool) -> None:
        """Draw again if a slider moved while the worker was busy."""
        if idle and self.again:
            self.draw()

    def show(self, visible: bool) -> None:
        """Show or hide the page; open its world when it is shown for the first time."""
        self.visible = visible
        self.root.visible = self.left.visible = visible
        if self.cell is not None:
            self.cell.show(visible)
        if visible:
            if self.fills:
                self.place.look(CELL)
            self.world.refresh()
            self._named()
        if visible and not self.opened:
            self.open()

    def close(self) -> None:
        """End the worker."""
        self.job.end()

    def _moved(self) -> dict[tuple[str, str, str], tuple[float, float]]:
        """Return the ranges whose sliders were moved: effect, place, parameter -> ends."""

        def moved(r: Range, s: Any) -> bool:  # by more than the slider rounds
            step = (r.most - r.least) / STEPS
            return abs(s.value[0] - r.low) > 0.6 * step or abs(s.value[1] - r.high) > 0.6 * step

        ends = {(r.effect, r.where, r.param): s.value for r, s in self.sliders if moved(r, s)}
        return {place: (float(low), float(high)) for place, (low, high) in ends.items()}

    def _ranges(self, ranges: list[Range]) -> None:
        for folder in self.folders:
            folder.remove()
        self.folders, self.sliders = [], []
        by_effect: dict[tuple[str, str], list[Range]] = {}
        for r in ranges:
            by_effect.setdefault((r.effect, r.where), []).append(r)
        with self.ranges:
            for (name, where), group in by_effect.items():
                label = effect_words.named({"effect": name, "where": where})
                folder = self.place.gui.add_folder(label, expand_by_default=len(by_effect) < 8)
                self.folders.append(folder)
                with folder:
                    for r in group:
                        unit = f" ({r.unit})" if r.unit not in ("", "1") else ""
                        step = float(f"{(r.most - r.least) / STEPS:.1g}")
                        slider = self.place.gui.add_multi_slider(
                            f"{r.param.replace('_', ' ')}{unit}",
                            min=r.least,
                            max=r.most,
                            step=step,
                            initial_value=(r.low, r.high),
                        )
                        slider.on_update(lambda _: self.draw())
                        self.sliders.append((r, slider))

    def _show(self, drawn: Drawn) -> None:
        if self.cell is not None:
            self.cell.remove()
        if self.visible:
            self.place.stage.rest(False)
            if not self.fills:
                self.place.look(CELL)
        self.fills = True
        self.cell = Drawing(self.place.server.scene, "/world", drawn.model)
        self.cell.pose(drawn.qpos, drawn.bodies)
        self.cell.show(self.visible)
        self.gallery.show({key.replace("_", " "): image for key, image in drawn.pictures.items()})
        self.drawn.content = html.drawn(drawn.values)

    def _next(self) -> None:
        self.seed.value = int(self.seed.value) + 1  # its update draws

    def _renamed(self) -> None:
        self._named()
        self._commands()

    def _named(self) -> None:
        """Label the save button: it names the file that would be replaced."""
        target = self._target()
        self.save.label = f"Replace {target.name}" if target.exists() else "Write the world file"

    def _save(self) -> None:
        self._commands()
        words = str(self.save.label)
        self._named()
        if str(self.save.label) == words:  # otherwise it has appeared in the meantime: the button says so now
            self.saving = self._target(), self.opened, self._moved()
            self.job.ask("save", *self.saving, self._target().exists())

    def _target(self) -> Path:
        return self.place.out / "worlds" / f"{Path(str(self.name.value) or 'mine').name}.yaml"

    def _commands(self) -> None:
        moved = self._moved()
        if moved and self.saved != (self._target(), self.opened, moved):
            self.commands.content = html.note("Ranges were moved: write the world file first.")
            return
        world = str(self._target()) if moved else self.opened
        out = str(self.place.out / "frames")
        words = ["render", "--world", world, "--frames", str(FRAMES), "--seed", str(int(self.seed.value)), "--out", out]
        self.commands.content = html.commands([command_line(["vispeg", *words])])
