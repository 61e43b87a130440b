"""Slow down and turn a motion of a cell, so that the joints stay within their speeds and ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.nominal import Nominal
from vispeg.task.control import DAMPING, POSTURE
from vispeg.task.rig.path import FORCE, Path, commands

SHARE = 0.9  # share of a joint's speed limit that a leg may ask for
SAMPLES_HZ = 50.0  # rate at which the arm's motion is predicted
SOFT = 1e-6  # kg^-1, added to the inverse of the operational inertia so that it is regular at a singularity
ROOM = 0.03  # rad, margin at both ends of a joint's range: contact deflects the arm from the predicted path
ROUND, SQUARE = (0.0, 0.15, 0.3, 0.6, np.pi / 2), (0.0, np.pi / 2)  # rad, turns to try for a round and a square part


def paced(path: Path, scene: Scene, stiffness: tuple[float, float], near: np.ndarray) -> Path:
    """Return the path with each leg as slow as needed for no joint to exceed `SHARE` of its speed limit.

    Args:
        path: of the tool's tip. Its forces are left out: they change the commanded poses, not the arm's motion.
        scene: the believed cell; a joint without a stated speed limit slows nothing.
        stiffness: of the controller, see `vispeg.task.rig.path.commands`.
        near: (nj,) rad, the posture in which the arm begins and to which its null space is pulled.

    Raises:
        UserError: a pose out of the arm's reach.
    """
    time, angles = foreseen(path, scene, stiffness, near)
    share = (np.abs(np.gradient(angles, 1.0 / SAMPLES_HZ, axis=0)) / (SHARE * scene.velocity_limit)).max(axis=1)
    ends = np.cumsum([0.0, *(leg.seconds for leg in path.legs)])
    slow = Path(path.start)
    for leg, begin, end in zip(path.legs, ends[:-1], ends[1:], strict=True):
        within = (time >= begin - 1e-9) & (time <= end + 1e-9)
        slow.legs.append(replace(leg, seconds=leg.seconds * max(1.0, float(share[within].max(initial=0.0)))))
    return slow


def foreseen(
    path: Path, scene: Scene, stiffness: tuple[float, float], near: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Predict the motion of an arm that follows a path without contact: time (n,) s and joint angles (n, nj) rad.

    Samples are at `SAMPLES_HZ`. Arguments and errors as for `paced`.
    """
    time, frames = path.frames(SAMPLES_HZ)
    frames[:, FORCE] = 0.0
    return time, followed(scene, commands(frames, scene, stiffness, near), near)


def followed(scene: Scene, pose: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Return joint angles (n, nj) rad with which operational space control follows flange poses (n, 7) at `SAMPLES_HZ`.

    The inverse of the Jacobian is weighted by inertia, so that light joints move more. In the null space the arm moves
    to the posture `near` at the rate of its spring over its damper. Source: Khatib 1987, A unified approach for motion
    and force control of robot manipulators, IEEE J. Robotics and Automation 3(1), the dynamically consistent inverse.
    """
    nominal, q, out = nominal_of(scene.nominal, 1), near.copy(), []
    pull = POSTURE / DAMPING / SAMPLES_HZ
    q = _step(nominal, q, pose[0], np.zeros_like(q), 10)
    for goal in pose:
        q = _step(nominal, q, goal, pull * (near - q), 2)
        out.append(q)
    return np.array(out)


def _step(nominal: Nominal, q: np.ndarray, goal: np.ndarray, pull: np.ndarray, times: int) -> np.ndarray:
    """Return the joint angles (nj,) rad after some Newton steps from q to a flange pose.

    Args:
        nominal: one nominal arm.
        q: (nj,) rad.
        goal: (7,) flange pose in the base, m and w x y z.
        pull: (nj,) rad, displacement whose null-space part is added to the first step.
        times: number of steps.
    """
    from vispeg.kernels.arm import towards

    way = np.empty((1, len(q)))
    for _ in range(times):
        mass, jac, pos, quat, _ = nominal.operational(q[None])
        towards(mass, jac, pos, quat, goal[None, :3], goal[None, 3:], pull[None], SOFT, way)
        q = q + way[0]
        pull = np.zeros_like(q)
    return q


def with_room(path: Path, scene: Scene, stiffness: tuple[float, float], near: np.ndarray) -> Path:
    """Return the path with the flange turned about the vertical, so that the joints stay within their ranges.

    The angle is the smallest of `ROUND` or `SQUARE`, to either side, that leaves the margin `ROOM`; if none does, the
    one with the largest margin.

    Args:
        path: of the tool's tip.
        scene: the believed cell; a square part fits its goal only unturned or after a quarter turn.
        stiffness: of the controller, see `vispeg.task.rig.path.commands`.
        near: (nj,) rad, the posture in which the arm begins and to which its null space is pulled.

    Raises:
        UserError: at each angle some joint leaves its range or a pose is out of the arm's reach.
    """
    low, high = scene.range.T
    best, most, worst, out_of_reach = path, -np.inf, (0, 0.0), None  # `worst`: joint with the least margin, its angle
    for size in SQUARE if scene.config.shape == "square" else ROUND:
        for yaw in (size, -size) if size else (0.0,):
            new = turned_by(path, yaw)
            try:
                angles = foreseen(new, scene, stiffness, near)[1]
            except UserError as error:
                out_of_reach = out_of_reach or error
                continue
            room = np.minimum(angles - low, high - angles)
            if float(room.min()) > most:
                row, joint = np.unravel_index(int(room.argmin()), room.shape)
                best, most, worst = new, float(room.min()), (int(joint), float(angles[row, joint]))
        if most >= ROOM:
            break
    if out_of_reach and most < 0.0:
        raise out_of_reach
    if most < 0.0:
        joint, angle = worst
        raise UserError(
            f"the motion takes {scene.joints[joint]} out of its range",
            key="--motion",
            expected=f"{low[joint]:.3g} to {high[joint]:.3g} rad; a fixture nearer the middle of the arm's reach helps",
            got=round(angle, 2),
        )
    return best


def turned_by(path: Path, yaw: float) -> Path:
    """Return the whole path with the flange turned by `yaw` rad more about the vertical through the tip."""

    def turned(frame):
        return replace(frame, yaw=frame.yaw + yaw)

    out = Path(turned(path.start))
    out.legs = [replace(leg, frame=turned(leg.frame)) for leg in path.legs]
    return out
