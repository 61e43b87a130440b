"""The import page: drop a log, check the proposed meaning of its columns and the plot, write the recording."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.provenance import command_line
from vispeg.recordings.columns import SPATIAL_SIGNALS
from vispeg.recordings.importers.mapping import QUANTITIES
from vispeg.recordings.importers.rosbag import Topics
from vispeg.view import html
from vispeg.view.around import TABLES, named
from vispeg.view.drop import Drop
from vispeg.view.importing import SENSOR_WORDS, Importer, Look, Proposed, map_file
from vispeg.view.job import Job
from vispeg.view.pen import pen
from vispeg.view.place import Page, Place

UNITS = {"q": "rad", "q_cmd": "rad", "dq": "rad/s", "dq_cmd": "rad/s", "tau": "N m", "tau_cmd": "N m"}
UNITS |= {"ee": "m and quaternion", "ee_cmd": "m and quaternion", "ft": "N and N m"}  # a load's unit is not known
COLOURS = ("#1f6fb4", "#d9541e", "#2a9d60", "#a2456b", "#b0892b", "#5b4bb7", "#0a7a75", "#7a5230")
SENSORS = {words: value for value, words in SENSOR_WORDS.items()}
OTHERS = "table", "joints", "recording"  # keys of a map that do not name columns
UNKNOWN, NONE = "not known", "none"
MODES = {UNKNOWN: "unknown", "holds angles (q_cmd)": "position", "applies torques (tau_cmd)": "torque"}
MODES |= {"is a servo of unknown gains (q_cmd)": "servo"}
GRAVITY = {"by the model": "model", "not at all": "none"}
HEAD = "A log becomes a recording"
NO_UNITS, NO_COLUMNS = "Units come with the proposal.", "Columns, units and the reasons for them come here."
NEXT = "Drop a log, or choose one that is there. Its columns and units are proposed, with the reason for each."


class ImportPage(Page):
    """Turn a log into a recording.

    Args:
        place: what all pages share: server, folder of results, 3D view.
        logs: files to offer; the first one is opened.
        model: the model of the logged robot, in any form that `vispeg diagnose` accepts.
        written: called with the folder of each written recording.
    """

    title = "Import"

    def __init__(self, place: Place, logs: Sequence[Path], model: str, written: Callable[[Path], None]):
        self.place, gui, self.written = place, place.gui, written
        self.proposed: Proposed | None = None
        self.preview: Look | None = None
        self.asked = Path(), ""  # the log and the model of the proposal
        self.logs = logs
        self.units: dict[str, Any] = {}  # signal -> list of the units that it may have
        self.found: dict[str, Path] = {}  # label -> log that was named at the start or is in the working folder
        self.filling = False  # whether fields are being set to proposed values: then their updates ask for no preview
        self.root = gui.add_folder(None)
        with self.root:
            self.guide = gui.add_html(html.next_step(HEAD, NEXT))
            with gui.add_folder("Log"):
                self.drop = Drop(place, "Drop a log", "CSV, Parquet, NPZ or bag", TABLES, self.take, self._failed)
                self.found_list = gui.add_dropdown("Found here", (NONE,))
                self.log = gui.add_text("Path", str(logs[0]) if logs else "", hint="a file, or a ROS 2 bag's folder")
                self.model = gui.add_text("Model", model, hint="a robot's name, a model file, an MJCF or a URDF")
                self.propose = gui.add_button("Propose what the columns are", color="teal")
            self.job = Job(place, self.receive, self.idle)
            with gui.add_folder("Units"):
                self.unit_lists = gui.add_folder(None)
                self.topic = gui.add_dropdown("Measured on", (NONE,), visible=False)
                self.command = gui.add_dropdown("Commands on", (NONE,), visible=False)
                self.sensor = gui.add_dropdown(
                    "Torque is", tuple(SENSORS), initial_value=SENSOR_WORDS["none"], visible=False
                )
                self.doubts = gui.add_html(html.note(NO_UNITS))
            self.controller = gui.add_folder("Controller", visible=False)
            with self.controller:
                self.mode = gui.add_dropdown("It", tuple(MODES), initial_value=UNKNOWN)
                self.kp = gui.add_text("Stiffness", "", hint="N m/rad: one number, or one a joint, with commas")
                self.kd = gui.add_text("Damping", "", hint="N m s/rad: one number, or one a joint, with commas")
                self.gravity = gui.add_dropdown("Gravity made up", tuple(GRAVITY))
            with gui.add_folder("Recording"):
                self.name = gui.add_text("Name", "rig-1")
                self.write = gui.add_button("Confirm and write the recording", color="teal")
                self.written_note = gui.add_html("")
            self.command_folder = gui.add_folder("The same as a command", visible=False)
            with self.command_folder:
                self.commands = gui.add_html("")
        self.panel = gui.add_panel()
        with self.panel.add_tab("What is in the log"):
            self.signal = gui.add_dropdown("Signal", ("q",), initial_value="q")
            self.plots = gui.add_folder(None)
            self.table = gui.add_html(html.note(NO_COLUMNS))
        place.beside(self.panel)
        self.plot: Any = None
        self._wire()
        self._show_gains()
        self.idle(True)
        if logs:
            self.begin()

    def take(self, log: Path, model: str | None = None) -> None:
        """Open a dropped or chosen log and propose its map."""
        self.log.value = str(log)
        if model is not None:
            self.model.value = model
        self.begin()

    def begin(self) -> None:
        """Propose a map for the log in the path field."""
        if self.job.busy or self.job.start is None:  # a busy worker would first send what it found in another log
            self.job.begin(Importer, ())
        self.asked = path, model = self._source()
        self.proposed = self.preview = None
        # nothing of a former log may stay: this one may not be readable
        self._offer(Proposed((), {}, {}, ()))
        self.doubts.content, self.table.content = html.note(NO_UNITS), html.note(NO_COLUMNS)
        self.sensor.visible = self.controller.visible = False
        self.guide.content = html.next_step(HEAD, NEXT)
        self._plot()
        self.name.value = path.name.partition(".")[0] or "rig-1"
        self.job.ask("propose", path, model)

    def receive(self, name: str, value: Any) -> None:
        """Handle a message (name, value) from the worker."""
        if name == "proposed":
            self.proposed = value
            self._offer(value)
            self.table.content = html.columns(value)
            self._commands()
        elif name == "look":
            self.preview = value
            self.doubts.content = html.doubts(value)
            self.guide.content = html.next_step(HEAD, self._next())
            self._commands()
            self.sensor.visible = "tau" in value.signals
            self.controller.visible = bool({"q_cmd", "tau_cmd"} & set(value.signals))
            signals = tuple(value.signals)
            if tuple(self.signal.options) != signals:
                self.signal.options = signals
            self._plot()
        elif name == "write done":
            self.written_note.content = html.note(f"{value} is written")
            self._label_write()
            self.written(Path(value))

    def idle(self, idle: bool) -> None:
        """Enable the buttons; a recording can be written only after the preview of this log with this model."""
        self.propose.disabled = not idle
        self.write.disabled = not idle or self.preview is None or self.asked != self._source()

    def show(self, visible: bool) -> None:
        """Show or hide the page, and offer what is in the working folder now."""
        self.root.visible = self.panel.visible = visible
        if visible:
            self.found = named([*self.logs, *self.place.around().of("log")], Path.cwd())
            self.found_list.options = (NONE, *self.found)
            self.found_list.visible = bool(self.found)

    def close(self) -> None:
        """End the worker."""
        self.job.end()

    def columns(self) -> dict[str, Any]:
        """Return the proposed map, with the page's choices in place of the proposed values.

        Raises:
            UserError: gains that are not numbers.
        """
        columns: dict[str, Any] = dict(self.proposed.data) if self.proposed is not None else {}
        for target, value in columns.items():
            signal = target.partition(".")[0]
            if target not in OTHERS and signal in self.units and isinstance(value, dict) and "unit" in value:
                columns[target] = {**value, "unit": str(self.units[signal].value)}
        recording = {key: v for key, v in dict(columns.get("recording", {})).items() if key != "control"}
        sensor = SENSORS[str(self.sensor.value)]
        if sensor != recording.get("torque_sensor", "none"):
            recording["torque_sensor"] = sensor
        if (control := self._control()) is not None:
            recording["control"] = control
        return columns | ({"recording": recording} if recording else {})

    def _wire(self) -> None:
        self.found_list.on_update(lambda _: self._take_found())
        self.propose.on_click(lambda _: self.begin())
        for field in (self.log, self.model):
            field.on_update(lambda _: self.idle(not self.job.busy))
        for choice in (self.sensor, self.topic, self.command):
            choice.on_update(lambda _: self._request_preview())
        self.mode.on_update(lambda _: self._show_gains())
        self.name.on_update(lambda _: self._label_write())
        self.signal.on_update(lambda _: self._plot())
        self.write.on_click(lambda _: self._write())

    def _failed(self, text: str) -> None:
        self.job.fail(text)

    def _source(self) -> tuple[Path, str]:
        """Return the log and the model in the fields."""
        return Path(str(self.log.value)), str(self.model.value)

    def _take_found(self) -> None:
        path = self.found.get(str(self.found_list.value))
        if path is not None:
            self.take(path)

    def _offer(self, proposed: Proposed) -> None:
        """Show a proposal's choices, set to the proposed values."""
        self.filling = True
        for old in self.units.values():
            old.remove()
        self.units = {}
        with self.unit_lists:
            for signal, unit in proposed.units.items():
                kinds = next(tuple(quantity) for quantity in QUANTITIES if unit in quantity)
                choice = self.place.gui.add_dropdown(signal, kinds, initial_value=unit)
                choice.on_update(lambda _: self._request_preview())
                self.units[signal] = choice
        self.sensor.value = SENSOR_WORDS[str(dict(proposed.data.get("recording", {})).get("torque_sensor", "none"))]
        self.topic.options = proposed.topics or (NONE,)
        self.command.options = (NONE, *proposed.topics)
        self.topic.visible = self.command.visible = len(proposed.topics) > 1
        mode = dict(dict(proposed.data.get("recording", {})).get("control", {})).get("mode", "unknown")
        self.mode.value = next(words for words, value in MODES.items() if value == mode)
        self.filling = False
        self._label_write()

    def _topics(self) -> Topics | None:
        if self.proposed is None or not self.proposed.topics:
            return None
        command = str(self.command.value)
        return Topics(str(self.topic.value), None if command == NONE else command)

    def _next(self) -> str:
        """Return the next thing to do, as a sentence."""
        look = self.preview
        if look is None:
            return NEXT
        if look.doubts:
            return "Something cannot be true: put the units right."
        if "tau" in look.signals and SENSORS[str(self.sensor.value)] == "none" and self._mode() == "unknown":
            return "State what `Torque is`: without it, or the controller, nothing can be compared. Then confirm."
        return "Look at the plot and the units, then confirm: the page Diagnose opens with the recording."

    def _mode(self) -> str:
        return MODES[str(self.mode.value)]

    def _show_gains(self) -> None:
        """Show the fields that the chosen controller has."""
        self.kp.visible = self.kd.visible = self._mode() == "position"
        self.gravity.visible = self._mode() not in ("unknown", "servo")
        if self.preview is not None:
            self.guide.content = html.next_step(HEAD, self._next())

    def _control(self) -> dict[str, Any] | None:
        """Return the stated controller; None if unknown. Raises UserError: gains that are not numbers."""
        if self._mode() == "servo":
            return {"mode": "servo"}
        if self._mode() == "unknown" or self.preview is None or not self.controller.visible:
            return None
        out: dict[str, Any] = {"mode": self._mode(), "rate_hz": self.preview.rate_hz}
        out["gravity_compensation"] = GRAVITY[str(self.gravity.value)]
        if self._mode() == "position":
            out |= {"kp": self._gains(self.kp, "Stiffness"), "kd": self._gains(self.kd, "Damping")}
        return out

    def _gains(self, field: Any, name: str) -> list[float]:
        assert self.preview is not None
        words, joints = str(field.value).replace(",", " ").split(), len(self.preview.joints)
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            numbers = []
        if len(numbers) not in (1, joints) or not all(np.isfinite(n) and n >= 0 for n in numbers):
            raise UserError("no gains", key=name, expected=f"one number, or {joints} with commas", got=str(field.value))
        return numbers * (joints if len(numbers) == 1 else 1)

    def _request_preview(self) -> None:
        """Request a preview with the page's present choices."""
        if self.filling or self.proposed is None:
            return
        try:
            self.job.ask("look", *self.asked, self.columns(), self._topics())
        except UserError as error:
            self.job.fail(str(error))

    def _out(self) -> Path:
        return self.place.out / "recordings" / (Path(str(self.name.value)).name or "rig-1")

    def _replaces(self) -> bool:
        return self._out().exists() or map_file(self._out()).exists()

    def _label_write(self) -> None:
        """Label the write button: it says whether a recording would be replaced."""
        new, old = "Confirm and write the recording", f"Confirm and replace {self._out().name}"
        self.write.label = old if self._replaces() else new
        self._commands()

    def _write(self) -> None:
        self._commands()
        words = str(self.write.label)
        self._label_write()
        if str(self.write.label) != words:  # a recording of this name has appeared: first the button must say so
            return
        try:
            columns = self.columns()
        except UserError as error:
            self.job.fail(str(error))
            return
        self.job.ask("write", *self.asked, columns, self._out(), self._replaces(), self._topics())

    def _plot(self) -> None:
        """Plot the chosen signal of the preview, or nothing."""
        if self.plot is not None:
            self.plot.remove()
            self.plot = None
        look, signal = self.preview, str(self.signal.value)
        if look is None or signal not in look.signals:
            return
        values, names = look.signals[signal].astype(float), SPATIAL_SIGNALS.get(signal, look.joints)
        finite = np.isfinite(values).all(axis=1)
        time = look.time[finite].astype(float)
        pens = (pen(time, colour, 1.2) for colour in itertools.cycle(COLOURS))
        series = [{"label": name, **how} for name, how in zip(html.distinct(names), pens, strict=False)]
        with self.plots:
            self.plot = self.place.gui.add_uplot(
                (time, *values[finite].T),
                ({"label": "s"}, *series),
                title=", ".join(filter(None, (signal, UNITS.get(signal), "as it would be written"))),
                scales={"x": {"time": False}},
                axes=({"label": "s", "size": 40, "labelSize": 14}, {"size": 55}),
                height=260,
            )

    def _commands(self) -> None:
        self.command_folder.visible = self.proposed is not None
        if self.proposed is None:
            return
        try:
            mapped = bool(self.columns())
        except UserError:
            return  # still being typed
        words = ["convert", str(self.asked[0]), "--robot", self.proposed.robot, "--table", "parquet"]
        words += ["--map", str(map_file(self._out()))] if mapped else []
        topics = self._topics()
        words += ["--topic", str(topics.joints)] if topics is not None else []
        words += ["--command-topic", topics.command] if topics is not None and topics.command is not None else []
        words += ["--insist"] if self.preview is not None and self.preview.doubts else []
        words += ["--out", str(self._out())] + (["--overwrite"] if self._replaces() else [])
        self.commands.content = html.commands([command_line(["vispeg", *words])])
