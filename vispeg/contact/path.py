"""One measured episode: pose and velocity of the flange in the hand's frame, and its wrench on the tool.

The hand is the cell without its arm (`vispeg.contact.hand`). Its frame is the pose of the flange at the start.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from vispeg.recordings.differentiate import bridged, smooth
from vispeg.recordings.recording import Recording
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import flange_pose
from vispeg.worlds.world import World

PATH_HZ = 40.0  # bandwidth of the smoothed flange path; faster motion, as in an impact, is lost


@dataclass(frozen=True)
class Path:
    """One episode, resampled to physics steps.

    Attributes:
        step: physics step, s.
        time: (n,) s since the start of the episode.
        origin, frame: (3,) m and (4,) wxyz, the hand's frame in the base frame.
        place, rate: (n, 6) pose of the flange in the hand's frame, m and intrinsic x, y, z angles in rad, and its time
            derivative.
        jacobian: (n, 6, 6), maps a wrench on the tool (at the flange, flange axes) to generalised forces of `place`.
        wrench: (n, 6) N, N m, wrench of the flange on the tool as the sensor read it, flange axes.
        goal: (3,) m, base frame, mouth of the goal where the believed cell has it.
        rows: (k,) indices of the episode's samples in the recording.
        clock: (k,) s, their times since the start of the episode.
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
    """Return the path of one episode.

    Args:
        scene: cell of the arm that moved.
        rec: measured angles; missing ones are interpolated.
        wrench: (len(rec.time), 6) N, N m, wrench of the flange on the tool, flange axes; gaps are interpolated.
        rows: (k,) indices of the episode's samples in the recording, two or more.
        longest: upper limit of the physics step, s; the step used divides the sample period.
        believed: effects of the believed cell; offsets of the goal among them move `goal`.
    """
    clock = rec.time[rows] - rec.time[rows[0]]
    period = float(np.median(np.diff(clock)))
    step = period / np.ceil(period / longest - 1e-9)
    time = np.arange(int(np.floor(clock[-1] / step + 1e-6)) + 1) * step
    pose = flange_pose(scene.nominal, bridged(clock, rec.q[rows]))
    turn = Rotation.from_quat(pose[:, 3:], scalar_first=True)
    first = turn[0]
    place = np.concatenate([first.inv().apply(pose[:, :3] - pose[0, :3]), _angles(first.inv() * turn)], axis=1)
    smoothed, rate, _ = smooth(clock, place, PATH_HZ)

    def on_grid(values: np.ndarray) -> np.ndarray:
        return np.stack([np.interp(time, clock, v) for v in values.T], axis=1)

    place, rate = on_grid(smoothed), on_grid(rate)
    read = on_grid(bridged(clock, wrench[rows]))
    offsets = [[e.params[a].value for a in "xyz"] for e in believed.effects if e.effect == scene.offset]
    goal = np.add(scene.target, np.sum(offsets, axis=0) if offsets else 0.0)
    return Path(step, time, pose[0, :3], pose[0, 3:], place, rate, jacobian(place[:, 3:]), read, goal, rows, clock)


def tips(path: Path, scene: Scene) -> np.ndarray:
    """Return the position of the held part's tip relative to the goal's mouth along a path, (n, 3) m, base axes."""
    frame = Rotation.from_quat(path.frame, scalar_first=True)
    turn = frame * Rotation.from_euler("XYZ", path.place[:, 3:])
    return path.origin + frame.apply(path.place[:, :3]) + turn.apply([0.0, 0.0, scene.tip]) - path.goal


def jacobian(angles: np.ndarray) -> np.ndarray:
    """Return the matrices (n, 6, 6) that map a wrench in flange axes to generalised forces of `Path.place`.

    By virtual work, the generalised force of an angle is the torque about the axis that the angle turns about.

    Args:
        angles: (n, 3) rad, intrinsic x, y, z, of the flange in the hand's frame.
    """
    turn = Rotation.from_euler("XYZ", angles).as_matrix()
    x, y = Rotation.from_euler("X", angles[:, :1]), Rotation.from_euler("XY", angles[:, :2])
    axes = np.stack([np.tile([1.0, 0, 0], (len(angles), 1)), x.apply([0, 1.0, 0]), y.apply([0, 0, 1.0])], axis=1)
    out = np.zeros((len(angles), 6, 6))
    out[:, :3, :3] = turn
    out[:, 3:, 3:] = axes @ turn
    return out


def _angles(turn: Rotation) -> np.ndarray:
    """Return intrinsic x, y, z angles (n, 3) rad, unwrapped."""
    return np.unwrap(turn.as_euler("XYZ"), axis=0)
