"""The training page: growing curves, also of several runs together, a run's films, and its policies to play."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.extras import there
from vispeg.core.paths import expanded
from vispeg.core.provenance import command_line
from vispeg.task import registry
from vispeg.view import html
from vispeg.view.choice import Choice
from vispeg.view.place import Page, Place
from vispeg.view.run_folder import CHECKPOINTS, Run, film, newest, read, runs_in

EVERY = 1.0  # s between readings of the folder
SHARE = "share of episodes"  # plots with this in their title span 0 to 1
CURVES = {  # title -> columns of progress.csv with their colours; if several runs are shown, only the first column
    f"success ({SHARE})": {"success": "#0a7a75", "train_success": "#d9541e"},
    "return of an episode": {"reward": "#1f6fb4"},
    "critic's loss": {"critic_loss": "#a2456b"},
    "actor's loss, entropy": {"actor_loss": "#5b4bb7", "entropy": "#b0892b"},
    "peak force (N)": {"peak_force": "#7a5230"},
    "steps of an episode": {"episode_steps": "#2a9d60"},
}
COLOURS = (
    "#0a7a75",
    "#d9541e",
    "#1f6fb4",
    "#a2456b",
    "#b0892b",
    "#5b4bb7",
    "#2a9d60",
    "#7a5230",
)  # colours of several runs
FIRST = [  # 23 to 28 s, film included, in four runs on two cores without other work
    f"{registry.FIRST}-state",
    *"--recipe distill --teacher expert --distill-steps 1000 --distill-updates 500".split(),
]


class RunPage(Page):
    """Follow training runs.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        run: a run's folder, or a folder of runs; "" for none yet.
        play: called with a policy's folder to play it on the policy page.
    """

    title = "Training"

    def __init__(self, place: Place, run: str, play: Callable[[str], None]):
        self.place, gui, self.play = place, place.gui, play
        self.plots: dict[str, Any] = {}
        self.latest: Run | None = None
        self.others: dict[Path, tuple[Any, Run | None]] = {}  # a tick box for each run, and its data if ticked
        self.trainer: subprocess.Popen | None = None
        self.visible, self.ended, self.lock = False, threading.Event(), threading.RLock()
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html("")
            with gui.add_folder("Run"):
                self.folder = Choice(place, "Run", "run", {}, run, lambda _: self.follow())
                self.make = gui.add_button("Train a first policy: under a minute", color="teal")
                self.stop = gui.add_button("Stop the training", color="gray", visible=False)
            self.beside = gui.add_folder("Other runs in the same curves", visible=False)
            self.now = gui.add_html("")
            self.trouble = gui.add_html("", visible=False)
            self.policies = gui.add_folder("Policies of this run", visible=False)
            with self.policies:
                self.checkpoint = gui.add_dropdown("Checkpoint", ("none",))
                self.begin = gui.add_button("Play this checkpoint", disabled=True)
            self.films = gui.add_folder("Films of this run", visible=False)
            with self.films:
                self.film = gui.add_dropdown("Film", ("none",))
                self.screen = gui.add_html(html.note("A run films its best policy when it ends."))
            self.same = gui.add_folder("The same as a command", visible=False)
            with self.same:
                self.commands = gui.add_html("")
        self.left = gui.add_panel(visible=False)
        with self.left.add_tab("Curves"):
            self.curves = gui.add_folder(None)
        place.beside(self.left)
        self.begin.on_click(lambda _: self._play())
        self.film.on_update(lambda _: self._screened())
        self.make.on_click(lambda _: self._train())
        self.stop.on_click(lambda _: self._stop())
        if run:
            self.follow()
        self._guided()
        threading.Thread(target=self._watch, daemon=True).start()

    def follow(self) -> None:
        """Read the chosen and the ticked runs, and draw what is new."""
        with self.lock:
            self._follow()

    def show(self, visible: bool) -> None:
        """Show or hide the page, and offer what is in the working folder now."""
        self.visible = self.root.visible = visible
        if visible:
            self.folder.refresh()
            self._boxes()
        self._guided()

    def close(self) -> None:
        """Stop following, and end a training that this page started."""
        self.ended.set()
        self._stop()

    def _follow(self) -> None:
        if not self.folder.value:
            return
        try:
            named = expanded(self.folder.value)
            run = read(newest(named) or named)
            others = {path: read(path) if box.value else None for path, (box, _) in self.others.items()}
        except (UserError, OSError) as error:  # such as a checkpoint that is being replaced
            self.trouble.content, self.trouble.visible = html.error(str(error)), True
            return
        self.trouble.visible = False
        before, self.latest = self.latest, run
        old = [before, *(held for _, held in self.others.values())]
        self.others = {path: (box, others[path]) for path, (box, _) in self.others.items()}
        if before is None or before.folder != run.folder:
            self._boxes()
        if [_size(r) for r in old] != [_size(r) for r in (run, *others.values())]:
            with self.place.server.atomic():
                self.now.content = html.run(run)
                self._drawn([run, *(held for held in others.values() if held is not None)])
        self._offered(run)
        self._guided()

    def _guided(self) -> None:
        """Say what to do next, and show the controls of the followed run."""
        run, training = self.latest is not None, self.trainer is not None and self.trainer.poll() is None
        for folder in (self.policies, self.films, self.same):
            folder.visible = run
        self.beside.visible = run and bool(self.others)
        self.left.visible = run and self.visible
        none = not run and not self.folder.found()
        self.make.visible, self.stop.visible = none and there("torch") and not training, training
        if run:
            text = "Curves grow while it trains. Tick other runs to see them in the same curves; play a checkpoint."
        elif training:
            text = "The first policy is being trained; its curves come with the first evaluation."
        elif none:
            text = "There is no training run under this folder. Train a first policy, or name the path of a run."
        else:
            text = "Choose a run: the one that wrote last comes first of a folder of several."
        self.guide.content = html.next_step("How training goes", text)

    def _boxes(self) -> None:
        """Make a tick box for every other run that exists."""
        if self.latest is None:
            return
        paths = [Path(value) for value in self.folder.found()]
        runs = list(dict.fromkeys(run.resolve() for path in paths for run in runs_in(path)))
        runs = [run for run in runs if run != self.latest.folder.resolve()]
        if runs == list(self.others):
            return
        for box, _ in self.others.values():
            box.remove()
        self.others = {}
        names = html.distinct([run.relative_to(Path.cwd()).as_posix() if run.is_relative_to(Path.cwd()) else str(run)
                               for run in runs])  # fmt: skip
        with self.beside:
            for run, name in zip(runs, names, strict=True):
                box = self.place.gui.add_checkbox(name, False, hint=str(run))
                box.on_update(lambda _: self.follow())
                self.others[run] = box, None

    def _watch(self) -> None:
        while not self.ended.wait(EVERY):
            if self.visible and self.trainer is not None:
                self._trained()
            if self.latest is not None and self.visible:
                self.follow()

    def _train(self) -> None:
        """Train a policy by `vispeg train` in a separate process, into the folder of results."""
        out = self.place.out / "runs" / "first"
        words = ["-m", "vispeg", "train", *FIRST, "--out", str(out), "--quiet"]
        self.trainer = subprocess.Popen([sys.executable, *words], stdin=subprocess.DEVNULL, stderr=subprocess.PIPE)
        self._guided()

    def _trained(self) -> None:
        """Show the error of a training that failed, or choose its run once that exists."""
        out = self.place.out / "runs" / "first"
        assert self.trainer is not None and self.trainer.stderr is not None
        if self.trainer.poll() not in (None, 0):
            lines = self.trainer.stderr.read().decode(errors="replace").strip().splitlines()
            self.trouble.content, self.trouble.visible = html.error(lines[-1] if lines else "it was stopped"), True
            self.trainer = None
        elif self.latest is None and newest(out) is not None:
            self.place.seen.clear()
            self.folder.value = str(out)
        self._guided()

    def _stop(self) -> None:
        if self.trainer is not None and self.trainer.poll() is None:
            self.trainer.terminate()
            self.trainer.wait()

    def _drawn(self, runs: list[Run]) -> None:
        """Draw the curves of one run, or one curve of each of several."""
        names = html.distinct([str(run.folder) for run in runs])
        for title, columns in CURVES.items():
            if title in self.plots:
                self.plots.pop(title).remove()
            if len(runs) == 1:
                lines = [(n.replace("_", " "), c, *_line(runs[0], n)) for n, c in columns.items()]
            else:
                first, pens = next(iter(columns)), itertools.cycle(COLOURS)
                lines = [(n, next(pens), *_line(r, first)) for r, n in zip(runs, names, strict=True)]
            lines = [line for line in lines if len(line[2])]
            if not lines:
                continue
            steps = np.unique(np.concatenate([line[2] for line in lines]))
            pen = {"width": 1.6, "points": {"show": bool(max(len(line[2]) for line in lines) < 30)}}
            series = [{"label": name, "stroke": colour, **pen} for name, colour, _, _ in lines]
            heights = np.concatenate([line[3] for line in lines])
            span = (0.0, 1.0) if SHARE in title else (float(heights.min()), float(heights.max()))
            room = 0.05 * ((span[1] - span[0]) or 1.0)
            # stated, as uPlot finds none and draws nothing if a line's first value is NaN
            y = {"range": span if SHARE in title else (span[0] - room, span[1] + room)}
            with self.curves:
                self.plots[title] = self.place.gui.add_uplot(
                    (steps, *(np.interp(steps, x, y, right=np.nan, left=np.nan) for _, _, x, y in lines)),
                    ({"label": "steps"}, *series),
                    title=title,
                    scales={"x": {"time": False}, "y": y},
                    axes=({"label": "steps", "size": 40, "labelSize": 14}, {"size": 55}),
                    cursor={"sync": {"key": "steps"}, "drag": {"x": True, "y": False}},
                    height=180,
                )

    def _offered(self, run: Run) -> None:
        """Offer the run's checkpoints and films; keep the choice if it still exists."""
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
        """Show the chosen film."""
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


def _line(run: Run, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the steps (n,) and values (n,) of a column where both are finite, sorted by step."""
    steps = run.curves.get("steps", np.zeros(0))
    values = run.curves.get(column, np.full(len(steps), np.nan))
    there = np.isfinite(values) & np.isfinite(steps)
    order = np.argsort(steps[there], kind="stable")
    return steps[there][order], values[there][order]


def _size(run: Run | None) -> tuple[str, int, str]:
    """Return what changes if a run writes a row: if it is unchanged, the curves are not drawn again."""
    return ("", 0, "") if run is None else (str(run.folder), len(run.curves.get("steps", ())), run.failures)
