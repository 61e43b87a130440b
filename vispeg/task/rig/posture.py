"""The arm's posture over the goal, near which motions begin, and one with the elbow turned for the same flange pose."""

from __future__ import annotations

import numpy as np

from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.interface.observer import DOWN
from vispeg.robots.scene import Scene
from vispeg.sim.compiled import nominal_of
from vispeg.sim.reach import reach
from vispeg.task.start import home

STEP, FAR = 0.02, 1.5  # rad, norm over all joints: distance between tried postures, and greatest distance
ROOM = 0.3  # rad, distance that each joint keeps to its limits
TURN = 0.3  # rad, least distance (norm over all joints) of the posture with the elbow turned


def start_angles(scene: Scene, pose: np.ndarray, near: np.ndarray | None = None) -> np.ndarray:
    """Return joint angles (nj,) rad that put the flange at a pose.

    Args:
        scene: the cell.
        pose: (7,) flange pose in the base, m and w x y z.
        near: (nj,) rad, where the search starts; None for the home posture.

    Raises:
        UserError: a pose out of the arm's reach.
    """
    nominal = nominal_of(scene.nominal, 1)
    start = home(scene) if near is None else near
    q, error = reach(nominal, pose[None, :3], pose[None, 3:], start[None])
    low, high = scene.range.T
    if error[0] > 1e-4 or not ((q[0] >= low) & (q[0] <= high)).all():
        raise UserError("the motion begins out of the arm's reach", key="--motion", got=pose[:3].round(3).tolist())
    return q[0]


def posture(scene: Scene) -> np.ndarray:
    """Return the joint angles (nj,) rad with the tip over the goal, to which the null space is pulled."""
    return start_angles(scene, np.concatenate([np.array(scene.target) + [0, 0, 0.03 + scene.tip], DOWN]))


def elbow_turned(scene: Scene) -> np.ndarray:
    """Return joint angles (nj,) rad with the flange's pose as in `posture` but the elbow turned.

    Of the postures on the way to either side, take the one whose flange compliance `J J'` differs most from that of
    `posture`. Presses in both postures separate the compliance of the arm from that of the fixture.

    Raises:
        UserError: an arm with fewer than seven joints, or without room to turn its elbow.
    """
    nominal, q0 = nominal_of(scene.nominal, 1), posture(scene)
    if len(q0) < 7:
        raise UserError(
            "the arm has no elbow to turn: each pose of its flange takes all its joints",
            key="--motion",
            expected="seven joints or more; with six, press on a stop that does not give way, such as the table",
            got=count(len(q0), "joint"),
        )
    _, jac, pos, quat, _ = (part.copy() for part in nominal.operational(q0[None]))
    before, best, most = jac[0] @ jac[0].T, q0, 0.0
    for sign in (1.0, -1.0):
        q, along = q0, sign * _null(jac[0])
        for _ in range(round(FAR / STEP)):
            q = reach(nominal, pos, quat, (q + STEP * along)[None])[0][0]
            if np.minimum(q - scene.range[:, 0], scene.range[:, 1] - q).min() < ROOM:
                break
            jac_here = nominal.operational(q[None])[1][0]
            along = np.copysign(1.0, _null(jac_here) @ along) * _null(jac_here)  # the same way along the null space
            far = float(np.linalg.norm(jac_here @ jac_here.T - before))
            if far > most:
                best, most = q, far
    if np.linalg.norm(best - q0) < TURN:
        raise UserError(
            "the elbow has no room to turn", key="--motion", expected=f"{ROOM} rad to each joint's limits on the way"
        )
    return best


def _null(jac: np.ndarray) -> np.ndarray:
    """Return the unit joint velocity (nj,) that does not move the flange, for its Jacobian (6, nj)."""
    return np.linalg.svd(jac)[2][-1]
