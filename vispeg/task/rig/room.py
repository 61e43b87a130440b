"""Which way a motion is turned about the vertical, so that each joint keeps within its range of position."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vispeg.core.errors import UserError
from vispeg.robots.scene import Scene
from vispeg.task.rig.pace import foreseen
from vispeg.task.rig.path import Path

ROOM = 0.03  # rad of a joint's range that are left at either end: contact bends the way of the arm
ROUND, SQUARE = (0.0, 0.15, 0.3, 0.6, np.pi / 2), (0.0, np.pi / 2)  # rad: how far what is held may be turned


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
