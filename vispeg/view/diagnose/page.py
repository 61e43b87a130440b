"""The diagnosis page: choose a model and recordings, see where the model fails, add effects, see the error fall."""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from vispeg.api.inputs import read_model
from vispeg.core.errors import UserError
from vispeg.core.provenance import command_line
from vispeg.recordings.cell import OPEN_CELL
from vispeg.report.text import words
from vispeg.robots.model import available
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import compiled
from vispeg.task.belief import robot_of_world
from vispeg.view import html
from vispeg.view.around import HEADS, TABLES, kind_of, named, shipped_recordings
from vispeg.view.diagnose.pictures import Pictures
from vispeg.view.diagnose.standing import Candidate, Standing, Tried
from vispeg.view.diagnose.study import Study
from vispeg.view.diagnose.traces import Traces
from vispeg.view.drop import Drop
from vispeg.view.job import Job
from vispeg.view.place import Page, Place

FIT, JUDGE, LEAVE_OUT, REMOVE = ROLES = ("fit", "judge on", "leave out", "remove")
CHOOSE = "choose"
WAY = ("Model and logs", "Where it fails", "What is missing", "Add it", "Take it away")
LINES = 6  # number of log lines shown


class StudyPage(Page):
    """Find by hand what a model lacks.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        model: a model in any form that `vispeg diagnose` accepts.
        recordings: folders of recordings; if there are several, the last one is held out and judges.
        log: called with a log that was dropped here and with the model, so that the log is imported first.
    """

    title = "Diagnose"

    def __init__(self, place: Place, model: str, recordings: list[Path], log: Callable[[Path, str], None]):
        self.place, gui, self.log_dropped = place, place.gui, log
        self.standing: Standing | None = None
        self.candidates: list[Any] = []
        self.tried: list[Tried] = []
        self.roles: dict[Path, Any] = {}
        # model, fitted and held-out recordings of the last comparison
        self.compared: tuple[str, tuple[Path, ...], tuple[Path, ...]] = model, (), ()
        self.models: dict[str, str] = {}
        self.there: dict[str, list[Path]] = {}  # label -> recordings found in the working folder
        self.drawn, self.written_to, self.window = 0, None, None
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html("")
            with gui.add_folder("Model and recordings") as self.inputs:
                kinds = (*HEADS, *TABLES)
                hint = "a model: YAML, MJCF or URDF; a log: CSV, Parquet, NPZ or bag"
                self.drop = Drop(place, "Drop a model or a log", hint, kinds, self.take, self._failed)
                self.model = gui.add_dropdown("Model", (model,), initial_value=model)
                self.chosen = gui.add_folder(None)
                self.here = gui.add_dropdown("Add recording", (CHOOSE,))
                self.example = gui.add_button("Use the example: an arm with two hidden effects", color="blue")
                self.compare = gui.add_button("Compare model and recordings", color="teal")
                self.channel = gui.add_dropdown("Channel", ("joints",), visible=False)
            self.ladder = gui.add_html("")
            self.job = Job(place, self.receive, self.idle)
            self.missing = gui.add_folder("What is missing", visible=False)
            with self.missing:
                self.list = gui.add_folder(None)
                self.run = gui.add_button("Let the search go on by itself", color="teal")
                self.undo = gui.add_button("Take the last step back", color="gray")
                self.screen = gui.add_button(
                    "Score the candidates", hint="how much of the error each could explain", color="gray"
                )
            self.history = gui.add_folder("What was tried", visible=False)
            with self.history:
                self.log = gui.add_html("")
                self.anyway = gui.add_button("Add what was refused all the same", visible=False)
            self.results = gui.add_folder("Take it away", visible=False)
            with self.results:
                self.save = gui.add_button("Take the model (model.yaml)", color="teal")
                self.report = gui.add_button("Work out the next motion and the report")
                self.motion = gui.add_button("Take the next motion (samples.csv)", visible=False, color="teal")
                self.page = gui.add_button("Take the report (report.html)", visible=False)
                self.written = gui.add_html("")
            self.same = gui.add_folder("The same as a command", visible=False)
            with self.same:
                self.commands = gui.add_html("")
        self.left = gui.add_panel(visible=False)
        with self.left.add_tab("Where it fails"):
            self.axis = gui.add_dropdown("Over", tuple(html.AXES))
            self.heat = gui.add_html(html.note("The map comes with the comparison."))
            self.go = gui.add_text("Go to", "", hint="WHAT, RECORDING SECONDS, such as: joint4, 1 2.5")
            self.traces = Traces(place)
            self.pictures = Pictures(place, self._see)
        place.beside(self.left)
        self.visible = False
        self._wire()
        place.stage.rest = self.traces.stand
        self._offered(model)
        for path in recordings:
            self.add(path)
        self.idle(True)
        self._stood()
        if recordings:
            self.open()

    def take(self, path: Path) -> None:
        """Accept a dropped model or log; show an error for any other file."""
        kind = kind_of(path)
        if kind == "log":
            self.log_dropped(path, self.chosen_model)
        elif kind == "model":
            self._offered(str(path))
        else:
            words = "a model file, an MJCF (<mujoco>), a URDF (<robot>), or a log (CSV, Parquet, NPZ, bag)"
            self.job.fail(str(UserError("is neither a model nor a log", file=path.name, expected=words)))

    def add(self, path: Path) -> None:
        """Add a recording and hold it out in place of the one held out so far; the first one is fitted."""
        if path not in self.roles:
            for other in self.roles.values():
                other.value = FIT if other.value == JUDGE else other.value
            with self.chosen:
                choice = self.place.gui.add_dropdown(path.name, ROLES, initial_value=JUDGE, hint=str(path))
                choice.on_update(lambda _, path=path: self._role(path))
                self.roles[path] = choice
            if len(self.roles) == 1:
                self.roles[path].value = FIT
        self._listed()
        self._guided()

    def open(self, channel: str | None = None) -> None:
        """Compare the model with the recordings in a channel (default: the first), then score the candidates."""
        fitted, held_out = self._sides()
        if not fitted and not held_out:
            self._guided()
            return
        self.tried, self.standing = [], None
        self.compared = self.chosen_model, fitted, held_out
        args = (*self.compared, self.place.out, self.place.threads, channel)
        self._candidates([])
        self._logged()
        asked = ("show", "screen") if fitted and held_out else ("show",)
        self.job.begin(Study, args, *asked)

    def receive(self, name: str, value: Any) -> None:
        """Handle a message (name, value) from the worker."""
        if name == "model":
            self.drawn += 1
            self.traces.draws(*value)
        elif name == "standing":
            self._stand(value)
        elif name == "candidates":
            self._candidates(value)
        elif name == "tried":
            self.tried.append(value)
        elif name == "pictured":
            self.pictures.show(value)
        elif name == "save done":
            self.written.content = html.note(f"{value} is written")
            self._download(Path(value))
        elif name == "report done":
            self._reported(Path(value))
        elif name in ("fit done", "undo done") and not (self.standing and self.standing.enough):
            if not self.tried or not self.tried[-1].refused or name == "undo done":
                self.job.ask("screen")
        self._logged()

    def idle(self, idle: bool) -> None:
        """Disable the buttons that must wait for the running work."""
        ready = idle and self.standing is not None
        able = ready and self.standing is not None and self.standing.judged
        for button in (self.screen, self.run, self.report, *self.candidates):
            button.disabled = not able
        self.save.disabled = not ready
        self.undo.disabled = not able or self.standing is None or len(self.standing.ladder) < 2
        refused = bool(able and self.tried and self.tried[-1].refused)
        self.anyway.visible = refused and bool(self.last)
        self._guided()

    def show(self, visible: bool) -> None:
        """Show or hide the page, and offer what is in the working folder now."""
        self.visible = self.root.visible = visible
        self.left.visible = visible and self.standing is not None
        self.traces.show(visible)
        if visible:
            self._offered(self.chosen_model)
            self._listed()

    def close(self) -> None:
        """End the worker."""
        self.job.end()

    last = ""  # the candidate that the user fitted last

    @property
    def chosen_model(self) -> str:
        """The chosen model, in a form that `vispeg diagnose` accepts."""
        return self.models.get(str(self.model.value), str(self.model.value))

    def _wire(self) -> None:
        self.compare.on_click(lambda _: self.open())
        self.example.on_click(lambda _: self._example())
        self.here.on_update(lambda _: self._here())
        self.channel.on_update(lambda _: self._other_channel())
        self.model.on_update(lambda _: self._other_model())
        self.screen.on_click(lambda _: self.job.ask("screen"))
        self.run.on_click(lambda _: self._run())
        self.undo.on_click(lambda _: self.job.ask("undo"))
        self.anyway.on_click(lambda _: self.job.ask("fit", self.last, True))
        self.save.on_click(lambda event: self._taken(event, "save", self._file(), False))
        self.report.on_click(lambda event: self._taken(event, "report"))
        self.motion.on_click(lambda event: self._download(self._result("next_experiment/samples.csv"), event.client))
        self.page.on_click(lambda event: self._download(self._result("report.html"), event.client))
        self.axis.on_update(lambda _: self._map())
        self.go.on_update(lambda _: self._go())

    def _failed(self, text: str) -> None:
        self.job.fail(text)

    def _offered(self, model: str) -> None:
        """Offer the models that exist, choose one, and draw it if none was drawn."""
        found = named(self.place.around().of("model"), Path.cwd())
        self.models = {label: str(path) for label, path in found.items()} | {n: n for n in (*available(), OPEN_CELL)}
        label = next((label for label, value in self.models.items() if value == model), "")
        if not label:
            label = str(model)
            self.models = {label: model} | self.models
        if tuple(self.model.options) != tuple(self.models):
            self.model.options = tuple(self.models)
        if self.model.value != label:
            self.model.value = label  # its update draws the model
        elif not self.drawn:
            self._other_model()

    def _other_model(self) -> None:
        """Draw the chosen model, and drop the comparison with the previous one."""
        self.drawn += 1
        threading.Thread(target=self._draw, args=(self.drawn, self.chosen_model), daemon=True).start()
        if self.chosen_model != self.compared[0]:
            self.job.end()
            self.standing, self.tried = None, []
            self._candidates([])
            self._stood()
        self._guided()

    def _draw(self, number: int, model: str) -> None:
        try:
            body = robot_of_world(read_model(model))
            made = compiled(body)
        except UserError as error:
            if number == self.drawn:
                self.job.fail(str(error))
            return
        if number == self.drawn:  # nothing else has been drawn meanwhile
            self.job.trouble.visible = False
            self.traces.draws(made, isinstance(body, Scene))

    def _listed(self) -> None:
        """Offer the recordings in the working folder that are not chosen yet, and folders of several as one entry."""
        paths = [
            p for p in self.place.around().of("recording") if p not in self.roles and p.resolve() not in self.roles
        ]
        one = {label: [path] for label, path in named(paths, Path.cwd()).items()}
        folders: dict[Path, list[Path]] = {}
        for path in paths:
            folders.setdefault(path.parent, []).append(path)
        several = {p: some for p, some in folders.items() if len(some) > 1 and p != Path.cwd()}
        names = named(several, Path.cwd())
        self.there = {f"{label}/ (all {len(several[p])})": several[p] for label, p in names.items()} | one
        if tuple(self.here.options) != (CHOOSE, *self.there):
            self.here.options = (CHOOSE, *self.there)
        self.here.value = CHOOSE
        self.here.visible = bool(self.there)
        self.example.visible = not self.roles

    def _here(self) -> None:
        for path in self.there.get(str(self.here.value), ()):
            self.add(path)

    def _example(self) -> None:
        """Open the bundled recordings with the model of their arm."""
        self._offered("iiwa14")
        for path in shipped_recordings():
            self.add(path)
        self.open()

    def _other_channel(self) -> None:
        """Compare in the chosen channel, unless it is the present one."""
        if self.standing is not None and self.channel.value != self.standing.channel:
            self.open(str(self.channel.value))

    def _role(self, path: Path) -> None:
        """Remove a recording if its role says so; if it was the held-out one, hold out the last of the others."""
        if self.roles[path].value != REMOVE:
            return
        judged = self._sides()[1]
        self.roles.pop(path).remove()
        if not judged and len(self.roles) > 1:
            last = next(reversed(self.roles))
            self.roles[last].value = JUDGE
        self._listed()
        self._guided()

    def _guided(self) -> None:
        """Say what to do next."""
        at, text = self._next()
        self.guide.content = html.next_step("", text, WAY, at)
        fitted, held_out = self._sides()
        self.compare.disabled = not fitted and not held_out

    def _next(self) -> tuple[int, str]:
        """Return the index in WAY of the present step, and the next thing to do, as a sentence."""
        standing, busy = self.standing, self.job.busy
        fitted, held_out = self._sides()
        if standing is None:
            if busy:
                return 1, "The model is being simulated along the recordings."
            if not self.roles:
                return 0, "Drop your model and your logs, or add recordings that are there. None yet? Use the example."
            if not fitted or not held_out:
                return 0, "Add a second recording: one is fitted, another judges. Or compare with this one alone."
            return 0, "Press `Compare model and recordings`."
        if not standing.judged:
            return (
                1,
                "The map shows where the model fails. To find what is missing, add a second recording and compare.",
            )
        if standing.enough:
            return 4, "The error is near the sensor noise: take the model away, and work out the next motion."
        if busy:
            fitting = "It is fitted, and judged on the recordings that were not."
            return (3, fitting) if self.candidates else (2, "What could be missing is scored, in each joint and link.")
        if self.candidates:
            return 3, "Press the candidate that explains most. It is added if the held-out error falls enough."
        return 4, "No candidate is left. Take the model away, and work out the next motion."

    def _run(self) -> None:
        self.last = ""
        self.job.ask("run")

    def _fit(self, key: str) -> None:
        self.last = key
        self.job.ask("fit", key)

    def _taken(self, event: Any, what: str, *args: Any) -> None:
        self.window = event.client
        self.job.ask(what, *args)

    def _download(self, path: Path | None, window: Any = None) -> None:
        """Send a written file to the window that asked for it."""
        window = window or self.window
        if path is not None and window is not None:
            window.send_file_download(path.name, path.read_bytes(), save_immediately=True)

    def _result(self, name: str) -> Path | None:
        return None if self.written_to is None or not (self.written_to / name).is_file() else self.written_to / name

    def _reported(self, folder: Path) -> None:
        """Offer the report, and say what to record next."""
        self.written_to = folder
        record = json.loads((folder / "diagnosis.json").read_text(encoding="utf-8"))
        self.motion.visible = self._result("next_experiment/samples.csv") is not None
        self.page.visible = self._result("report.html") is not None
        text = f"{folder} is written. Verdict: {record['verdict']}. {words.onward(record)}"
        self.written.content = html.reported(text, record)

    def _stand(self, standing: Standing) -> None:
        """Show a new state of the search."""
        if self.standing is not None and self.standing.effects != standing.effects:
            self._candidates([])  # these were scored for another model; new scores follow
        self.standing = standing
        if tuple(self.channel.options) != standing.channels:
            self.channel.options = standing.channels
        self.channel.value, self.channel.visible = standing.channel, len(standing.channels) > 1
        self.motion.visible = self.page.visible = False  # they belong to the previous state
        self.written.content = ""
        self._stood()
        self.ladder.content = html.ladder(standing)
        self.traces.take(standing)
        self.pictures.take(standing)
        if standing.maps and tuple(self.axis.options) != tuple(standing.maps):
            self.axis.options = tuple(standing.maps)
            self.axis.value = next(iter(standing.maps))
        self._map()
        self._picture()
        self._commands()

    def _stood(self) -> None:
        """Show the results once a model was compared, else hide them."""
        there = self.standing is not None
        for folder in (self.missing, self.history, self.results, self.same):
            folder.visible = there
        self.left.visible = there and self.visible
        if not there:
            self.ladder.content = ""
            self.traces.forget()

    def _map(self) -> None:
        if self.standing is None or self.axis.value not in self.standing.maps:
            return
        target = self.go._impl.uuid  # the toolkit's id of the text field is also the id of its HTML element
        self.heat.content = html.heat(self.standing, self.axis.value, str(self.go.value), target)

    def _go(self) -> None:
        """Show the column, track and moment in the text field."""
        column, comma, when = str(self.go.value).rpartition(",")
        try:
            track, moment = int(when.split()[0]) - 1, float(when.split()[1])
        except (IndexError, ValueError):
            return  # still being typed
        self.traces.go(column, track, moment)
        self._map()
        self._picture()

    def _picture(self) -> None:
        """Request the picture at the shown moment, if pictures are compared or one was requested before."""
        standing = self.standing
        if standing is not None and (standing.unit == "px" or self.pictures.taken is not None):
            self._see(str(self.pictures.camera.value))

    def _see(self, camera: str) -> None:
        """Request the picture of a camera, or of the first one if the track lacks it, at the shown moment."""
        assert self.standing is not None
        cameras = self.standing.tracks[self.traces.number].cameras
        if cameras:
            camera = camera if camera in cameras else cameras[0]
            self.job.ask("picture", self.traces.number, float(self.traces.slider.value), camera)

    def _candidates(self, candidates: list[Candidate]) -> None:
        for button in self.candidates:
            button.remove()
        self.candidates = []
        with self.list:
            for candidate in candidates:
                share = f"{100 * candidate.share:.0f} %" if candidate.share >= 0.01 else "under 1 %"
                hint = f"fit {candidate.key}: it could explain {share} of the fitted error"
                button = self.place.gui.add_button(f"{candidate.words} · {share}", hint=hint, color="blue")
                button.on_click(lambda _, key=candidate.key: self._fit(key))
                self.candidates.append(button)
        self._guided()

    def _logged(self) -> None:
        said = [text for text in self.job.said[-LINES:]]
        unit = self.standing.unit if self.standing is not None else "rad"
        self.log.content = html.tried(self.tried[-20:], said[::-1], unit)

    def _sides(self) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
        """Return the fitted and the held-out recordings."""
        fitted, held_out = (tuple(p for p, d in self.roles.items() if d.value == role) for role in (FIT, JUDGE))
        return fitted, held_out

    def _file(self) -> Path:
        """Return a path for model.yaml that does not exist yet."""
        names = (self.place.out / f"model{n}.yaml" for n in ("", *range(2, 1000)))
        return next(path for path in names if not path.exists())

    def _commands(self) -> None:
        model, fitted, held_out = self.compared
        assert self.standing is not None
        sides = [*_flags("--recording", fitted), *_flags("--validate", held_out)]
        against = _flags("--recording", held_out or fitted)
        lines = [["compare", model, *against, "--out", str(self.place.out / "compared")]]
        if self.standing.effects:
            effects = [e.key for e in self.standing.effects]
            out = str(self.place.out / "fitted")
            lines.append(["fit", model, *sides, "--effects", *effects, "--out", out])
        if self.standing.judged:
            lines.append(["diagnose", model, *sides, "--out", str(self.place.out / "found")])
        self.commands.content = html.commands([command_line(["vispeg", *line]) for line in lines])


def _flags(flag: str, paths: Sequence[Path]) -> list[str]:
    return [word for path in paths for word in (flag, str(path))]
