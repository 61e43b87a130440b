"""Find a start posture: the flange at a given pose, the joints away from limits, table and singularities."""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np

from vispeg.control.laws import singular
from vispeg.core.counts import count
from vispeg.core.errors import UserError
from vispeg.robots.model import RobotModel
from vispeg.sim.compiled import compiled, nominal_of
from vispeg.sim.reach import reach

TRIES, ITERATIONS = 200, 60  # random starts, and steps from each
EXACT = 1e-6  # error of the pose that is accepted, m and rad together
# rad: a joint is searched within +-TURN of the middle of its range, if that is wider; an unlimited one around 0
TURN = np.pi
CLEAR = 0.10  # m: least height of moving links above the table's top, z = 0
# Caps of two factors of the score: beyond them a posture is not better.
SINGULAR_CAP = 0.15  # smallest singular value of the Jacobian
LIMIT_CAP = 0.2  # distance of a joint from its nearer limit, as a share of half its range
ASIDE = 0.05  # m, decay length of the score with the distance of links from the vertical plane, see `_score`
ROUND = 1e-3  # rad, to which the angles of the result are rounded
DOFS = 6  # degrees of freedom of the flange


def home_of(robot: RobotModel, pos: tuple[float, ...], quat: tuple[float, ...]) -> np.ndarray:
    """Return the declared home posture (nj,) rad, else solve one for the flange at `pos` (3,) m, `quat` (4,) wxyz.

    Raises:
        UserError: no posture within the joint limits holds the flange there, or the arm has fewer than six joints.
    """
    if len(robot.joints) < DOFS:
        what = "an arm of so few joints cannot hold its tool at any pose, as a world needs it"
        expected = "six joints or more; record, compare, fit and diagnose take the arm's own file, without a world"
        raise UserError(what, file=robot.name, expected=expected, got=count(len(robot.joints), "joint"))
    return np.array(robot.home or _solved(robot, pos, quat))


@lru_cache(maxsize=64)  # robots are hashed by identity
def _solved(robot: RobotModel, pos: tuple[float, ...], quat: tuple[float, ...]) -> tuple[float, ...]:
    """Solve from many starts and return the best by `_score`; deterministic for a given arm and pose."""
    low, high = bounds(robot)
    starts = low + (high - low) * np.random.default_rng(0).random((TRIES, len(low)))
    nominal = nominal_of(robot, TRIES)
    q, error = reach(nominal, np.tile(pos, (TRIES, 1)), np.tile(quat, (TRIES, 1)), starts, ITERATIONS)
    free = ~np.isfinite(robot.range[:, 0])
    wide = free | (robot.range[:, 1] - robot.range[:, 0] > 2 * TURN)
    middle = 0.5 * (low + high)[wide]
    q[:, wide] = middle + np.mod(q[:, wide] - middle + TURN, 2 * TURN) - TURN  # whole turns change no pose
    score = np.where(error < EXACT, _score(robot, q, nominal.operational(q)[1], np.array(pos)), 0.0)
    best = int(score.argmax())
    if score[best] <= 0.0:
        place, turn = np.round(pos, 4).tolist(), np.round(quat, 4).tolist()
        what = f"no posture within the joint limits holds the flange at {place} m, {turn} (w x y z) in the base"
        expected = "a pose in reach (task.fixture), a flange turned about its z axis (robot.flange_quat), or robot.home"
        raise UserError(what, file=robot.name, expected=expected)
    return tuple((np.round(q[best] / ROUND) * ROUND).tolist())


def bounds(robot: RobotModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and greatest angle (nj,) rad of each joint, at most +-`TURN` around the middle of its range."""
    limited = np.isfinite(robot.range).all(axis=1, keepdims=True)
    low, high = np.where(limited, robot.range, (-TURN, TURN)).T
    mid, half = 0.5 * (low + high), np.minimum(0.5 * (high - low), TURN)
    return mid - half, mid + half


def _score(robot: RobotModel, q: np.ndarray, jac: np.ndarray, pos: np.ndarray) -> np.ndarray:
    """Score postures (n, nj); returns (n,), 0 for an inadmissible one.

    The score is the product of: the smallest singular value of the Jacobian (n, 6, nj), capped at `SINGULAR_CAP`; the
    least distance of a joint to its limit as a share of half its range, capped at `LIMIT_CAP`; the height of the links,
    m; and their closeness to the vertical plane through the base's axis and the flange at `pos` (3,), as an elbow to
    the side may collide with objects there.
    """
    low, high = bounds(robot)
    margin = np.minimum(q - low, high - q) / (0.5 * (high - low))
    free = np.minimum(singular(jac), SINGULAR_CAP) * np.clip(margin.min(axis=1), 0.0, LIMIT_CAP)
    links = _links(robot, q)
    distance = max(float(np.hypot(*pos[:2])), 1e-9)  # a flange on the axis lies in every vertical plane through it
    aside = np.abs(links[:, :, 0] * pos[1] - links[:, :, 1] * pos[0]).mean(axis=1) / distance
    height = links[:, :, 2]
    sunk = (height < CLEAR) & (np.ptp(height, axis=0) > 1e-9)  # ignore links that no posture moves
    height = np.where(sunk.any(axis=1), 0.0, height.mean(axis=1))
    return free * height * np.exp(-aside / ASIDE)


def _links(robot: RobotModel, q: np.ndarray) -> np.ndarray:
    """Compute the origins (n, nj, 3) m of the links that the joints move."""
    model = compiled(robot)
    data = mujoco.MjData(model)
    places = [model.joint(j).qposadr[0] for j in robot.joints]
    bodies = [model.body(b).id for b in robot.links]
    out = np.empty((len(q), len(bodies), 3))
    for i, row in enumerate(q):
        data.qpos[places] = row
        mujoco.mj_kinematics(model, data)
        out[i] = data.xpos[bodies]
    return out
