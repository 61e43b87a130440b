"""A measured motion as the hand's coordinates: where the flange was, how fast, and what it put on the tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.recordings.differentiate import bridged, smooth
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose
from vispeg.worlds.world import World

PATH_HZ = 40.0  # bandwidth of the flange's path: an impact's is lost above it


@dataclass(frozen=True)
class Path:
    """One episode, on a grid of physics steps.

    Attributes:
        step: s.
        time: (n,) s since its start.
        origin, frame: (3,) m and (4,) wxyz, where the flange was at its start: the hand's frame.
        place, rate: (n, 6) the hand's coordinates, m and rad, and their rates.
        jacobian: (n, 6, 6): generalised forces from a wrench on the tool at the flange, in the flange's axes.
        wrench: (n, 6) N, N m that the flange put on the tool, flange axes, as read.
        goal: (3,) m, base frame, the mouth of the goal as it is believed to stand.
        rows: (k,) rows of the recording.
        clock: (k,) s since its start, of these rows.
    """

    step: float
    time: np.ndarray
    origin: np.ndarray
    frame: np.ndarray
    place: np.ndarray
    rate: np.ndarray
    jacobian: np.ndarray
    wrench: np.ndarray
    goal: np.ndarray
    rows: np.ndarray
    clock: np.ndarray


def along(scene: Scene, rec: Recording, wrench: np.ndarray, rows: np.ndarray, longest: float, believed: World) -> Path:
    """Give the path of one episode.

    Args:
        scene: whose arm moved.
        rec: measured angles.
        wrench: (len(rec.time), 6) what the flange put on the tool, flange axes.
        rows: of the episode.
        longest: physics step, s, at most; whole steps make up a sample.
        believed: effects that are part of the believed cell; they may say that the goal stands elsewhere.
    """
    clock = rec.time[rows] - rec.time[rows[0]]
    period = float(np.median(np.diff(clock)))
    step = period / np.ceil(period / longest - 1e-9)
    time = np.arange(int(np.floor(clock[-1] / step + 1e-6)) + 1) * step
    pose = flange_pose(scene.nominal, bridged(clock, rec.q[rows]))
    turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
    first = turn[0]
    place = np.concatenate([first.inv().apply(pose[:, :3] - pose[0, :3]), _angles(first.inv() * turn)], axis=1)
    calm, rate, _ = smooth(clock, place, PATH_HZ)

    def on_grid(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(time, clock, v) for v in values.T], axis=1)

    place, rate = on_grid(calm), on_grid(rate)
    read = on_grid(bridged(clock, wrench[rows]))
    off = [[e.params[a].value for a in "xyz"] for e in believed.effects if e.effect == scene.offset]
    goal = np.add(scene.target, np.sum(off, axis=0) if off else 0.0)
    return Path(step, time, pose[0, :3], pose[0, 3:], place, rate, jacobian(place[:, 3:]), read, goal, rows, clock)


def tips(path: Path, scene: Scene) -> np.ndarray:
    """(n, 3) m, base axes: where the tip of the scene's part is along a path, from the mouth of its goal."""
    frame = Rotation.from_quat(path.frame, scalar_first=True)
    turn = frame * Rotation.from_euler("XYZ", path.place[:, 3:])
    return path.origin + frame.apply(path.place[:, :3]) + turn.apply([0.0, 0.0, scene.tip]) - path.goal


def jacobian(angles: np.ndarray) -> np.ndarray:
    """(n, 6, 6) that takes a wrench in the flange's axes to forces of the hand's joints at these angles (n, 3) rad."""
    turn = Rotation.from_euler("XYZ", angles).as_matrix()
    x, y = Rotation.from_euler("X", angles[:, :1]), Rotation.from_euler("XY", angles[:, :2])
    axes = np.stack([np.tile([1.0, 0, 0], (len(angles), 1)), x.apply([0, 1.0, 0]), y.apply([0, 0, 1.0])], axis=1)
    out = np.zeros((len(angles), 6, 6))
    out[:, :3, :3] = turn
    out[:, 3:, 3:] = axes @ turn
    return out


def _angles(turn: Rotation) -> np.ndarray:
    """Intrinsic x, y, z angles (n, 3) rad, without jumps."""
    return np.unwrap(turn.as_euler("XYZ"), axis=0)
