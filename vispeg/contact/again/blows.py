"""Blows of a recorded tool: found, and run again in worlds from just before each, as restarts of a toss are.

What a contact takes out of a blow shows in the force of its first hundredths of a second, which no path at 40 Hz holds.
So the whole arm runs again, under the controller that ran, from where it was some ms before the touch; the force after
the touch is compared in a few windows, each from its own touch on, so that a height need not be known. Source: window
restarts as in Acosta, Yang and Posa 2022, Validating robotics simulators on real-world impacts, RA-L 7(3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vispeg.contact.torques import sensed
from vispeg.recordings.cell import wrench_noise
from vispeg.recordings.recording import Recording
from vispeg.recordings.regimes import FREE, IMPACT
from vispeg.robots.scene import Scene
from vispeg.sim.touch import touch
from vispeg.task.belief import believed
from vispeg.task.rig.run import run
from vispeg.worlds.world import World

BEFORE, AFTER = 0.012, 0.065  # s that are run before the measured touch, and after it
CALM = 0.05  # s before the touch in free air from which place and speed are taken
WINDOWS = (0.0, 0.008, 0.016, 0.03, 0.05)  # s after the touch, between which forces are averaged
FORCE, SHARE = 0.4, 0.15  # N, and of the force of the window: what the right model leaves
FIRST = 0.3  # the same in the first window, where a sample is as long as the peak


@dataclass(frozen=True)
class Blow:
    """One touch at some speed.

    Attributes:
        recording: that it is in.
        scene: the believed cell.
        rows: of the recording, that are run again.
        start: (nj,) rad, rad/s, where the arm was at the first of these rows and how fast, as read.
        axis: (3,) along which the contact pushes, flange axes.
        threshold: N, of a touch.
        speed: m/s, of the tip.
        force: (len(WINDOWS) - 1,) N along the axis, means over the windows.
    """

    recording: Recording
    scene: Scene
    rows: slice
    start: tuple[np.ndarray, np.ndarray]
    axis: np.ndarray
    threshold: float
    speed: float
    force: np.ndarray

    @property
    def sigma(self) -> np.ndarray:
        """(k,) N, what the right model leaves in each window."""
        share = np.r_[FIRST, np.full(len(self.force) - 1, SHARE)]
        return np.hypot(FORCE, share * np.maximum(np.abs(self.force), 0.3 * np.abs(self.force).max()))


def restarts(rec: Recording) -> bool:
    """Whether a recording has a wrench and a controller under which stretches of it can run again."""
    if rec.control.mode != "osc" or rec.ee_cmd is None or not sensed(rec):
        return False
    clock = np.diff(rec.time) * rec.control.rate_hz
    return bool(abs(np.median(clock) - 1) < 0.05)


def blows(rec: Recording) -> list[Blow]:
    """Those of a recording that `restarts`; a rebound's own touch is no blow."""
    if not restarts(rec):
        return []
    cell = believed(rec.cell, rec.path / "recording.yaml")
    felt = touch(rec, cell.scene)
    assert felt is not None
    hit = felt.regime == IMPACT
    calm, before, after = (round(s * rec.rate_hz) for s in (CALM, BEFORE, AFTER))
    noise = wrench_noise(rec.noise)
    out = []
    for start in np.flatnonzero(hit & ~np.r_[False, hit[:-1]]):
        first = int(start) + int(np.argmax(felt.force[start : start + after] > felt.threshold))
        if first < calm + before or first + after >= len(rec.time) or np.any(felt.regime[first - calm : start] != FREE):
            continue
        if rec.episode is not None and rec.episode[first - calm] != rec.episode[first + after]:
            continue
        rows = slice(first - before, first + after)
        push = felt.wrench[first : first + after, :3] - felt.wrench[first - before : first, :3].mean(axis=0)
        axis = push.sum(axis=0) / max(np.linalg.norm(push.sum(axis=0)), 1e-9)
        speed = float(np.linalg.norm(felt.velocity[first - before]))
        least = max(felt.threshold, 0.0 if noise is None else 6.0 * float(noise[0]))
        force = _windows(felt.wrench[rows, :3] @ axis, rec.rate_hz, before, least)
        if np.isfinite(force).all():
            begin = _started(rec, first - calm, first, first - before)
            out.append(Blow(rec, cell.scene, rows, begin, axis, least, speed, force))
    return out


def forces(blow: Blow, worlds: Sequence[World], nthread: int = 1) -> np.ndarray:
    """(nworld, k) N that the worlds predict for a blow; NaN where a world does not touch in time."""
    rec, rate = blow.recording, blow.recording.control.rate_hz
    assert rec.ee_cmd is not None
    cell = believed(rec.cell, rec.path / "recording.yaml")
    plants = [cell.world.add(*w.effects) for w in worlds]
    ran = run(cell.scene, plants, rec.control, rec.ee_cmd[blow.rows], *blow.start, nthread=nthread).ft
    before = max(2, round(0.5 * BEFORE * rate))
    return np.stack([_windows(wrench @ blow.axis, rate, before, blow.threshold) for wrench in ran[:, :, :3]])


def _windows(force: np.ndarray, rate: float, before: int, threshold: float) -> np.ndarray:
    """(k,) means of a force (n,) over `WINDOWS` after its own touch, less what it was before; NaN without any."""
    above = force - force[:before].mean()
    touched = np.flatnonzero(np.abs(above) > threshold)
    out = np.full(len(WINDOWS) - 1, np.nan)
    if len(touched):
        edges = touched[0] + np.round(np.array(WINDOWS) * rate).astype(int)
        if edges[-1] <= len(force):
            out = np.array([above[a:b].mean() for a, b in zip(edges[:-1], edges[1:], strict=True)])
    return out


def _started(rec: Recording, begin: int, end: int, at: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles and rates (nj,) at row `at` of a parabola through the rows between, in which nothing is touched."""
    time = rec.time[begin:end] - rec.time[at]
    curve = np.polynomial.polynomial.polyfit(time, np.nan_to_num(rec.q[begin:end]), 2)
    return curve[0], curve[1]
