"""The page of a diagnosis: choose model and recordings, see where it fails, press an effect, watch the error fall."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vispeg.core.files import write_bytes_atomic
from vispeg.core.provenance import command_line
from vispeg.view import html
from vispeg.view.diagnose.pictures import Pictures
from vispeg.view.diagnose.standing import Candidate, Standing, Tried
from vispeg.view.diagnose.study import Study
from vispeg.view.diagnose.traces import Traces
from vispeg.view.job import Job
from vispeg.view.place import Page, Place

ROLES = ("fit", "judge on", "leave out")
MODEL = "a model file, a robot's name, or a path to an MJCF or URDF"
LINES = 6  # of the log that are shown


class StudyPage(Page):
    """What is missing from a model.

    Args:
        place: where it stands.
        model: as `vispeg diagnose` takes it.
        recordings: folders; the last one is judged on where there are several.
    """

    title = "Diagnose"

    def __init__(self, place: Place, model: str, recordings: list[Path]):
        self.place, gui = place, place.gui
        self.standing: Standing | None = None
        self.candidates: list[Any] = []
        self.tried: list[Tried] = []
        self.roles: dict[Path, Any] = {}
        self.root = gui.add_folder(None)
        with self.root:
            with gui.add_folder("Model and recordings") as self.inputs:
                self.model = gui.add_text("Model", model, hint=MODEL)
                self.upload = gui.add_upload_button("Drop a model file (.yaml)", mime_type=".yaml,.yml")
                self.chosen = gui.add_folder(None)
                self.compare = gui.add_button("Compare model and recordings", color="teal")
            self.ladder = gui.add_html(html.note("Choose a model and recordings, then compare them."))
            self.job = Job(place, self.receive, self.idle)
            with gui.add_folder("What is missing"):
                self.screen = gui.add_button("Score the candidates", hint="how much of the error each could explain")
                self.run = gui.add_button("Let the search go on by itself")
                self.undo = gui.add_button("Take the last step back")
                self.list = gui.add_folder(None)
            with gui.add_folder("What was tried", expand_by_default=True):
                self.log = gui.add_html("")
                self.anyway = gui.add_button("Add what was refused all the same", visible=False)
            with gui.add_folder("Results"):
                self.save = gui.add_button("Write the model (model.yaml)")
                self.report = gui.add_button("Write the whole diagnosis with its report")
                self.written = gui.add_html("")
            with gui.add_folder("The same as a command"):
                self.commands = gui.add_html("")
        self.left = gui.add_panel()
        with self.left.add_tab("Where it fails"):
            self.axis = gui.add_dropdown("Over", tuple(html.AXES))
            self.heat = gui.add_html(html.note("The map comes with the comparison."))
            self.go = gui.add_text("Go to", "", hint="WHAT, RECORDING SECONDS, such as: joint4, 1 2.5")
            self.traces = Traces(place)
            self.pictures = Pictures(place, self._see)
        self.left.dock_left()
        self.left.set_width(370)
        self._wire()
        for path in recordings:
            self.add(path)
        self.idle(True)
        if recordings:
            self.open()

    def add(self, path: Path) -> None:
        """Offers a recording; so far the last one was judged on, now this one is."""
        for other in self.roles.values():
            other.value = ROLES[0] if other.value == ROLES[1] else other.value
        with self.chosen:
            self.roles[path] = self.place.gui.add_dropdown(path.name, ROLES, initial_value=ROLES[1])
        if len(self.roles) == 1:
            self.roles[path].value = ROLES[0]

    def open(self) -> None:
        """Compares the model with the recordings, then scores candidates."""
        fitted, held_out = self._sides()
        if not fitted and not held_out:
            self.job.fail("no recording: drop one on the page Import, or start with `vispeg view RECORDING ..`")
            return
        self.tried, self.standing = [], None
        args = (str(self.model.value), fitted, held_out, self.place.out, self.place.threads)
        self._candidates([])
        self._logged()
        asked = ("show", "screen") if fitted and held_out else ("show",)
        self.job.begin(Study, args, *asked)

    def receive(self, name: str, value: Any) -> None:
        """What the worker tells."""
        if name == "model":
            self.traces.draws(*value)
        elif name == "standing":
            self._stand(value)
        elif name == "candidates":
            self._candidates(value)
        elif name == "tried":
            self.tried.append(value)
        elif name == "pictured":
            self.pictures.show(value)
        elif name == "save done" or name == "report done":
            self.written.content = html.note(f"{value} is written")
        elif name in ("fit done", "undo done") and not (self.standing and self.standing.enough):
            if not self.tried or not self.tried[-1].refused or name == "undo done":
                self.job.ask("screen")
        self._logged()

    def idle(self, idle: bool) -> None:
        """Buttons that would wait for what is running are off."""
        ready = idle and self.standing is not None
        able = ready and self.standing is not None and self.standing.judged
        for button in (self.screen, self.run, self.report, *self.candidates):
            button.disabled = not able
        self.save.disabled = not ready
        self.undo.disabled = not able or self.standing is None or len(self.standing.ladder) < 2
        refused = bool(able and self.tried and self.tried[-1].refused)
        self.anyway.visible = refused and bool(self.last)

    def show(self, visible: bool) -> None:
        """Whether the page is seen."""
        self.root.visible = self.left.visible = visible
        self.traces.show(visible)

    def close(self) -> None:
        """Ends the worker."""
        self.job.end()

    last = ""  # the candidate that was fitted last, by hand

    def _wire(self) -> None:
        self.compare.on_click(lambda _: self.open())
        self.screen.on_click(lambda _: self.job.ask("screen"))
        self.run.on_click(lambda _: self._run())
        self.undo.on_click(lambda _: self.job.ask("undo"))
        self.anyway.on_click(lambda _: self.job.ask("fit", self.last, True))
        self.save.on_click(lambda _: self.job.ask("save", self._file(), False))
        self.report.on_click(lambda _: self.job.ask("report"))
        self.axis.on_update(lambda _: self._map())
        self.go.on_update(lambda _: self._go())
        self.upload.on_upload(lambda _: self._model())

    def _run(self) -> None:
        self.last = ""
        self.job.ask("run")

    def _fit(self, key: str) -> None:
        self.last = key
        self.job.ask("fit", key)

    def _stand(self, standing: Standing) -> None:
        if self.standing is not None and self.standing.effects != standing.effects:
            self._candidates([])  # of another model; new ones are being scored
        self.standing = standing
        self.ladder.content = html.ladder(standing)
        self.traces.take(standing)
        self.pictures.take(standing)
        if standing.maps and tuple(self.axis.options) != tuple(standing.maps):
            self.axis.options = tuple(standing.maps)
            self.axis.value = next(iter(standing.maps))
        self._map()
        self._picture()
        self._commands()

    def _map(self) -> None:
        if self.standing is None or self.axis.value not in self.standing.maps:
            return
        target = self.go._impl.uuid  # the toolkit's id of the text field, which is its element's
        self.heat.content = html.heat(self.standing, self.axis.value, str(self.go.value), target)

    def _go(self) -> None:
        column, comma, when = str(self.go.value).rpartition(",")
        try:
            track, moment = int(when.split()[0]) - 1, float(when.split()[1])
        except (IndexError, ValueError):
            return  # still being typed
        self.traces.go(column, track, moment)
        self._map()
        self._picture()

    def _picture(self) -> None:
        """Asks for the picture at the moment, where pictures are what is compared, or one was asked for before."""
        standing = self.standing
        if standing is not None and (standing.unit == "px" or self.pictures.taken is not None):
            self._see(str(self.pictures.camera.value))

    def _see(self, camera: str) -> None:
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

    def _logged(self) -> None:
        said = [text for text in self.job.said[-LINES:]]
        unit = self.standing.unit if self.standing is not None else "rad"
        self.log.content = html.tried(self.tried[-20:], said[::-1], unit)

    def _sides(self) -> tuple[tuple[Path, ...], tuple[Path, ...]]:
        fitted, held_out = (tuple(p for p, d in self.roles.items() if d.value == role) for role in ROLES[:2])
        return fitted, held_out

    def _file(self) -> Path:
        """A file that is not there yet."""
        names = (self.place.out / f"model{n}.yaml" for n in ("", *range(2, 1000)))
        return next(path for path in names if not path.exists())

    def _model(self) -> None:
        dropped = self.upload.value
        path = self.place.out / "models" / Path(dropped.name).name
        try:
            write_bytes_atomic(path, dropped.content, overwrite=False)
        except Exception as error:
            self.job.fail(str(error))
            return
        self.model.value = str(path)
        self.open()

    def _commands(self) -> None:
        fitted, held_out = self._sides()
        assert self.standing is not None
        model = str(self.model.value)
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
