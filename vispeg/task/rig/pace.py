"""How fast a motion of a cell may be, and which way it is turned, so that joints keep within speed and range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.nominal import Nominal
from vispeg.task.control import DAMPING, POSTURE
from vispeg.task.rig.path import FORCE, Path, commands

SHARE = 0.9  # of a joint's speed limit that a leg may ask for
SAMPLES_HZ = 50.0
SOFT = 1e-6  # beside the inverse of the operational inertia, kg^-1: near a singular posture it stays finite
ROOM = 0.03  # rad of a joint's range that are left at either end: contact bends the way of the arm
ROUND, SQUARE = (0.0, 0.15, 0.3, 0.6, np.pi / 2), (0.0, np.pi / 2)  # rad: how far what is held may be turned


def paced(path: Path, scene: Scene, stiffness: tuple[float, float], near: np.ndarray) -> Path:
    """Give the path with legs so long that no joint passes `SHARE` of its speed limit where the arm follows its poses.

    Args:
        path: of the tool's tip, with forces: these bend the commanded poses, not the way of the arm, and are left out.
        scene: the believed cell; a joint without a stated limit is not slowed.
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
    """Time (n,) s at `SAMPLES_HZ` and the joint angles (n, nj) rad then, of an arm that follows a path freely.

    Arguments and errors as for `paced`.
    """
    time, frames = path.frames(SAMPLES_HZ)
    frames[:, FORCE] = 0.0
    return time, followed(scene, commands(frames, scene, stiffness, near), near)


def followed(scene: Scene, pose: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Joint angles (n, nj) rad in which operational space control follows flange poses (n, 7) at `SAMPLES_HZ`.

    The inverse of the Jacobian is weighted by inertia, so that light joints move more, and the null space goes to the
    posture at the rate of its spring over its damper. Source: Khatib 1987, A unified approach for motion and force
    control of robot manipulators, IEEE J. Robotics and Automation 3(1), the dynamically consistent inverse.
    """
    nominal, q, out = nominal_of(scene.nominal, 1), near.copy(), []
    pull = POSTURE / DAMPING / SAMPLES_HZ
    q = _step(nominal, q, pose[0], np.zeros_like(q), 10)
    for goal in pose:
        q = _step(nominal, q, goal, pull * (near - q), 2)
        out.append(q)
    return np.array(out)


def _step(nominal: Nominal, q: np.ndarray, goal: np.ndarray, pull: np.ndarray, times: int) -> np.ndarray:
    """Newton steps from q (nj,) to a flange pose, the first with a way `pull` (nj,) for the null space."""
    from vispeg.kernels.arm import towards

    way = np.empty((1, len(q)))
    for _ in range(times):
        mass, jac, pos, quat, _ = nominal.operational(q[None])
        towards(mass, jac, pos, quat, goal[None, :3], goal[None, 3:], pull[None], SOFT, way)
        q = q + way[0]
        pull = np.zeros_like(q)
    return q


def with_room(path: Path, scene: Scene, stiffness: tuple[float, float], near: np.ndarray) -> Path:
    """Give the path as it is where the joints have room for it, else with the flange turned as little as gives them
    room.

    Args:
        path: of the tool's tip.
        scene: the believed cell; a part that is not round fits its goal after a quarter turn alone.
        stiffness: of the controller, see `vispeg.task.rig.path.commands`.
        near: (nj,) rad, the posture in which the arm begins and to which its null space is pulled.

    Raises:
        UserError: some joint leaves its range whichever way the flange is turned, or a pose out of the arm's reach.
    """
    low, high = scene.range.T
    best, most, at, out_of_reach = path, -np.inf, (0, 0.0), None
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
                best, most, at = new, float(room.min()), (int(joint), float(angles[row, joint]))
        if most >= ROOM:
            break
    if out_of_reach and most < 0.0:
        raise out_of_reach
    if most < 0.0:
        joint, angle = at
        raise UserError(
            f"the motion takes {scene.joints[joint]} out of its range",
            key="--motion",
            expected=f"{low[joint]:.3g} to {high[joint]:.3g} rad; a fixture nearer the middle of the arm's reach helps",
            got=round(angle, 2),
        )
    return best


def turned_by(path: Path, yaw: float) -> Path:
    """Give the path with the flange turned about the vertical through the tip by so many rad more, all along."""

    def turned(frame):
        return replace(frame, yaw=frame.yaw + yaw)

    out = Path(turned(path.start))
    out.legs = [replace(leg, frame=turned(leg.frame)) for leg in path.legs]
    return out
