"""The moment on the page: traces of a joint, a slider over time, and the arm in 3D with the model's error enlarged."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from vispeg.report.quantities import prefix
from vispeg.robots.model import load
from vispeg.sim.compiled import compiled
from vispeg.view.drawing import Drawing, Look
from vispeg.view.place import Place
from vispeg.view.standing import Standing, Track

MEASURED, FIRST, NOW, GHOST = "#868e96", "#d9541e", "#0a7a75", (224, 108, 48)
AXES = ("#d9541e", "#2a9d60", "#1f6fb4")
FRAMES = 25.0  # a second, while it plays


class Traces:
    """Elements are added where the page's are being added."""

    def __init__(self, place: Place):
        gui = place.gui
        self.place, self.standing, self.playing = place, None, False
        self.visible = True
        self.arm: Drawing | None = None
        self.ghost: Drawing | None = None
        self.at = 0, 0
        self.ground = place.server.scene.add_grid("/floor", width=4.0, height=4.0, cell_size=0.1, section_size=1.0)
        self.joint = gui.add_dropdown("Joint", ("joint",))
        self.track = gui.add_dropdown("Recording", ("none",))
        self.values: Any = None
        self.errors: Any = None
        self.forces: Any = None
        self.plots = gui.add_folder(None)
        self.slider = gui.add_slider("Moment (s)", 0.0, 1.0, 0.001, 0.0)
        self.play = gui.add_button("Play")
        self.times = gui.add_slider("Error shown ×", 1, 500, 1, 50)
        self.joint.on_update(lambda _: self.draw())
        self.track.on_update(lambda _: self.draw())
        self.slider.on_update(lambda _: self.pose())
        self.times.on_update(lambda _: self.pose())
        self.play.on_click(lambda _: self._toggle())

    def take(self, standing: Standing) -> None:
        """Shows another standing, at the same joint and moment where it has them."""
        new = self.standing is None or self.standing.robot != standing.robot
        self.standing = standing
        if new or self.arm is None:
            self._arm(standing)
        names = tuple(f"{i + 1}: {t.name}" for i, t in enumerate(standing.tracks))
        if tuple(self.joint.options) != standing.joints:
            self.joint.options = standing.joints
            self.joint.value = standing.joints[self._worst()]
            self.times.value = self._enlargement()
        if tuple(self.track.options) != names:
            self.track.options = names
        self.draw()

    def go(self, joint: str, track: int, moment: float) -> None:
        """Shows a joint of a track (0, 1, ..) at a moment, s."""
        if self.standing is None or joint not in self.standing.joints or track >= len(self.standing.tracks):
            return
        self.track.value = self.track.options[track]
        self.joint.value = joint
        self.draw()
        self.slider.value = float(np.clip(moment, self.slider.min, self.slider.max))
        self.pose()

    def show(self, visible: bool) -> None:
        """Whether the arm can be seen."""
        self.visible, self.playing = visible, self.playing and visible
        self.ground.visible = visible
        for drawing in (self.arm, self.ghost):
            if drawing is not None:
                drawing.show(visible)

    def draw(self) -> None:
        """Draws the traces anew."""
        standing = self.standing
        if standing is None:
            return
        track, j = self._track(), standing.joints.index(str(self.joint.value))
        there = np.isfinite(track.measured[:, j]) & np.isfinite(track.now[:, j]) & np.isfinite(track.first[:, j])
        if there.sum() < 2:
            return
        time, measured, first, now = (v[there].astype(float) for v in (track.time, *(a[:, j] for a in _lines(track))))
        self.slider.min, self.slider.max = float(time[0]), float(time[-1])
        self.slider.value = float(np.clip(self.slider.value, time[0], time[-1]))
        gap = [measured - first, measured - now]
        factor, unit = prefix(_size(gap[0]), standing.unit)
        angle, name = (180 / np.pi, "degrees") if standing.unit == "rad" else (1.0, standing.unit)
        colours = (MEASURED, FIRST, NOW)
        known = [angle * v for v in (measured, first, now)]
        names = ("measured", "given model", "model now")
        with self.place.server.atomic():
            self.values = self._plot(self.values, time, known, names, colours, name)
            gaps = [factor * g for g in gap]
            self.errors = self._plot(self.errors, time, gaps, names[1:], colours[1:], f"error, {unit}")
            self._wrench(track)
        self.pose()

    def pose(self) -> None:
        """Poses the arm as measured at the slider's moment, and beside it with the model's error enlarged."""
        if self.standing is None or self.arm is None or self.ghost is None:
            return
        track = self._track()
        k = int(np.argmin(np.abs(track.time - self.slider.value)))
        q = track.posture[k].astype(float)
        error = np.nan_to_num(track.now[k] - track.measured[k]).astype(float)
        enlarged = self.standing.unit == "rad"
        with self.place.server.atomic():
            self.arm.pose(self._full(self.arm, q))
            self.ghost.pose(self._full(self.ghost, q + float(self.times.value) * error if enlarged else q))

    def _full(self, drawing: Drawing, q: np.ndarray) -> np.ndarray:
        qpos = drawing.model.qpos0.copy()
        assert self.standing is not None
        for name, value in zip(self.standing.joints, q, strict=True):
            qpos[drawing.model.joint(name).qposadr[0]] = value
        return qpos

    def _arm(self, standing: Standing) -> None:
        for drawing in (self.arm, self.ghost):
            if drawing is not None:
                drawing.remove()
        model = compiled(load(standing.robot, tool=standing.tool))  # type: ignore[arg-type]
        scene = self.place.server.scene
        self.arm = Drawing(scene, "/arm", model)
        self.ghost = Drawing(scene, "/model", model, Look(GHOST, 0.35))
        self.show(self.visible)

    @property
    def number(self) -> int:
        """Of the track that is shown."""
        names = list(self.track.options)
        return names.index(self.track.value) if self.track.value in names else 0

    def _track(self) -> Track:
        assert self.standing is not None
        return self.standing.tracks[self.number]

    def _worst(self) -> int:
        assert self.standing is not None
        square = sum(np.nansum((t.measured - t.first) ** 2, axis=0) for t in self.standing.tracks)
        return int(np.argmax(square))

    def _enlargement(self) -> int:
        """How many times the error must be shown to be seen: its greatest then turns a joint by 0.3 rad."""
        assert self.standing is not None
        most = max(_size(t.measured - t.first) for t in self.standing.tracks)
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
        pen = {"width": 1.4, "points": {"show": False}}
        series = [{"label": n, "stroke": c, **pen} for n, c in zip(names, colours, strict=True)]
        with self.plots:
            return self.place.gui.add_uplot(
                data,
                ({"label": "s"}, *series),
                title=f"{self.joint.value}: {label}" if of is None else label,
                scales={"x": {"time": False}},
                axes=({"label": "s", "size": 40, "labelSize": 14}, {"size": 55}),
                cursor={"sync": {"key": "moment"}, "drag": {"x": True, "y": False}},
                height=190,
            )

    def _wrench(self, track: Track) -> None:
        """The forces that were measured, where there are some."""
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


def _lines(track: Track) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return track.measured, track.first, track.now


def _size(values: np.ndarray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max()) if finite.size else 0.0
