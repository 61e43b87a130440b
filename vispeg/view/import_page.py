"""The page of logs: drop one, see what its columns are taken for, look at the plot, write the recording."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from vispeg.core.errors import UserError
from vispeg.core.files import write_bytes_atomic
from vispeg.core.provenance import command_line
from vispeg.view import html
from vispeg.view.importing import Importer, Look, Proposed
from vispeg.view.job import Job
from vispeg.view.place import Page, Place

KINDS = (("s", "ms", "us", "ns"), ("rad", "mrad", "deg", "mdeg", "turn"), ("rad/s", "deg/s", "rpm"))
KINDS += (("m", "mm"), ("N m", "Nm", "mNm", "N cm", "kg cm", "N"))
SI = {"q": "rad", "q_cmd": "rad", "dq": "rad/s", "dq_cmd": "rad/s", "tau": "N m", "tau_cmd": "N m"}
COLOURS = ("#1f6fb4", "#d9541e", "#2a9d60", "#a2456b", "#b0892b", "#5b4bb7", "#0a7a75", "#7a5230")
SENSORS = ("not used", "measured at the joint", "from the motor current")
STATED: dict[str, str] = dict(zip(SENSORS, ("none", "joint", "motor"), strict=True))
OTHERS = "table", "joints", "recording"  # keys of a map that are no columns


class ImportPage(Page):
    """From a log to a recording.

    Args:
        place: where it stands.
        logs: files to begin with.
        robot: whose log it is.
        written: called with the folder of each written recording.
    """

    title = "Import"

    def __init__(self, place: Place, logs: Sequence[Path], robot: str, written: Callable[[Path], None]):
        self.place, gui, self.written = place, place.gui, written
        self.proposed: Proposed | None = None
        self.seen: Look | None = None
        self.units: dict[str, Any] = {}
        self.root = gui.add_folder(None)
        with self.root:
            with gui.add_folder("Log"):
                self.upload = gui.add_upload_button("Drop a log (CSV, Parquet, NPZ, bag)")
                self.log = gui.add_text("Log", str(logs[0]) if logs else "", hint="a file, or a ROS 2 bag's folder")
                self.robot = gui.add_text("Robot", robot, hint="a robot's name, or a path to an MJCF or URDF")
                self.propose = gui.add_button("Propose what the columns are", color="teal")
            self.job = Job(place, self.receive, self.idle)
            with gui.add_folder("Units"):
                self.chosen = gui.add_folder(None)
                self.sensor = gui.add_dropdown("Torque is", SENSORS, initial_value=SENSORS[0], visible=False)
                self.doubts = gui.add_html(html.note("Units come with the proposal."))
            with gui.add_folder("Recording"):
                self.name = gui.add_text("Name", "rig-1")
                self.write = gui.add_button("Confirm and write the recording")
                self.done = gui.add_html("")
            with gui.add_folder("The same as a command"):
                self.commands = gui.add_html("")
        self.left = gui.add_panel()
        with self.left.add_tab("What is in the log"):
            self.signal = gui.add_dropdown("Signal", ("q",), initial_value="q")
            self.plots = gui.add_folder(None)
            self.table = gui.add_html(html.note("Columns, units and the reasons for them come here."))
        self.left.dock_left()
        self.left.set_width(370)
        self.plot: Any = None
        self.upload.on_upload(lambda _: self._dropped())
        self.propose.on_click(lambda _: self.begin())
        self.sensor.on_update(lambda _: self._again())
        self.signal.on_update(lambda _: self._plotted())
        self.write.on_click(lambda _: self._write())
        self.idle(True)
        if logs:
            self.begin()

    def begin(self) -> None:
        """Proposes a map for the log that is named."""
        path = Path(str(self.log.value))
        self.proposed = self.seen = None
        stem = path.name.partition(".")[0] or "rig-1"
        self.name.value = stem
        if self.job.start is None:
            self.job.begin(Importer, ())
        self.job.ask("propose", path, str(self.robot.value))

    def receive(self, name: str, value: Any) -> None:
        """What the worker tells."""
        if name == "proposed":
            self.proposed = value
            self._unit_choices(value)
            self.table.content = html.columns(value)
            self._commands()
        elif name == "look":
            self.seen = value
            self.doubts.content = html.doubts(value)
            signals = tuple(value.signals)
            if tuple(self.signal.options) != signals:
                self.signal.options = signals
            self._plotted()
        elif name == "write done":
            self.done.content = html.note(f"{value} is written")
            self.written(Path(value))

    def idle(self, idle: bool) -> None:
        """Only what was looked at can be written."""
        self.propose.disabled = not idle
        self.write.disabled = not idle or self.seen is None

    def show(self, visible: bool) -> None:
        """Whether the page is seen."""
        self.root.visible = self.left.visible = visible

    def close(self) -> None:
        """Ends the worker."""
        self.job.end()

    def _dropped(self) -> None:
        dropped = self.upload.value
        path = self.place.out / "logs" / Path(dropped.name).name
        try:
            write_bytes_atomic(path, dropped.content, overwrite=path.is_file() and path.read_bytes() == dropped.content)
        except UserError as error:
            self.job.fail(str(error))
            return
        self.log.value = str(path)
        self.begin()

    def _unit_choices(self, proposed: Proposed) -> None:
        for old in self.units.values():
            old.remove()
        self.units = {}
        with self.chosen:
            for signal, unit in proposed.units.items():
                kinds = next(kind for kind in KINDS if unit in kind)
                choice = self.place.gui.add_dropdown(signal, kinds, initial_value=unit)
                choice.on_update(lambda _: self._again())
                self.units[signal] = choice
        self.sensor.visible = "tau" in proposed.units

    def _columns(self) -> dict[str, Any]:
        """The proposed map with the units that are chosen."""
        columns: dict[str, Any] = dict(self.proposed.data) if self.proposed is not None else {}
        for target, value in columns.items():
            signal = target.partition(".")[0]
            if target not in OTHERS and signal in self.units:
                columns[target] = {**value, "unit": str(self.units[signal].value)}
        if self.sensor.visible:
            columns["recording"] = {**columns.get("recording", {}), "torque_sensor": STATED[str(self.sensor.value)]}
        return columns

    def _again(self) -> None:
        self.job.ask("look", Path(str(self.log.value)), str(self.robot.value), self._columns())

    def _write(self) -> None:
        out = self.place.out / "recordings" / Path(str(self.name.value)).name
        self._commands()
        self.job.ask("write", Path(str(self.log.value)), str(self.robot.value), self._columns(), out)

    def _plotted(self) -> None:
        look = self.seen
        if look is None or self.signal.value not in look.signals:
            return
        if self.plot is not None:
            self.plot.remove()
        values = look.signals[self.signal.value].astype(float)
        names = look.joints if values.shape[1] == len(look.joints) else [f"{i + 1}" for i in range(values.shape[1])]
        pen = {"width": 1.2, "points": {"show": False}}
        series = [{"label": n, "stroke": COLOURS[i % len(COLOURS)], **pen} for i, n in enumerate(names)]
        finite = np.isfinite(values).all(axis=1)
        unit = SI.get(str(self.signal.value), "")
        with self.plots:
            self.plot = self.place.gui.add_uplot(
                (look.time[finite].astype(float), *(v for v in values[finite].T)),
                ({"label": "s"}, *series),
                title=f"{self.signal.value}, {unit}, as it would be written",
                scales={"x": {"time": False}},
                axes=({"label": "s", "size": 40, "labelSize": 14}, {"size": 55}),
                height=260,
            )

    def _commands(self) -> None:
        out = self.place.out / "recordings" / Path(str(self.name.value)).name
        words = ["convert", str(self.log.value), "--robot", str(self.robot.value)]
        words += ["--map", f"{out}-map.yaml"] if self.proposed is not None and self.proposed.data else []
        self.commands.content = html.commands([command_line(["vispeg", *words, "--out", str(out)])])
