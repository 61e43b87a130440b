"""The page of training runs: curves while they grow, the films that a run has made, and its policies to be played."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.provenance import command_line
from vispeg.view import html
from vispeg.view.place import Page, Place
from vispeg.view.run_folder import CHECKPOINTS, Run, film, newest, read

EVERY = 1.0  # s between looks at the folder
CURVES = {  # title -> columns of progress.csv, each with its colour
    "success (share of episodes)": {"success": "#0a7a75", "train_success": "#d9541e"},
    "return of an episode": {"reward": "#1f6fb4"},
    "critic's loss": {"critic_loss": "#a2456b"},
    "actor's loss, entropy": {"actor_loss": "#5b4bb7", "entropy": "#b0892b"},
    "peak force (N)": {"peak_force": "#7a5230"},
    "steps of an episode": {"episode_steps": "#2a9d60"},
}


class RunPage(Page):
    """Follows a run.

    Args:
        place: where it stands.
        run: its folder, or one that holds runs; "" for none yet.
        play: shows a policy's folder on the page of policies.
    """

    title = "Training"

    def __init__(self, place: Place, run: str, play: Callable[[str], None]):
        self.place, gui, self.play = place, place.gui, play
        self.plots: dict[str, Any] = {}
        self.latest: Run | None = None
        self.visible, self.ended = False, threading.Event()
        self.root = gui.add_folder(None)
        with self.root:
            with gui.add_folder("Run"):
                self.folder = gui.add_text("Folder", run, hint="of a run; where it holds several, the newest")
                self.start = gui.add_button("Follow the run", color="teal")
            self.now = gui.add_html(html.note("Choose the folder of a training run."))
            self.trouble = gui.add_html("", visible=False)
            with gui.add_folder("Policies of this run"):
                self.checkpoint = gui.add_dropdown("Checkpoint", ("none",))
                self.begin = gui.add_button("Play this checkpoint", disabled=True)
            with gui.add_folder("Films of this run"):
                self.film = gui.add_dropdown("Film", ("none",))
                self.screen = gui.add_html(html.note("A run films its best policy when it ends."))
            with gui.add_folder("The same as a command"):
                self.commands = gui.add_html("")
        self.left = gui.add_panel()
        with self.left.add_tab("Curves"):
            self.curves = gui.add_folder(None)
        self.left.dock_left()
        self.left.set_width(370)
        self.start.on_click(lambda _: self.follow())
        self.begin.on_click(lambda _: self._play())
        self.film.on_update(lambda _: self._screened())
        if run:
            self.follow()
        threading.Thread(target=self._watch, daemon=True).start()

    def follow(self) -> None:
        """Reads the run that is named, and draws what is new."""
        try:
            named = Path(str(self.folder.value)).expanduser()
            run = read(newest(named) or named)
        except UserError as error:
            self.trouble.content, self.trouble.visible = html.error(str(error)), True
            return
        self.trouble.visible = False
        before, self.latest = self.latest, run
        if before is None or _size(before) != _size(run) or before.folder != run.folder:
            with self.place.server.atomic():
                self.now.content = html.run(run)
                self._drawn(run)
        self._offered(run)

    def show(self, visible: bool) -> None:
        """Whether the page is seen."""
        self.visible = visible
        self.root.visible = self.left.visible = visible

    def close(self) -> None:
        """Looks no more."""
        self.ended.set()

    def _watch(self) -> None:
        while not self.ended.wait(EVERY):
            if self.latest is not None and self.visible:
                self.follow()

    def _drawn(self, run: Run) -> None:
        steps = run.curves.get("steps", np.zeros(0))
        for title, columns in CURVES.items():
            there = {n: c for n, c in columns.items() if np.isfinite(run.curves.get(n, np.zeros(0))).sum() > 0}
            if title in self.plots:
                self.plots.pop(title).remove()
            rows = np.any([np.isfinite(run.curves[n]) for n in there], axis=0) if there else np.zeros(0, bool)
            if rows.sum() < 1:
                continue
            pen = {"width": 1.6, "points": {"show": bool(rows.sum() < 30)}}
            series = [{"label": n.replace("_", " "), "stroke": c, **pen} for n, c in there.items()]
            with self.curves:
                self.plots[title] = self.place.gui.add_uplot(
                    (steps[rows], *(np.nan_to_num(run.curves[n][rows]) for n in there)),
                    ({"label": "steps"}, *series),
                    title=title,
                    scales={"x": {"time": False}},
                    axes=({"label": "steps", "size": 40, "labelSize": 14}, {"size": 55}),
                    cursor={"sync": {"key": "steps"}, "drag": {"x": True, "y": False}},
                    height=180,
                )

    def _offered(self, run: Run) -> None:
        """Checkpoints and films to choose from; what is chosen stays where it can."""
        for choice, names in ((self.checkpoint, run.checkpoints), (self.film, tuple(f.name for f in run.films))):
            new = names or ("none",)
            if tuple(choice.options) != new:
                chosen = choice.value
                choice.options = new
                choice.value = chosen if chosen in new else new[0]
                if choice is self.film:
                    self._screened()
        self.begin.disabled = not run.checkpoints
        place = str(run.folder / CHECKPOINTS / (run.checkpoints[0] if run.checkpoints else "best"))
        lines = [["train", "--resume", str(run.folder)], ["play", place, "--episodes", "1"]]
        self.commands.content = html.commands([command_line(["vispeg", *line]) for line in lines])

    def _screened(self) -> None:
        files = {} if self.latest is None else {f.name: f for f in self.latest.films}
        if self.film.value not in files:
            return
        try:
            self.screen.content = html.film(str(self.film.value), film(files[self.film.value]))
        except (UserError, OSError) as error:
            self.screen.content = html.error(str(error))

    def _play(self) -> None:
        if self.latest is not None and self.checkpoint.value in self.latest.checkpoints:
            self.play(str(self.latest.folder / CHECKPOINTS / str(self.checkpoint.value)))


def _size(run: Run) -> tuple[int, str]:
    return len(run.curves.get("steps", ())), run.failures
