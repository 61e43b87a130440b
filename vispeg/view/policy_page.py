"""The policy page: a policy's episode in a world, step by step, beside the same seed in a second world."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from vispeg.api.library.catalogue import policies, worlds
from vispeg.core.provenance import command_line
from vispeg.evaluation.films.moments import Moment
from vispeg.evaluation.jobs import seeds_of
from vispeg.robots.furniture import COLOURS
from vispeg.view import html
from vispeg.view.choice import Choice
from vispeg.view.drawing import Drawing
from vispeg.view.episode import Episodes
from vispeg.view.gallery import Gallery
from vispeg.view.job import Job
from vispeg.view.place import CELL, Page, Place

OWN, NONE, EXPERT = "the policy's own", "none", "expert"
NEXT = "Choose a policy and press `Play the episode`: the scripted expert needs no training."
AGAIN = "Play it, or step by step. Choose a second world beside it: the same seed, in both."
APART = 1.6  # m between the two cells


@dataclass
class Side:
    """One of the two episodes: name of its world, drawing of the cell, and steps so far."""

    world: str = ""
    cell: Drawing | None = None
    steps: list[Moment] = field(default_factory=list)


def forces(sides: Sequence[Sequence[Moment]]) -> list[np.ndarray]:
    """Return times (n,), s, of the longest episode, and each one's force at the wrist, (n,) N, NaN after its end."""
    longest = max(sides, key=len)
    out = np.full((len(sides), len(longest)), np.nan)
    for row, steps in zip(out, sides, strict=True):
        row[: len(steps)] = [float(np.linalg.norm(m.force)) for m in steps]
    return [np.array([m.time for m in longest]), *out]


def none(_: str) -> None:
    """Do nothing when a choice changes: its episode is played when the button is pressed."""


class PolicyPage(Page):
    """Watch a policy.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        policy: a policy's folder, or the name of a bundled one, to play at once; "" for none.
        world: name or file of the world to play in; "" for the policy's own.
    """

    title = "Policies"

    def __init__(self, place: Place, policy: str = "", world: str = ""):
        self.place, gui = place, place.gui
        self.sides, self.playing, self.visible = (Side(), Side()), False, False
        names = {p.name: p.name for p in policies()} | {EXPERT: EXPERT}
        built_in = {w.name: w.name for w in worlds()}
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html(html.next_step("A policy at work", NEXT))
            with gui.add_folder("Episode"):
                self.policy = Choice(place, "Policy", "policy", names, policy or EXPERT, none)
                self.world = Choice(place, "World", "world", {OWN: OWN, **built_in}, world or OWN, none, path=False)
                self.beside = Choice(place, "Beside it", "world", {NONE: NONE, **built_in}, NONE, none, path=False)
                self.seed = gui.add_number("Seed", 0, min=0, step=1)
                self.start = gui.add_button("Play the episode", color="teal")
            self.job = Job(place, self.receive, self.idle)
            self.steps = gui.add_folder("Step by step", visible=False)
            with self.steps:
                self.slider = gui.add_slider("Step", 0, 1, 1, 0)
                self.play = gui.add_button("Play")
                self.back = gui.add_button("One step back")
                self.on = gui.add_button("One step on")
            self.words = gui.add_html("")
            self.same = gui.add_folder("The same as a command", visible=False)
            with self.same:
                self.commands = gui.add_html("")
        self.left = gui.add_panel(visible=False)
        with self.left.add_tab("What the policy sees"):
            self.gallery = Gallery(place)
            self.plots = gui.add_folder(None)
        place.beside(self.left)
        self.plot: Any = None
        self.start.on_click(lambda _: self.begin())
        self.slider.on_update(lambda _: self.draw())
        self.play.on_click(lambda _: self._toggle())
        self.back.on_click(lambda _: self._by(-1))
        self.on.on_click(lambda _: self._by(1))
        if policy:
            self.begin()

    def choose(self, policy: str) -> None:
        """Choose a policy's folder, and play it in the world that it was trained in."""
        self.policy.value, self.world.value = policy, OWN
        self.begin()

    def begin(self) -> None:
        """Play the chosen episode."""
        self.playing = False
        if self.job.busy or self.job.start is None:  # the rest of another episode would mix with this one
            self.job.begin(Episodes, ())
        for side in self.sides:
            self._clear(side)
        self.fills = False
        if self.visible:
            self.place.stage.rest(True)
        world = "" if self.world.value == OWN else self.world.value
        where = (world,) if self.beside.value == NONE else (world, self.beside.value)
        seed = int(self.seed.value)
        self._commands(where, seed)
        self.same.visible = True
        scripted = self.policy.value == EXPERT  # `evaluate` plays it, which has seeds of its own
        self.job.ask("play", self.policy.value, where, seeds_of(1, seed)[0] if scripted else seed)

    def receive(self, name: str, value: Any) -> None:
        """Handle a message (name, value) from the worker."""
        if name == "cell":
            k, model, world = value
            side = self.sides[k]
            side.world = world
            if self.visible:
                self.place.stage.rest(False)
                if not self.fills:
                    self.place.look(CELL)
            self.fills = True
            side.cell = Drawing(self.place.server.scene, f"/cell{k}", model, colours=_rgb(COLOURS))
            side.cell.root.position = (0.0, -APART * k, 0.0)
            side.cell.show(self.visible)
        elif name == "moment":
            k, moment = value
            side = self.sides[k]
            side.steps.append(moment)
            self.slider.max = max(1, *(len(s.steps) - 1 for s in self.sides))
            if k == 0 or len(side.steps) == 1:
                self.slider.value = len(side.steps) - 1
                self.draw()
            if not self.steps.visible:
                self.steps.visible, self.left.visible = True, self.visible
                self.guide.content = html.next_step("A policy at work", AGAIN)
        elif name == "play done":
            self._forces()
            self.slider.value = 0
            self.draw()

    def idle(self, idle: bool) -> None:
        """Disable the buttons while an episode is being simulated."""
        self.start.disabled = not idle
        for button in (self.play, self.back, self.on):
            button.disabled = not idle or not self.sides[0].steps

    def draw(self) -> None:
        """Draw the chosen step."""
        with self.place.server.atomic():
            lines, pictures = [], {}
            for side in self.sides:
                if side.cell is None or not side.steps:
                    continue
                moment = side.steps[min(int(self.slider.value), len(side.steps) - 1)]
                side.cell.pose(moment.qpos, moment.bodies)
                pictures |= {f"{key.replace('_', ' ')} in {side.world}": p for key, p in moment.pictures.items()}
                lines.append((side.world, moment, side.steps[-1].outcome))
            self.gallery.show(pictures)
            self.words.content = html.episode(lines)

    def show(self, visible: bool) -> None:
        """Show or hide the page."""
        self.visible = visible
        self.root.visible = visible
        self.left.visible = visible and self.steps.visible
        self.playing = self.playing and visible
        for side in self.sides:
            if side.cell is not None:
                side.cell.show(visible)
        if visible:
            for choice in (self.policy, self.world, self.beside):
                choice.refresh()
            if self.fills:
                self.place.look(CELL)

    def close(self) -> None:
        """End the worker."""
        self.job.end()

    def _forces(self) -> None:
        """Plot the force at the wrist over time in both worlds."""
        if self.plot is not None:
            self.plot.remove()
            self.plot = None
        sides = [s for s in self.sides if len(s.steps) > 1]
        if not sides:
            return
        time, *lines = forces([s.steps for s in sides])
        pen = {"width": 1.6, "points": {"show": False}}
        series = [{"label": s.world, "stroke": c, **pen} for s, c in zip(sides, ("#0a7a75", "#d9541e"), strict=False)]
        with self.plots:
            self.plot = self.place.gui.add_uplot(
                (time, *lines),
                ({"label": "s"}, *series),
                title="force at the wrist, N",
                scales={"x": {"time": False}},
                axes=({"label": "s", "size": 40, "labelSize": 14}, {"size": 45}),
                height=190,
            )

    def _clear(self, side: Side) -> None:
        if side.cell is not None:
            side.cell.remove()
        side.cell, side.steps, side.world = None, [], ""

    def _by(self, step: int) -> None:
        self.playing = False
        self.slider.value = int(np.clip(int(self.slider.value) + step, 0, self.slider.max))
        self.draw()

    def _toggle(self) -> None:
        self.playing = not self.playing
        self.play.label = "Pause" if self.playing else "Play"
        if self.playing:
            threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while self.playing and int(self.slider.value) < self.slider.max:
            self.slider.value = int(self.slider.value) + 1
            self.draw()
            time.sleep(0.16)  # s, a step of the policy
        self.playing, self.play.label = False, "Play"

    def _commands(self, where: tuple[str, ...], seed: int) -> None:
        lines = []
        for k, world in enumerate(where):
            to = ["--world", world] if world else []
            if self.policy.value == EXPERT:
                words = ["evaluate", EXPERT, *(to or ["--world", "nominal"]), "--episodes", "1", "--seed", str(seed)]
                lines.append([*words, "--out", str(self.place.out / ("evaluated", "evaluated-beside")[k])])
            else:
                lines.append(["play", self.policy.value, *to, "--episodes", "1", "--seed", str(seed)])
        self.commands.content = html.commands([command_line(["vispeg", *line]) for line in lines])


def _rgb(colours: dict[str, Any]) -> dict[str, tuple[float, float, float]]:
    return {name: (float(c[0]), float(c[1]), float(c[2])) for name, c in colours.items()}
