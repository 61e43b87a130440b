"""One moment of a recording: curves of a joint, a time slider, and the arm in 3D with the model's error enlarged."""

from __future__ import annotations

import threading
import time
from typing import Any

import mujoco
import numpy as np

from vispeg.report.text.quantities import prefix
from vispeg.robots.furniture import COLOURS
from vispeg.view.diagnose.standing import Standing, Track
from vispeg.view.drawing import Drawing, Look
from vispeg.view.pen import pen
from vispeg.view.place import ARM, CELL, Place

MEASURED, FIRST, NOW, GHOST = "#868e96", "#d9541e", "#0a7a75", (224, 108, 48)
AXES = ("#d9541e", "#2a9d60", "#1f6fb4")
FRAMES = 25.0  # frames per second during playback


class Traces:
    """Add curves of measured and predicted values, with the arm at the chosen moment, to the part being built."""

    def __init__(self, place: Place):
        gui = place.gui
        self.place, self.standing, self.playing = place, None, False
        self.visible, self.view, self.arm_visible = True, ARM, True
        self.arm: Drawing | None = None
        self.ghost: Drawing | None = None
        self.lock = threading.Lock()  # the user's model and the worker's may arrive at once
        self.ground = place.server.scene.add_grid("/floor", width=4.0, height=4.0, cell_size=0.1, section_size=1.0)
        self.column = gui.add_dropdown("Of", ("joint",))
        self.track = gui.add_dropdown("Recording", ("none",))
        self.values: Any = None
        self.errors: Any = None
        self.forces: Any = None
        self.plots = gui.add_folder(None)
        self.slider = gui.add_slider("Moment (s)", 0.0, 1.0, 0.001, 0.0)
        self.play = gui.add_button("Play")
        self.times = gui.add_slider("Error shown ×", 1, 500, 1, 50)
        self.column.on_update(lambda _: self.draw())
        self.track.on_update(lambda _: self.draw())
        self.slider.on_update(lambda _: self.pose())
        self.times.on_update(lambda _: self.pose())
        self.play.on_click(lambda _: self._toggle())

    def take(self, standing: Standing) -> None:
        """Show the state of a diagnosis; keep the chosen joint and moment if they still exist."""
        self.standing = standing
        self.times.visible = _enlarged(standing)
        if self.ghost is None and self.arm is not None and _enlarged(standing):
            self.ghost = Drawing(self.place.server.scene, "/model", self.arm.model, Look(GHOST, 0.35))
        self.show(self.visible)
        names = tuple(f"{i + 1}: {t.name}" for i, t in enumerate(standing.tracks))
        if tuple(self.track.options) != names:
            self.track.options = names
        if tuple(self.column.options) != standing.columns:
            self.column.options = standing.columns
            self.times.value = self._enlargement()
            self.go(*self._worst())
        self.draw()

    def go(self, column: str, track: int, moment: float) -> None:
        """Show a column of a track (counted from 0) at a moment (s)."""
        if self.standing is None or column not in self.standing.columns or track >= len(self.standing.tracks):
            return
        self.track.value = self.track.options[track]
        self.column.value = column
        self.draw()
        self.slider.value = float(np.clip(moment, self.slider.min, self.slider.max))
        self.pose()

    def show(self, visible: bool) -> None:
        """Show or hide the enlarged error."""
        self.visible, self.playing = visible, self.playing and visible
        if self.ghost is not None:
            self.ghost.show(visible and self.standing is not None and _enlarged(self.standing))

    def stand(self, visible: bool) -> None:
        """Show or hide the arm in the 3D view, and look at it when it appears.

        Pages that draw nothing of their own show it too.
        """
        if visible and not self.arm_visible:
            self.place.look(self.view)
        self.ground.visible = visible
        if self.arm is not None:
            self.arm.show(visible)
        self.arm_visible = visible

    def forget(self) -> None:
        """Drop the comparison; the arm stays."""
        with self.lock:
            self.standing, self.playing = None, False
            if self.ghost is not None:
                self.ghost.remove()
                self.ghost = None

    def draw(self) -> None:
        """Draw the curves of the chosen column and track."""
        standing = self.standing
        if standing is None or self.column.value not in standing.columns:
            return  # the choices are being changed
        track, j = self._track(), standing.columns.index(str(self.column.value))
        lines = [v[:, j].astype(float) for v in (track.measured, track.first, track.now) if v is not None]
        there = np.isfinite(lines).all(axis=0)
        if there.sum() < 2:
            return
        time, lines = track.time[there].astype(float), [v[there] for v in lines]
        self.slider.min, self.slider.max = float(time[0]), float(time[-1])
        self.slider.value = float(np.clip(self.slider.value, time[0], time[-1]))
        gap = lines if track.measured is None else [lines[0] - v for v in lines[1:]]
        factor, unit = prefix(_size(gap[0]), standing.units[j])
        angle, name = (180 / np.pi, "degrees") if standing.units[j] == "rad" else (1.0, standing.units[j])
        colours = (MEASURED, FIRST, NOW)
        names = ("measured", "given model", "model now")
        with self.place.server.atomic():
            if track.measured is not None:
                values = [angle * v for v in lines]
                self.values = self._plot(self.values, time, values, names, colours, name)
            elif self.values is not None:
                self.values.remove()
                self.values = None
            gaps = [factor * g for g in gap]
            self.errors = self._plot(self.errors, time, gaps, names[1:], colours[1:], f"error, {unit}")
            self._wrench(track)
        self.pose()

    def pose(self) -> None:
        """Pose the arm as measured at the slider's time, and a second arm with the model's error enlarged."""
        if self.standing is None or self.arm is None:
            return
        track = self._track()
        k = int(np.argmin(np.abs(track.time - self.slider.value)))
        q = track.posture[k].astype(float)
        with self.place.server.atomic():
            self.arm.pose(self._full(self.arm, q))
            if track.measured is not None and self.ghost is not None and _enlarged(self.standing):
                error = np.nan_to_num(track.now[k] - track.measured[k]).astype(float)
                self.ghost.pose(self._full(self.ghost, q + float(self.times.value) * error))

    def _full(self, drawing: Drawing, q: np.ndarray) -> np.ndarray:
        """Return the configuration (nq,) of a drawing with the joint angles `q` (nj,), rad."""
        qpos = drawing.model.qpos0.copy()
        assert self.standing is not None
        for name, value in zip(self.standing.joints, q, strict=True):
            qpos[drawing.model.joint(name).qposadr[0]] = value
        return qpos

    def draws(self, model: mujoco.MjModel, cell: bool) -> None:
        """Draw another arm, or an arm in its cell if `cell`."""
        with self.lock:
            self._drawn(model, cell)

    def _drawn(self, model: mujoco.MjModel, cell: bool) -> None:
        for drawing in (self.arm, self.ghost):
            if drawing is not None:
                drawing.remove()
        scene = self.place.server.scene
        self.view = CELL if cell else ARM
        colours = {name: (c[0], c[1], c[2]) for name, c in COLOURS.items()} if cell else {}
        self.ghost, self.arm = None, Drawing(scene, "/arm", model, colours=colours)
        self.arm.show(self.arm_visible)
        if self.arm_visible:
            self.place.look(self.view)

    @property
    def number(self) -> int:
        """Number of the shown track, counted from 0."""
        names = list(self.track.options)
        return names.index(self.track.value) if self.track.value in names else 0

    def _track(self) -> Track:
        assert self.standing is not None
        return self.standing.tracks[self.number]

    def _worst(self) -> tuple[str, int, float]:
        """Return the column, track and time (s) with the largest error; time 0 of the first track without maps."""
        assert self.standing is not None
        standing = self.standing
        if standing.maps:
            field = next(iter(standing.maps.values()))
            worst = np.where(np.isfinite(field.moment[..., 0]), np.nan_to_num(field.now), -1.0)
            j, i = np.unravel_index(int(np.argmax(worst)), worst.shape)
            return standing.columns[j], int(field.moment[j, i, 0]), float(field.moment[j, i, 1])
        square = sum(np.nansum(_error(t) ** 2, axis=0) for t in standing.tracks)
        return standing.columns[int(np.argmax(square))], 0, 0.0

    def _enlargement(self) -> int:
        """Return the factor by which to enlarge the error, so that its largest value turns a joint by 0.3 rad."""
        assert self.standing is not None
        most = max(_size(_error(t)) for t in self.standing.tracks)
        return int(np.clip(0.3 / max(most, 1e-9), self.times.min, self.times.max))

    def _plot(
        self,
        plot: Any,
        time: np.ndarray,
        lines: list[np.ndarray],
        names: tuple[str, ...],
        colours: tuple[str, ...],
        label: str,
        of: str | None = None,
    ) -> Any:
        data = (time, *(np.asarray(v, float) for v in lines))
        if plot is not None:
            plot.remove()
        series = [{"label": n, **pen(time, c, 1.4)} for n, c in zip(names, colours, strict=True)]
        with self.plots:
            return self.place.gui.add_uplot(
                data,
                ({"label": "s"}, *series),
                title=f"{self.column.value}: {label}" if of is None else label,
                scales={"x": {"time": False}},
                axes=({"label": "s", "size": 40, "labelSize": 14}, {"size": 55}),
                cursor={"sync": {"key": "moment"}, "drag": {"x": True, "y": False}},
                height=190,
            )

    def _wrench(self, track: Track) -> None:
        """Draw the measured force at the wrist; remove the plot if there is none."""
        if track.wrench is None:
            if self.forces is not None:
                self.forces.remove()
            self.forces = None
            return
        there = np.isfinite(track.wrench).all(axis=1)
        lines = [track.wrench[there, k].astype(float) for k in range(3)]
        time = track.time[there].astype(float)
        self.forces = self._plot(self.forces, time, lines, ("x", "y", "z"), AXES, "force at the wrist, N", "")

    def _toggle(self) -> None:
        self.playing = not self.playing
        self.play.label = "Pause" if self.playing else "Play"
        if self.playing:
            threading.Thread(target=self._run, daemon=True).start()

    def _run(self) -> None:
        while self.playing:
            later = float(self.slider.value) + 1.0 / FRAMES
            self.slider.value = later if later <= self.slider.max else float(self.slider.min)
            self.pose()
            time.sleep(1.0 / FRAMES)
        self.play.label = "Play"


def _error(track: Track) -> np.ndarray:
    """Return the error (n, columns) of the given model."""
    return track.first if track.measured is None else track.measured - track.first


def _enlarged(standing: Standing) -> bool:
    """Return whether a second arm shows the model's error: only if errors are angles."""
    return standing.unit == "rad"


def _size(values: np.ndarray) -> float:
    """Return the largest absolute value; 0 without finite values."""
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max()) if finite.size else 0.0
